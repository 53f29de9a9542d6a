"""The sensor matrix gives the velocity of a point of a rigid body along an axis."""

from __future__ import annotations

import math

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_core.sensors import (
    FlowSensor,
    LineSensor,
    heading_remarks,
    rotation_matrix,
    sensor_matrix,
)


def test_rows_are_velocities_along_the_axes() -> None:
    sensors = {
        "left": LineSensor(x=0.0, y=0.5, heading_deg=0.0),
        "front": LineSensor(x=0.6, y=0.1, heading_deg=90.0),
        "oblique": LineSensor(x=-0.3, y=-0.4, heading_deg=210.0),
    }
    twist = np.array([3.0, -1.0, 0.8])
    measured = sensor_matrix(sensors) @ twist
    for value, sensor in zip(measured, sensors.values(), strict=True):
        velocity = twist[:2] + twist[2] * np.array([-sensor.y, sensor.x])
        angle = math.radians(sensor.heading_deg)
        assert math.isclose(value, velocity @ np.array([math.cos(angle), math.sin(angle)]))


def test_pixel_pitch_divides_the_field_of_view() -> None:
    assert math.isclose(LineSensor(x=0.0, y=0.0, heading_deg=0.0).pixel_pitch * 1024, 0.05)


def test_a_whole_number_is_a_number() -> None:
    sensor = LineSensor(x=0, y=1, heading_deg=90)
    assert sensor == LineSensor(x=0.0, y=1.0, heading_deg=90.0)
    assert isinstance(sensor.x, float)
    with pytest.raises(ConfigurationError, match=r"pixels: 100\.0 is a number, must be a whole"):
        LineSensor(x=0, y=1, heading_deg=90, pixels=100.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("degrees", [30, 45, 60, 90, 120, 135, 150, 180])
@pytest.mark.parametrize("digits", [2, 3, 6])
def test_a_mounting_heading_in_radians_is_reported(degrees: int, digits: int) -> None:
    heading = -round(math.radians(degrees), digits)
    sensors = {
        "left": FlowSensor(x=0.0, y=0.1, heading_deg=0.0),
        "front": FlowSensor(x=0.1, y=0.0, heading_deg=heading),
    }
    (remark,) = heading_remarks("flow_sensors", sensors)
    assert remark.startswith("flow_sensors.front.heading_deg")
    assert f"enter {-degrees}" in remark
    calibrated = {**sensors, "rear": FlowSensor(x=-0.1, y=0.0, heading_deg=0.31)}
    assert heading_remarks("flow_sensors", calibrated) == ()


@pytest.mark.parametrize("headings", [(0.0,), (0.0, 90.0), (0.4, 90.3), (1.5,), (-90.0, 1.57)])
def test_headings_in_degrees_are_not_reported(headings: tuple[float, ...]) -> None:
    sensors = {f"{h}": LineSensor(x=0.0, y=0.0, heading_deg=h) for h in headings}
    assert heading_remarks("sensors", sensors) == ()


@pytest.mark.parametrize(
    ("angles", "images"),
    [
        ((), "+x +y +z"),
        ((0, 0, 90), "+y -x +z"),
        ((180, 0, 0), "+x -y -z"),
        ((0, -90, 0), "+z +y -x"),
        ((90, 0, 90), "+y +z +x"),  # roll comes first: its y axis goes up and stays there
    ],
)
def test_the_rotation_of_a_mounting_is_that_of_a_urdf(
    angles: tuple[float, ...], images: str
) -> None:
    axes = dict(zip("xyz", np.eye(3), strict=True))
    wanted = [float(f"{word[0]}1") * axes[word[1]] for word in images.split()]
    np.testing.assert_allclose(rotation_matrix(angles).T, wanted, atol=1e-15)
