"""The assistant brakes a minimal vehicle: a planar rigid body with Coulomb friction.

A braked wheel locks at once and slides with ``mu N`` along its active direction; a released one
rolls freely at once. Real wheels are easier to control, because their inertia smooths
the switching.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand
from omni_brake_assist.conditions import AssistState
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_core.geometry import PlatformGeometry, WheelMount, cross
from omni_core.quantities import FloatArray
from omni_core.signals import TwistSample

Wheels = dict[str, WheelMount]
PERIOD_NS = 10_000_000
STEPS_A_PERIOD = 20
BRAKING_FROM = 5  # period


class Vehicle:
    """State of the center of gravity in the world frame: position, yaw, velocity, yaw rate."""

    mass, friction, gravity = 800.0, 0.7, 9.81
    rubbing_speed = 0.05  # [m/s] over which friction builds up, so that it can end at rest

    def __init__(
        self, wheels: Wheels, load: tuple[float, float], radius_of_gyration: float, v: FloatArray
    ) -> None:
        geometry = PlatformGeometry.from_wheels(wheels)
        self.center = np.array(load)
        self.inertia = self.mass * radius_of_gyration**2
        balance = np.vstack((np.ones(len(geometry.names)), geometry.position.T))
        weight = self.mass * self.gravity
        wheel_load = weight * np.linalg.pinv(balance) @ np.array([1.0, *load])
        assert np.all(wheel_load > 0.0)
        self.limit = self.friction * wheel_load
        self.active = geometry.active
        self.lever = cross(geometry.position - self.center, geometry.active)
        self.velocity, self.yaw_rate = v.astype(np.float64), 0.0
        self.position, self.yaw = np.zeros(2), 0.0

    @property
    def energy(self) -> float:
        """Kinetic energy [J], Eq. (48)."""
        linear = self.mass * float(self.velocity @ self.velocity)
        return (linear + self.inertia * self.yaw_rate**2) / 2

    def _in_body(self, vector: FloatArray) -> FloatArray:
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return np.array([c * vector[0] + s * vector[1], c * vector[1] - s * vector[0]])

    def twist(self) -> FloatArray:
        """TwistSample of the geometric center in the body frame [m/s, m/s, rad/s], shape (3,)."""
        v_x, v_y = self._in_body(self.velocity)
        x, y = self.center
        return np.array([v_x + self.yaw_rate * y, v_y - self.yaw_rate * x, self.yaw_rate])

    def step(self, enable: FloatArray, dt: float) -> None:
        """Advance by `dt` [s]."""
        sliding = self.active @ self._in_body(self.velocity) + self.lever * self.yaw_rate
        force = -enable * self.limit * np.clip(sliding / self.rubbing_speed, -1.0, 1.0)
        f_x, f_y = force @ self.active
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        acceleration = np.array([c * f_x - s * f_y, s * f_x + c * f_y]) / self.mass
        self.velocity = self.velocity + dt * acceleration
        self.yaw_rate += dt * float(force @ self.lever) / self.inertia
        self.position = self.position + dt * self.velocity
        self.yaw += dt * self.yaw_rate


@dataclasses.dataclass(frozen=True)
class Stop:
    """Result of a stop."""

    orientation_change: float  # [deg]
    lateral_deviation: float  # [m]
    distance: float  # [m]
    stopped: bool
    energy_gain: float  # largest of any period [J]
    switchings: float  # per wheel
    states: frozenset[AssistState]


def brake(
    wheels: Wheels,
    velocity: tuple[float, float],
    *,
    load: tuple[float, float],
    radius_of_gyration: float = 0.6,
    measure: Callable[[FloatArray, int], TwistSample | None] | None = None,
    **settings: Any,
) -> Stop:
    """Brake until the vehicle is at rest, for at most 10 s."""
    vehicle = Vehicle(wheels, load, radius_of_gyration, np.array(velocity))
    # The vehicle has neither wheel speeds nor an IMU: only law and gate are tested.
    assist = BrakeAssist(BrakeAssistConfiguration(wheels=wheels, fault_detection=False, **settings))
    along = np.array(velocity) / math.hypot(*velocity)
    gains, states, enables = [], set(), []
    start = vehicle.position
    for period in range(1000):
        stamp_ns = period * PERIOD_NS
        twist = vehicle.twist()
        feedback = (
            TwistSample(stamp_ns, twist, 1e-6 * np.eye(3))
            if measure is None
            else measure(twist, stamp_ns)
        )
        braking = period >= BRAKING_FROM
        if period == BRAKING_FROM:
            start = vehicle.position
        decision = assist.update(BrakeDemand(stamp_ns, float(braking), feedback))
        energy = vehicle.energy
        for _ in range(STEPS_A_PERIOD):
            vehicle.step(decision.enable * braking, 0.01 / STEPS_A_PERIOD)
        if braking:
            gains.append(vehicle.energy - energy)
            enables.append(decision.enable)
            states.add(decision.state)
        if vehicle.energy < 1e-3:
            break
    path = vehicle.position - start
    return Stop(
        orientation_change=math.degrees(vehicle.yaw),
        lateral_deviation=float(along[0] * path[1] - along[1] * path[0]),
        distance=float(along @ path),
        stopped=vehicle.energy < 1e-3,
        energy_gain=max(gains),
        switchings=float(np.sum(np.abs(np.diff(enables, axis=0))) / len(wheels)),
        states=frozenset(states),
    )


FRONT_LEFT = (0.1, 0.12)
ZERO: dict[str, Any] = {"weighting": "zero"}
ENHANCED: dict[str, Any] = {"weighting": "enhanced", "k": 7}
OFF: dict[str, Any] = {"enabled": False}


@pytest.fixture(scope="module")
def straight(mecanum: Wheels) -> Callable[..., Stop]:
    """Straight braking from 10 m/s with the load at the front left."""
    return functools.partial(brake, mecanum, (10.0, 0.0), load=FRONT_LEFT)


def test_unassisted_vehicle_swerves(straight: Callable[..., Stop]) -> None:
    stop = straight(**OFF)
    assert stop.stopped
    assert abs(stop.orientation_change) > 25.0
    assert stop.switchings == 0.0


@pytest.mark.parametrize("settings", [ZERO, ENHANCED], ids=["zero", "enhanced"])
def test_assisted_vehicle_keeps_orientation_and_line(
    straight: Callable[..., Stop], settings: dict[str, Any]
) -> None:
    stop = straight(**settings)
    assert stop.stopped
    assert abs(stop.orientation_change) < 4.0
    assert abs(stop.lateral_deviation) < 0.1
    assert AssistState.ASSISTING in stop.states
    assert AssistState.BELOW_SPEED_THRESHOLD in stop.states
    assert not any(state.is_fault for state in stop.states)


@pytest.mark.parametrize("settings", [OFF, ZERO, ENHANCED], ids=["off", "zero", "enhanced"])
def test_braking_adds_no_energy(straight: Callable[..., Stop], settings: dict[str, Any]) -> None:
    assert straight(**settings).energy_gain <= 0.0


def test_smaller_k_trades_orientation_for_distance(straight: Callable[..., Stop]) -> None:
    seventh, first = straight(k=7), straight(k=1)
    assert abs(seventh.orientation_change) < abs(first.orientation_change)
    assert first.distance < seventh.distance


def test_turning_is_learned_from_a_noisy_biased_sensor(straight: Callable[..., Stop]) -> None:
    """The sensor has the offsets of Figure 39 and noise of 15 %, Eqs. (60), (61)."""
    rng = np.random.default_rng(4)

    def noisy(twist: FloatArray, stamp_ns: int) -> TwistSample:
        measured = twist * (1.0 + rng.uniform(-0.15, 0.15, 3)) + np.array([0.01, 0.01, 0.05])
        return TwistSample(stamp_ns, measured, 1e-3 * np.eye(3))

    stop = straight(measure=noisy, speed_noise=5.0, yaw_rate_noise=0.5, **ENHANCED)
    assert stop.stopped
    # At a measured rate of zero, the vehicle turns by -0.05 rad/s * 4.3 s = -12 deg.
    assert -15.0 < stop.orientation_change < 4.0


def test_without_any_feedback_braking_is_as_without_assistant(
    straight: Callable[..., Stop],
) -> None:
    blind = straight(measure=lambda _twist, _stamp: None, **ENHANCED)
    unassisted = straight(**OFF)
    assert blind.states == {AssistState.NO_FEEDBACK}
    assert blind.orientation_change == unassisted.orientation_change
    assert blind.distance == unassisted.distance


def test_feedback_lost_for_a_moment_is_survived(straight: Callable[..., Stop]) -> None:
    def interrupted(twist: FloatArray, stamp_ns: int) -> TwistSample | None:
        lost = 50 <= stamp_ns // PERIOD_NS < 65
        return None if lost else TwistSample(stamp_ns, twist, 1e-6 * np.eye(3))

    stop = straight(measure=interrupted, **ENHANCED)
    assert stop.states >= {AssistState.NO_FEEDBACK, AssistState.ASSISTING}
    assert stop.stopped
    # All brakes act for 0.17 s; braking then removes the yaw rate of this time.
    assert abs(stop.orientation_change) < 15.0
    assert abs(stop.lateral_deviation) < 0.3


def test_mirrored_load_stops_in_the_mirror_image(mecanum: Wheels) -> None:
    # From a drift, so that no error is zero and the brakes of the first step have a definite side.
    left = brake(mecanum, (10.0, 0.5), load=FRONT_LEFT, **ENHANCED)
    right = brake(mecanum, (10.0, -0.5), load=(FRONT_LEFT[0], -FRONT_LEFT[1]), **ENHANCED)
    assert right.orientation_change == pytest.approx(-left.orientation_change, abs=0.5)
    assert right.distance == pytest.approx(left.distance, rel=0.01)


@pytest.mark.parametrize(
    ("settings", "share"), [(ZERO, 0.2), (ENHANCED, 0.1)], ids=["zero", "enhanced"]
)
def test_three_wheels_at_45_degrees(kiwi: Wheels, settings: dict[str, Any], share: float) -> None:
    """The experiment of Figures 33-35: v_x = v_y, load off the center, a short stop."""
    run = functools.partial(brake, kiwi, (3.0, 3.0), load=(0.05, 0.05), radius_of_gyration=0.3)
    unassisted, assisted = run(**OFF), run(**settings)
    assert abs(unassisted.orientation_change) > 45.0
    assert abs(assisted.orientation_change) < share * abs(unassisted.orientation_change)
    assert abs(assisted.lateral_deviation) < abs(unassisted.lateral_deviation) / 4
    assert assisted.stopped
    assert assisted.energy_gain <= 0.0
