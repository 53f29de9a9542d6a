"""Histories in closed form, for the tests of several packages."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from omni_runs.history import SIGNALS, RunHistory

PERIOD_NS = 10_000_000
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")


def straight_stop(  # one argument for each property of the run that some test varies
    *,
    speed: float = 10.0,
    deceleration: float = 5.0,
    brakes_at: float = 0.5,
    heading: float = 0.0,
    turn: float = 0.0,
    wheel_names: tuple[str, ...] = WHEELS,
    rest: float = 0.5,
    **replaced: Any,
) -> RunHistory:
    """Return a vehicle that drives straight, then stops at a constant deceleration.

    Args:
        speed: speed before braking [m/s].
        deceleration: constant deceleration [m/s^2].
        brakes_at: time at which the pedal goes down [s].
        heading: direction of the motion in `odom` [rad].
        turn: yaw from the start of braking to rest, at a constant rate [rad].
        wheel_names: names of the wheels.
        rest: duration of the history after the stop [s].
        **replaced: arguments of `RunHistory.from_samples` to use instead.
    """
    braking = speed / deceleration
    stamp_ns = np.arange(round((brakes_at + braking + rest) * 100) + 1) * PERIOD_NS
    time = stamp_ns * 1e-9
    tau = np.clip(time - brakes_at, 0.0, braking)
    distance = speed * np.minimum(time, brakes_at) + speed * tau - deceleration * tau**2 / 2.0
    yaw = heading + turn * tau / braking
    moving = (time > brakes_at - 1e-9) & (time < brakes_at + braking - 1e-9)
    velocity = speed - deceleration * tau
    twist = np.column_stack(
        (
            velocity * np.cos(heading - yaw),
            velocity * np.sin(heading - yaw),
            np.where(moving, turn / braking, 0.0),
        )
    )
    shape = len(time), len(wheel_names)
    values: dict[str, Any] = {
        "wheel_names": wheel_names,
        "stamp_ns": stamp_ns,
        "pose": np.column_stack((distance * math.cos(heading), distance * math.sin(heading), yaw)),
        "twist": twist,
        "wheel_angle": np.outer(time, np.arange(1, shape[1] + 1)),
        "wheel_speed": np.outer(velocity, np.arange(1, shape[1] + 1)) / 3.0,
        "brake_torque": np.full(shape, 100.0),
        "enable": np.ones(shape),
        "error": np.outer(velocity, np.sin(np.arange(shape[1]) + 1.0)),
        "pedal": (time >= brakes_at - 1e-9).astype(float),
        "estimate": twist + 0.01,
        "estimate_variance": np.full((len(time), 3), 1e-4),
    }
    return RunHistory.from_samples(**{**values, **replaced})


@pytest.fixture
def make_history() -> Callable[..., RunHistory]:
    """Return `straight_stop`."""
    return straight_stop


def first_difference(a: RunHistory, b: RunHistory) -> str | None:
    """Return a description of the first difference of two histories, None if all bits are equal.

    NaN equals NaN. The real-time factor and the states of the assistant are not compared.
    """
    if a.wheel_names != b.wheel_names:
        return f"the wheels are {', '.join(a.wheel_names)} against {', '.join(b.wheel_names)}"
    common = min(len(a.stamp_ns), len(b.stamp_ns))
    earliest: tuple[int, str] | None = None
    for name in SIGNALS:
        left, right = getattr(a, name)[:common], getattr(b, name)[:common]
        different = np.argwhere(_different_bits(left, right))
        if different.size and (earliest is None or different[0][0] < earliest[0]):
            place = tuple(int(index) for index in different[0])
            what = f"{name}{_column_in_words(a.columns(name), place)}"
            values = f"{left[place]!r} against {right[place]!r}"
            earliest = place[0], f"{what} at {a.stamp_ns[place[0]] * 1e-9:.3f} s is {values}"
    if earliest is not None:
        return earliest[1]
    if len(a.stamp_ns) != len(b.stamp_ns):
        return f"there are {len(a.stamp_ns)} stamps against {len(b.stamp_ns)}"
    return None


def _different_bits(a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.bool_]:
    different: NDArray[np.bool_] = a.view(np.uint64) != b.view(np.uint64)
    if a.dtype.kind == "f":
        different &= ~(np.isnan(a) & np.isnan(b))
    return different


def _column_in_words(columns: Sequence[str], place: tuple[int, ...]) -> str:
    return f" of {columns[place[1]]}" if len(place) > 1 else ""
