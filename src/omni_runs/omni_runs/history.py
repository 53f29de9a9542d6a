"""Time histories of a run, from a recording or from a run in one process.

Every array has one row per control stamp, and a missing value is NaN. Both sources give
bit-identical results, because both use the same arithmetic: a recording contains the heading as the
quaternion of `quaternion_from_yaw`, so the heading of a run in one process is converted to this
quaternion and back.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_brake_assist.conditions import INACTIVE, SLOW
from omni_core.geometry import turned
from omni_core.quantities import BoolArray, FloatArray, IntArray
from omni_core.signals import UNMEASURED_VARIANCE
from omni_core.topics import DECLARED, PER_WHEEL, Signal, Topic


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunHistory:
    """Time histories of one run, T control stamps and N wheels.

    Histories are created by `from_samples` and `from_quaternions`. The arrays are read-only.

    Attributes:
        wheel_names: names of the wheels, in the order of the columns.
        stamp_ns: control stamps from the start of the run [ns], strictly increasing, shape (T,).
        pose: x, y, yaw of `base_link` in `odom` [m, m, rad], yaw without jumps, shape (T, 3).
        twist: true v_x, v_y, yaw rate of `base_link` in the body frame [m/s, m/s, rad/s], shape (T,
            3).
        wheel_angle: rotation of each wheel [rad], shape (T, N).
        wheel_speed: rotational speed of each wheel [rad/s], shape (T, N).
        brake_torque: torque of each brake [N m], shape (T, N).
        enable: brake enable of each wheel [1], 1 for the full pressure, 0 for a freely rolling
            wheel, shape (T, N).
        error: control error of each wheel, from the control law [m/s], shape (T, N). With the
            sliding-mode law, it is ``s_i`` of Eq. (44) of the dissertation.
        pedal: brake demand of the driver, 0 to 1, shape (T,).
        estimate: twist measured by the odometry in the body frame [m/s, m/s, rad/s], shape (T, 3).
        estimate_variance: variances of `estimate` [m^2/s^2, m^2/s^2, rad^2/s^2], shape (T, 3).
        assist_state: state of the brake assistant at each stamp, a value of `AssistState`; an empty
            text, or no entries, if it is unknown.
        real_time_factor: ratio of simulated to elapsed time [1], NaN if unknown.

    Raises:
        ValueError: shapes do not fit together, or stamps do not increase.
    """

    wheel_names: tuple[str, ...]
    stamp_ns: IntArray
    pose: FloatArray
    twist: FloatArray
    wheel_angle: FloatArray
    wheel_speed: FloatArray
    brake_torque: FloatArray
    enable: FloatArray
    error: FloatArray
    pedal: FloatArray
    estimate: FloatArray
    estimate_variance: FloatArray
    assist_state: tuple[str, ...] = ()
    real_time_factor: float = math.nan

    def __post_init__(self) -> None:
        stamps = len(self.stamp_ns)
        if stamps == 0:
            raise ValueError("a history needs at least one stamp")
        if np.any(np.diff(self.stamp_ns) <= 0):
            raise ValueError("the stamps of a history must increase")
        for name in SIGNALS:
            array: NDArray[Any] = getattr(self, name)
            columns = self.columns(name)
            shape = (stamps, len(columns)) if columns else (stamps,)
            if array.shape != shape:
                raise ValueError(f"{name} has shape {array.shape}, must be {shape}")
            array.flags.writeable = False
        if self.assist_state and len(self.assist_state) != stamps:
            raise ValueError(f"assist_state has {len(self.assist_state)} entries, must be {stamps}")

    def columns(self, name: str) -> tuple[str, ...]:
        """Return the column names of a signal; empty for a signal with a single column."""
        components = SIGNALS[name]
        return self.wheel_names if components == PER_WHEEL else components

    @classmethod
    def from_samples(cls, *, pose: ArrayLike, **samples: Any) -> RunHistory:
        """Create a history from the samples of a run in one process.

        Args:
            pose: x, y, yaw of `base_link` in `odom` [m, m, rad], shape (T, 3).
            **samples: arguments of `from_quaternions` except `position` and `orientation`.
        """
        rows = np.array(pose, dtype=np.float64).reshape(-1, 3)
        orientation = [quaternion_from_yaw(yaw) for yaw in rows[:, 2].tolist()]
        return cls.from_quaternions(position=rows[:, :2], orientation=orientation, **samples)

    @classmethod
    def from_quaternions(
        cls,
        *,
        position: ArrayLike,
        orientation: ArrayLike,
        wheel_names: Sequence[str],
        assist_state: Sequence[str] = (),
        real_time_factor: float = math.nan,
        **samples: ArrayLike,
    ) -> RunHistory:
        """Create a history from samples whose heading is given as (q_z, q_w), as in a recording.

        Rows of the estimate that were not measured become NaN. These are rows with a component that
        is not finite, or with a variance of at least `UNMEASURED_VARIANCE`.

        Args:
            position: x, y of `base_link` in `odom` [m], shape (T, 2).
            orientation: (q_z, q_w) of `quaternion_from_yaw`, shape (T, 2).
            wheel_names: names of the N wheels.
            assist_state: state of the brake assistant at each stamp, if known.
            real_time_factor: ratio of simulated to elapsed time [1].
            **samples: the other attributes of `RunHistory`; without odometry, `estimate` and
                `estimate_variance` are omitted.

        Raises:
            ValueError: shapes do not fit together, or stamps do not increase.
        """
        place = np.array(position, dtype=np.float64).reshape(-1, 2)
        quaternion = np.array(orientation, dtype=np.float64).reshape(-1, 2)
        nothing = np.full((len(place), 3), np.nan)
        samples = dict.fromkeys(("estimate", "estimate_variance"), nothing) | samples
        signals = {name: np.array(rows, dtype=np.float64) for name, rows in samples.items()}
        variance, measured = signals["estimate_variance"], signals["estimate"]
        usable = np.isfinite(measured) & np.isfinite(variance) & (variance < UNMEASURED_VARIANCE)
        blind = ~np.all(usable, axis=-1)
        measured[blind] = np.nan
        variance[blind] = np.nan
        whole: dict[str, Any] = {"stamp_ns": np.array(samples["stamp_ns"], dtype=np.int64)}
        return cls(
            wheel_names=tuple(wheel_names),
            pose=np.column_stack((place, continuous_yaw(quaternion))),
            assist_state=tuple(assist_state),
            real_time_factor=real_time_factor,
            **signals | whole,
        )

    @property
    def time(self) -> FloatArray:
        """Control stamps as times since the start of the run [s], shape (T,)."""
        return np.asarray(self.stamp_ns * 1e-9, dtype=np.float64)

    @property
    def measured(self) -> BoolArray:
        """Whether the odometry measured all three components of the twist, shape (T,)."""
        return np.asarray(np.all(np.isfinite(self.estimate), axis=1))

    @property
    def brake_start(self) -> int | None:
        """Index of the first stamp with the pedal down; None if the pedal is never down."""
        pressed = np.flatnonzero(self.pedal > 0.0)
        return int(pressed[0]) if pressed.size else None

    @property
    def braking_time(self) -> FloatArray:
        """Time since the start of braking [s], shape (T,).

        If the pedal is never down, the time is counted from the first stamp.
        """
        stamps = self.stamp_ns - self.stamp_ns[self.brake_start or 0]
        return np.asarray(stamps * 1e-9, dtype=np.float64)

    @property
    def orientation_change(self) -> float:
        """Magnitude of the change of yaw from the start of braking to the end [deg]."""
        return abs(math.degrees(self.pose[-1, 2] - self.pose[self.brake_start or 0, 2]))

    @property
    def stopping_distance(self) -> float:
        """Straight-line distance from the start of braking to the final position [m]."""
        return math.hypot(*(self.pose[-1, :2] - self.pose[self.brake_start or 0, :2]))

    @property
    def velocity_world(self) -> FloatArray:
        """True velocity of `base_link` in `odom` [m/s], shape (T, 2)."""
        return turned(self.twist[:, :2], self.pose[:, 2])


@dataclasses.dataclass(frozen=True, kw_only=True)
class FastRun(RunHistory):
    """Time histories of a run of the fast loop, without odometry and details of the assistant.

    Attributes:
        feedback: twist that the brake assistant received [m/s, m/s, rad/s], shape (T, 3).
        condition: state of the assistant, an index of `conditions.CONDITIONS`, shape (T,).
        energy: kinetic energy of body and wheels plus elastic energy of the tires [J], shape (T,).
        stopped: whether the vehicle came to rest within the limit on the duration of the run.
        tipping_steps: number of physics steps in which a real vehicle would have begun to tip over.
        failed: index of the wheel whose brake the assistant reports as failed at the end of the
            run; -1 for none.
    """

    feedback: FloatArray
    condition: IntArray
    energy: FloatArray
    stopped: bool
    tipping_steps: int
    failed: int

    @property
    def valid(self) -> BoolArray:
        """Whether all inputs were valid, so that brakes could be released, shape (T,)."""
        return (self.condition <= INACTIVE) | (self.condition >= SLOW)


_ARRAYS = {field.name for field in dataclasses.fields(RunHistory)}
SOURCES: Mapping[str, tuple[Topic, Signal]] = {
    one.name: (topic, one) for topic in DECLARED for one in topic.signals if one.name in _ARRAYS
}
"""Topic and signal of each array of a history, except the stamps."""

SIGNALS: Mapping[str, tuple[str, ...]] = {
    "stamp_ns": (),
    **{name: signal.columns for name, (_, signal) in SOURCES.items()},
}
"""Names of the columns of each array of a history; see `RunHistory.columns`."""


def quaternion_from_yaw(yaw: float) -> tuple[float, float]:
    """Return (q_z, q_w) of a heading [rad], bit-identical to the values in recordings.

    The module `math` is used because numpy's vectorized sine may differ in the last bit.
    """
    return math.sin(0.5 * yaw), math.cos(0.5 * yaw)


def continuous_yaw(orientation: FloatArray) -> FloatArray:
    """Return headings [rad] without jumps, computed from (q_z, q_w).

    Args:
        orientation: (q_z, q_w), with less than half a turn between rows, shape (T, 2).

    Returns:
        Headings, the first in (-pi, pi], shape (T,).
    """
    half_turns = [math.atan2(q_z, q_w) for q_z, q_w in orientation.tolist()]
    return without_jumps(2.0 * np.array(half_turns))


def without_jumps(yaw: FloatArray) -> FloatArray:
    """Return headings [rad] without jumps by full turns, the first in (-pi, pi], shape (T,)."""
    if np.any(np.abs(np.diff(yaw)) > math.pi):  # most runs need no slow `unwrap`
        yaw = np.unwrap(yaw)
    turns = math.ceil((float(yaw[0]) - math.pi) / math.tau) if yaw.size else 0
    return np.asarray(yaw - math.tau * turns)
