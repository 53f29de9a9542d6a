"""Wrong signs of roller angles, and angles in radians, are found without false reports."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from omni_core.configuration import from_mapping
from omni_core.geometry import WheelMount
from omni_sim.vehicle.rollers import Rollers, roller_remarks

CONFIG = Path(__file__).parents[4] / "config"
FILES = [
    path
    for path in sorted([*CONFIG.glob("vehicles/*.yaml"), *CONFIG.glob("hardware/*.yaml")])
    if "kind: conventional" not in path.read_text(encoding="utf-8")
]


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


@pytest.mark.parametrize("path", [p for p in FILES if "three_wheel" not in p.stem], ids=str)
def test_a_wrong_sign_is_named_although_the_positions_are_not_symmetric(path: Path) -> None:
    wheels, rng = wheels_of(path), np.random.default_rng(3)
    for name, mount in wheels.items():
        moved = {
            other: dataclasses.replace(m, x=m.x + rng.uniform(-0.06, 0.06), y=1.1 * m.y + 0.05)
            for other, m in wheels.items()
        }
        assert roller_remarks(moved) == ()
        angle = mount.roller_angle_deg
        wrong = dataclasses.replace(moved[name], roller_angle_deg=-angle)
        (remark,) = roller_remarks({**moved, name: wrong})
        assert name in remark.split(";")[0]
        if not name.startswith("middle"):
            assert f"{angle:g} deg would be symmetric" in remark


@pytest.mark.parametrize("angle", [-45.0, 30.0, 45.0])
@pytest.mark.parametrize("common", [0.0, -45.0])
def test_one_of_three_wheels_with_another_angle_is_named(angle: float, common: float) -> None:
    wheels = {
        name: dataclasses.replace(mount, roller_angle_deg=common)
        for name, mount in wheels_of(CONFIG / "vehicles/three_wheel_robot.yaml").items()
    }
    assert roller_remarks(wheels) == ()
    same = dataclasses.replace(wheels["first"], roller_angle_deg=common + 180.0)
    assert roller_remarks({**wheels, "first": same}) == ()
    for name, mount in wheels.items() if angle != common else ():
        wrong = dataclasses.replace(mount, roller_angle_deg=angle)
        (remark,) = roller_remarks({**wheels, name: wrong})
        assert remark.startswith(f"wheels.{name}.roller_angle_deg: {angle:g} deg")
        assert f"{common:g} deg would be symmetric" in remark


@given(
    st.integers(2, 4),
    st.lists(st.floats(0.3, 1.0), min_size=4, max_size=4),
    st.lists(st.floats(20.0, 70.0), min_size=4, max_size=4),
)
def test_nothing_is_wrong_with_symmetric_vehicles(
    axles: int, widths: list[float], angles: list[float]
) -> None:
    wheels = {}
    for i, (x, width, angle) in enumerate(
        zip(np.linspace(2, -2, axles), widths, angles, strict=False)
    ):
        for side in (-1.0, 1.0):
            roller = (-side if x > 0.0 else side) * angle
            wheels[f"{i}_{side:g}"] = WheelMount(x=x, y=side * width, roller_angle_deg=roller)
    assert not any("symmetr" in remark for remark in roller_remarks(wheels))


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


@given(
    st.sampled_from([path for path in FILES if "hardware" not in path.parts]),
    st.integers(2, 4),
    st.sampled_from(["roller_angle_deg", "heading_deg", "both"]),
)
def test_angles_in_radians_are_found(path: Path, digits: int, field: str) -> None:
    wheels = wheels_of(path)
    fields = ("roller_angle_deg", "heading_deg") if field == "both" else (field,)
    radians = {
        name: dataclasses.replace(
            mount, **{one: round(np.radians(getattr(mount, one)), digits) for one in fields}
        )
        for name, mount in wheels.items()
    }
    if radians != wheels:
        (remark,) = roller_remarks(radians)
        assert "look like radians" in remark


@given(st.integers(3, 8), st.floats(-1.5, 1.5))
def test_small_angles_of_omni_wheels_on_a_circle_are_degrees(count: int, error: float) -> None:
    wheels = {}
    for number, angle in enumerate(np.arange(count) * 360.0 / count):
        x, y = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        wheels[f"{number}"] = WheelMount(
            x=0.2 * x, y=0.2 * y, heading_deg=angle - 90.0, roller_angle_deg=error
        )
    assert roller_remarks(wheels) == ()
