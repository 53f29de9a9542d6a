"""Flat parameters represent a configuration without loss."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from omni_core.configuration import Configuration, ConfigurationError, parameter, section
from omni_core.geometry import WheelMount
from omni_ros.flat_parameters import flatten, unflatten


class Brake(Configuration):
    torque: float = parameter(100.0, description="Torque", unit="N m")


class Cart(Configuration):
    brake: Brake = section(Brake, description="Brake")
    wheels: Mapping[str, WheelMount] = section(dict, description="Wheels")
    ratios: tuple[float, ...] = parameter((1.0, 2.0), description="Gears")
    seed: int = parameter(3, description="Seed")


CART = Cart(
    brake=Brake(torque=7.5),
    wheels={"left": WheelMount(x=1.0, y=2.0, roller_angle_deg=45.0)},
    ratios=(0.5,),
)


def read_from(flat: Mapping[str, Any]) -> Any:
    return lambda key, _kind, default, _info: flat.get(key, default)


def test_flatten_names_every_value() -> None:
    flat = flatten(CART, "cart")
    assert flat["cart.brake.torque"] == 7.5
    assert flat["cart.wheels.names"] == ["left"]
    assert flat["cart.wheels.left.roller_angle_deg"] == 45.0
    assert flat["cart.ratios"] == [0.5]


def test_unflatten_returns_what_was_flattened() -> None:
    assert unflatten(Cart, read_from(flatten(CART))) == CART


def test_what_is_not_given_keeps_its_default() -> None:
    assert unflatten(Cart, read_from({"seed": 9})) == Cart(seed=9)


def test_a_required_value_that_is_missing_is_named() -> None:
    flat = flatten(CART)
    del flat["wheels.left.y"]
    with pytest.raises(ConfigurationError) as caught:
        unflatten(Cart, read_from(flat))
    assert caught.value.key == "wheels.left.y"


def test_an_entry_may_not_be_called_names() -> None:
    with pytest.raises(ConfigurationError, match="reserved"):
        flatten(Cart(wheels={"names": WheelMount(x=1.0, y=2.0, roller_angle_deg=0.0)}))
