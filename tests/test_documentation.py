"""What the documentation says of parameters and commands is what the code does."""

from __future__ import annotations

from omni_process import WORKSPACE, omni

from omni_bringup.parameter_reference import reference


def test_parameter_reference_is_current() -> None:
    written = (WORKSPACE / "docs/parameters.md").read_text(encoding="utf-8")
    assert written == reference(), (
        "write it anew: ./omni exec python -m omni_bringup.parameter_reference > docs/parameters.md"
    )


def test_help_names_every_option_of_the_readme() -> None:
    helped = omni(["run", "--help"])
    assert helped.returncode == 0
    for option in ("--variant", "--out", "--set", "--real-time", "--json", "EXPERIMENT"):
        assert option in helped.stdout
