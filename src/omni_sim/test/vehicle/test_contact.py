"""Contact with uneven ground, Eqs. (5)-(7): planes, contact points and camber in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_equations import RoadPlane, wheel_contact

from omni_sim.vehicle.uneven_ground import plane_of_points

ANGLES = st.floats(-math.pi, math.pi)
GRADES = st.floats(-0.5, 0.5)


def road_plane(
    ground: Callable[[float, float], float],
    x: float,
    y: float,
    heading: float = 0.0,
    distance: float = 0.05,
) -> RoadPlane:
    """Return the road plane of any ground; `road_plane_at` supports analytic grounds only."""
    cos, sin = math.cos(heading), math.sin(heading)
    d_x, d_y = distance * cos, distance * sin
    z, forward, left, up = plane_of_points(
        ground(x + d_x, y + d_y),
        ground(x - d_x, y - d_y),
        ground(x - d_y, y + d_x),
        ground(x + d_y, y - d_x),
        distance,
    )
    normal = np.array([cos * forward - sin * left, sin * forward + cos * left, up])
    return RoadPlane(np.array([x, y, z]), normal)


@given(GRADES, GRADES, ANGLES, st.floats(0.01, 1.0))
def test_plane_of_a_plane_is_that_plane(
    along_x: float, along_y: float, heading: float, distance: float
) -> None:
    plane = road_plane(lambda x, y: 0.3 + along_x * x + along_y * y, 2.0, -1.0, heading, distance)
    normal = np.array([-along_x, -along_y, 1.0])
    np.testing.assert_allclose(plane.normal, normal / np.linalg.norm(normal), atol=1e-12)
    expected = [2.0, -1.0, 0.3 + 2.0 * along_x - along_y]
    np.testing.assert_allclose(plane.point, expected, rtol=1e-7, atol=1e-12)


@given(ANGLES)
def test_normal_of_a_sphere_points_away_from_its_center(heading: float) -> None:
    radius = 10.0
    x, y = 3.0, -2.0
    plane = road_plane(
        lambda x, y: math.sqrt(radius**2 - x * x - y * y), x, y, heading, distance=1e-3
    )
    outward = np.array([x, y, math.sqrt(radius**2 - x * x - y * y)]) / radius
    np.testing.assert_allclose(plane.normal, outward, atol=1e-7)


def test_plane_smooths_a_step() -> None:
    plane = road_plane(lambda x, _: 0.02 if x > 0.0 else 0.0, 0.0, 0.0, distance=0.05)
    assert plane.normal[0] / plane.normal[2] == pytest.approx(-0.02 / 0.1)
    assert plane.normal[1] == 0.0


@given(GRADES, GRADES, ANGLES, st.floats(-0.4, 0.4), st.floats(0.15, 0.4))
def test_contact_point_is_where_wheel_plane_and_road_meet_nearest_to_the_hub(
    along_x: float, along_y: float, heading: float, lean: float, height: float
) -> None:
    plane = road_plane(lambda x, y: along_x * x + along_y * y, 0.0, 0.0)
    center = np.array([0.0, 0.0, height])
    axis = np.array(
        [
            -math.sin(heading) * math.cos(lean),
            math.cos(heading) * math.cos(lean),
            math.sin(lean),
        ]
    )
    contact = wheel_contact(center, axis, plane)
    reach = center - contact.point
    assert reach @ axis == pytest.approx(0.0, abs=1e-12)
    assert (contact.point - plane.point) @ plane.normal == pytest.approx(0.0, abs=1e-12)
    assert contact.longitudinal @ axis == pytest.approx(0.0, abs=1e-12)
    assert contact.longitudinal @ plane.normal == pytest.approx(0.0, abs=1e-12)
    assert contact.longitudinal @ [math.cos(heading), math.sin(heading), 0.0] > 0.0
    assert contact.static_radius == pytest.approx(float(np.linalg.norm(reach)))
    # Of all points of the line in which the planes meet, P is the nearest to the hub.
    assert reach @ contact.longitudinal == pytest.approx(0.0, abs=1e-12)
    frame = np.array([contact.longitudinal, contact.lateral, contact.normal])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)
    # Camber turns the road's lateral direction into the wheel axis, about e_x.
    turned = math.cos(contact.camber) * contact.lateral + math.sin(contact.camber) * plane.normal
    np.testing.assert_allclose(turned, axis, atol=1e-9)


def test_wheel_on_its_side_or_buried_is_refused() -> None:
    plane = road_plane(lambda *_: 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="side"):
        wheel_contact((0.0, 0.0, 0.2), (0.0, 0.0, 1.0), plane)
    with pytest.raises(ValueError, match="above"):
        wheel_contact((0.0, 0.0, -0.2), (0.0, 1.0, 0.0), plane)


def static_contact_offset(camber: float, width: float, deflection: float) -> float:
    """Return the sideways offset ``y_Q`` of the static contact point [m], Eq. (7).

    The offset is along ``e_y`` from the geometric contact point. The pressure of a cambered tire
    is largest where its deflection is largest.

    Args:
        camber: ``beta`` [rad].
        width: width ``b`` of the tire [m].
        deflection: deflection of the tire in the middle of its width, ``Delta z`` [m].

    Raises:
        ValueError: the tire does not touch the ground over its whole width, as (7) supposes.
    """
    if not 2.0 * deflection > width * abs(math.tan(camber)):
        raise ValueError(
            f"deflected by {deflection:.3g} m, a tire of width {width:.3g} m and camber "
            f"{camber:.3g} rad does not touch the ground over its whole width"
        )
    return -width * width / (12.0 * deflection) * math.tan(camber) / math.cos(camber)


@given(st.floats(-0.1, 0.1), st.floats(0.02, 0.1), st.floats(0.006, 0.02))
def test_static_contact_point_is_the_center_of_pressure(
    camber: float, width: float, deflection: float
) -> None:
    # Springs side by side over the width; the one at s along the wheel axis reaches s sin(beta)
    # higher than the middle, so it is pressed in by s tan(beta) less along the wheel plane.
    s = (np.arange(4000) + 0.5) / 4000 * width - 0.5 * width
    pressure = deflection - s * math.tan(camber)
    center = float(pressure @ s / pressure.sum())
    along_road = center / math.cos(camber)
    assert static_contact_offset(camber, width, deflection) == pytest.approx(
        along_road, rel=1e-6, abs=1e-15
    )


def test_static_contact_point_of_a_tire_on_its_edge_is_refused() -> None:
    with pytest.raises(ValueError, match="whole width"):
        static_contact_offset(0.3, 0.1, 0.01)
