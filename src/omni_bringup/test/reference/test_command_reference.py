"""Test the reference of all options."""

from omni_bringup.reference import commands
from omni_core.configuration import Configuration, parameter


class Options(Configuration):
    """Options of a command."""

    folder: str = parameter("")
    """folder of the results"""
    kind: str = parameter("fast")
    """kind of the run"""


def test_an_option_without_a_default_has_an_empty_cell() -> None:
    assert list(commands._rows(Options)) == [
        "| `--folder` |  |  | folder of the results |",
        "| `--kind` | `fast` |  | kind of the run |",
    ]
