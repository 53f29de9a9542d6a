"""Every number of an experiment is used, or refused in a sentence, however large or small it is."""

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest

from omni_platform.configuration import (
    Configuration,
    ConfigurationError,
    declared_parameters,
    element_configuration,
    is_configuration,
    without_none,
)
from omni_tools.vehicles.plausibility import RemarkingLibrary

CONFIG = Path(__file__).parents[4] / "config"


def numbers(configuration: Configuration, above: str = "") -> Iterator[str]:
    """Yield the dotted key of each number."""
    for name, declared, _ in declared_parameters(type(configuration)):
        key, kind, value = f"{above}{name}", without_none(declared), getattr(configuration, name)
        if is_configuration(kind):
            yield from numbers(value, f"{key}.")
        elif element_configuration(kind) is not None:
            for element in value:
                yield from numbers(value[element], f"{key}.{element}.")
        elif kind in (int, float):
            yield key


@pytest.mark.parametrize("experiment", ["straight_line", "flow_sensors"])
@pytest.mark.parametrize("value", ["1e308", "-1e308", "5e-324", ".nan", ".inf"])
def test_extreme_numbers_are_used_or_refused(experiment: str, value: str) -> None:
    remarks: list[str] = []
    library = RemarkingLibrary(CONFIG, remarks.append)
    keys = list(numbers(library.load(experiment, "assisted")))
    assert len(keys) > 200
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for key in keys:
            with contextlib.suppress(ConfigurationError):
                library.load(experiment, "assisted", [f"{key}={value}"]).check_drivable()
