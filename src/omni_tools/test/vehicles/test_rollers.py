"""A wrong sign of a roller angle is found by symmetry, without false reports."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
import yaml

from omni_platform.configuration import from_mapping
from omni_platform.geometry import WheelMount
from omni_tools.vehicles.rollers import Rollers, roller_remarks

CONFIG = Path(__file__).parents[4] / "config"
FILES = sorted([*CONFIG.glob("vehicles/*.yaml"), *CONFIG.glob("hardware/*.yaml")])


def wheels_of(path: Path) -> dict[str, WheelMount]:
    mounts = yaml.safe_load(path.read_text(encoding="utf-8"))["wheels"]
    return {name: from_mapping(WheelMount, mount, name) for name, mount in mounts.items()}


def flipped(mount: WheelMount) -> WheelMount:
    return dataclasses.replace(mount, roller_angle_deg=-mount.roller_angle_deg)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_nothing_is_wrong_with_the_vehicles_of_the_project(path: Path) -> None:
    assert roller_remarks(wheels_of(path)) == ()


@pytest.mark.parametrize(
    "path", [p for p in FILES if "three_wheel" not in p.stem], ids=lambda path: path.stem
)
def test_one_wrong_sign_is_named(path: Path) -> None:
    wheels = wheels_of(path)
    for name in wheels:
        (remark,) = roller_remarks({**wheels, name: flipped(wheels[name])})
        assert "roller" in remark
        # Either wheel of a middle pair may be the wrong one: the other wheels fit both.
        assert name in remark.split(";")[0]
        if not name.startswith("middle"):
            assert remark.startswith(f"wheels.{name}.roller_angle_deg")
            assert "(or" not in remark


def test_shape_and_lever_of_the_forklift() -> None:
    wheels = wheels_of(CONFIG / "vehicles/mecanum_forklift.yaml")
    rollers = Rollers.of(wheels)
    assert rollers.shape == "X"
    # Closed form for wheels at (a, b): (a + b) / sqrt(2), and with all signs opposite (a - b).
    assert rollers.yaw_lever == pytest.approx((0.65 + 0.5) / 2**0.5)
    opposite = {name: flipped(mount) for name, mount in wheels.items()}
    assert Rollers.of(opposite).shape == "O"
    assert Rollers.of(opposite).yaw_lever == pytest.approx((0.65 - 0.5) / 2**0.5)
    (remark,) = roller_remarks(opposite)
    assert "negate every roller_angle_deg" in remark


def test_front_wheels_swapped_are_neither() -> None:
    wheels = wheels_of(CONFIG / "vehicles/mecanum_forklift.yaml")
    front = {name: flipped(m) if name.startswith("front") else m for name, m in wheels.items()}
    assert "roller" in roller_remarks(front)[0]
