"""Configurations reject invalid values by name, and are equal after a round trip."""

from __future__ import annotations

import contextlib
import math
import pickle
from collections.abc import Mapping
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from omni_core.configuration import (
    Configuration,
    ConfigurationError,
    declared_parameters,
    did_you_mean,
    from_mapping,
    parameter,
    section,
    to_mapping,
)


class Spring(Configuration):
    stiffness: float = parameter(description="Stiffness", unit="N/m", above=0.0)
    coils: int = parameter(5, description="Coils", minimum=1, maximum=100)
    material: str = parameter("steel", description="Wire", choices=("steel", "brass"))
    tags: tuple[str, ...] = parameter((), description="Labels")


class Machine(Configuration):
    main: Spring = parameter(description="Main spring")
    spares: Mapping[str, Spring] = section(dict, description="Spares")
    locked: bool = parameter(False, description="Locked")


class Damper(Configuration):
    damping: float = parameter(unit="N s/m", above=0.0)
    """Damping at low
    speed"""
    bare: float = parameter(0.0)


class LongDamper(Damper):
    stroke: float = parameter(0.1, unit="m")
    """Stroke"""
    bare: float = parameter(1.0)
    """Described here"""


GOOD: dict[str, Any] = {
    "main": {"stiffness": 10, "tags": ["a", "b"]},
    "spares": {"left": {"stiffness": 1.0, "coils": 3}},
}


def test_an_error_of_a_worker_process_names_the_same_value() -> None:
    error = ConfigurationError("brake_assist.minimum_dwell_time", "must be at least 0")
    received = pickle.loads(pickle.dumps(error))
    assert (str(received), received.key) == (str(error), error.key)


def test_the_string_below_a_field_describes_it_in_derived_classes_too() -> None:
    words = {name: info.description for name, _, info in declared_parameters(LongDamper)}
    assert words == {
        "damping": "Damping at low speed",
        "bare": "Described here",
        "stroke": "Stroke",
    }
    (_, (_, _, bare)) = declared_parameters(Damper)
    with pytest.raises(TypeError, match=r"Damper\.bare has no description"):
        _ = bare.description


def test_round_trip_keeps_every_value() -> None:
    machine = from_mapping(Machine, GOOD)
    assert machine.main.stiffness == 10.0
    assert machine.spares["left"].coils == 3
    assert from_mapping(Machine, to_mapping(machine)) == machine


@pytest.mark.parametrize(
    ("mapping", "key", "words"),
    [
        ({"main": {"stiffness": 1.0}, "lokced": True}, "lokced", "did you mean 'locked'"),
        ({"main": {"stifness": 1.0}}, "main.stifness", "did you mean 'stiffness'"),
        ({"main": {}}, "main.stiffness", "required"),
        ({"main": {"stiffness": 0.0}}, "main.stiffness", "must be above 0 N/m"),
        ({"main": {"stiffness": "soft"}}, "main.stiffness", "must be a number"),
        ({"main": {"stiffness": True}}, "main.stiffness", "must be a number"),
        ({"main": {"stiffness": 1.0, "coils": 2.5}}, "main.coils", "must be a whole number"),
        ({"main": {"stiffness": 1.0, "coils": 101}}, "main.coils", "at most 100"),
        ({"main": {"stiffness": 1.0, "coils": 99999999}}, "main.coils", "99999999 is out of range"),
        ({"main": {"stiffness": 1.0, "material": "tin"}}, "main.material", "steel, brass"),
        ({"main": {"stiffness": 1.0, "tags": "a"}}, "main.tags", "not a list of texts"),
        ({"main": {"stiffness": 1.0, "tags": None}}, "main.tags", "is nothing, not a list"),
        ({"main": {"stiffness": 10**400}}, "main.stiffness", "too large"),
        ({"main": {"stiffness": 1.0, "coils": 2**63}}, "main.coils", "64 bits"),
        ({"main": {"stiffness": 1.0, "coils": -(10**400)}}, "main.coils", "64 bits"),
        ({"main": 3}, "main", "not a mapping"),
        ({"main": None}, "main", "is nothing, not a mapping"),
        ({"main": {"stiffness": None}}, "main.stiffness", "is nothing, must be a number"),
        ({"main": {"stiffness": 1.0}, "spares": None}, "spares", "is nothing, not a mapping"),
        ({"main": {"stiffness": 1.0}, "spares": [1]}, "spares", "not a mapping"),
        ({"main": {"stiffness": 1.0}, "spares": {"a.b": {"stiffness": 1.0}}}, "spares", "'a.b'"),
        ({"main": {"stiffness": 1.0}, "spares": {None: {"stiffness": 1.0}}}, "spares", "None"),
        (
            {"main": {"stiffness": 1.0}, "spares": {"a": {"stiffness": -1.0}}},
            "spares.a.stiffness",
            "out of range",
        ),
    ],
)
def test_bad_values_are_refused_by_name(mapping: dict[str, Any], key: str, words: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        from_mapping(Machine, mapping)
    assert caught.value.key == key
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("name", "words"), [("stiffnes", "did you mean 'stiffness'"), ("iec", "'ice'"), ("nothing", "")]
)
def test_only_similar_names_are_suggested(name: str, words: str) -> None:
    found = did_you_mean(name, ("stiffness", "ice", "tuning"))
    assert words in found
    assert bool(words) == bool(found)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_non_finite_numbers_are_refused(value: float) -> None:
    with pytest.raises(ConfigurationError, match="not a finite number"):
        Spring(stiffness=value)


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda children: (
        st.lists(children, max_size=3) | st.dictionaries(st.text(max_size=9), children, max_size=3)
    ),
    max_leaves=8,
)


@given(JUNK, JUNK)
def test_junk_never_escapes_as_another_error(main: Any, spares: Any) -> None:
    with contextlib.suppress(ConfigurationError):
        from_mapping(Machine, {"main": main, "spares": spares})
