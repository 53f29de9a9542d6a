"""Batches of camera lines along a trajectory, rendered in a background thread.

Line j is exposed at the time j / line rate. Its time is compared with control stamps in integer
arithmetic, so no line is lost or duplicated at the boundary between two control periods. The poses
are interpolated between the physics steps.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from functools import partial

import numpy as np

from omni_core.background import in_background
from omni_core.geometry import turned
from omni_core.kernels import lean
from omni_core.quantities import SECOND_NS, FloatArray
from omni_core.sensors import LineSensor
from omni_core.signals import LineBatch
from omni_sim.camera.camera import LineCameraArray

_SLACK = 1e-6  # share of a step by which rounded times may be outside the trajectory


def interpolate_poses(
    trajectory: FloatArray, start_ns: float, step_ns: float, times_ns: FloatArray
) -> FloatArray:
    """Return poses between physics steps by cubic Hermite interpolation.

    The interpolated path has the given position and velocity at every step, so it is smooth. Its
    error is of fourth order in the length of the step, and negligible for the steps of the
    simulation.

    Args:
        trajectory: x, y, yaw [m, m, rad] and their time derivatives in the world frame at uniform
            steps, shape (n + 1, 6); yaw is continuous, not wrapped. A single row is valid only for
            its own time.
        start_ns: time of the first row [ns].
        step_ns: time between rows [ns].
        times_ns: times of the requested poses [ns], shape (m,).

    Returns:
        x, y, yaw, shape (m, 3) [m, m, rad].

    Raises:
        ValueError: a time is outside the trajectory.
    """
    poses = np.empty((len(times_ns), 3))
    rows = np.ascontiguousarray(trajectory)
    if not _interpolate(rows, float(start_ns), float(step_ns), times_ns, poses):
        raise ValueError(
            f"times from {times_ns.min()} ns to {times_ns.max()} ns are outside the trajectory, "
            f"{start_ns} ns to {start_ns + (len(trajectory) - 1) * step_ns} ns"
        )
    return poses


@lean
def _interpolate(
    trajectory: FloatArray, start_ns: float, step_ns: float, times_ns: FloatArray, poses: FloatArray
) -> bool:
    """Write the poses to `poses`; return whether all times are within the trajectory.

    The other arguments are those of `interpolate_poses`; `poses` has the shape (m, 3).
    """
    steps = len(trajectory) - 1
    step = step_ns * 1e-9
    for i in range(len(times_ns)):
        place = (times_ns[i] - start_ns) / step_ns
        if not -_SLACK <= place <= steps + _SLACK:
            return False
        index = max(min(int(place), steps - 1), 0)
        t = place - index
        before, after = trajectory[index], trajectory[min(index + 1, steps)]
        # Hermite basis functions of value and slope at both ends.
        rise = t * t * (3.0 - 2.0 * t)
        slope = step * t * (1.0 - t)
        for k in range(3):
            value = before[k] + rise * (after[k] - before[k])
            poses[i, k] = value + slope * ((1.0 - t) * before[3 + k] - t * after[3 + k])
    return True


def interpolate_velocities(
    trajectory: FloatArray, start_ns: float, step_ns: float, times_ns: FloatArray
) -> FloatArray:
    """Return velocities between physics steps by linear interpolation.

    Args:
        trajectory: x, y, yaw and their time derivatives at uniform steps, shape (n + 1, 6).
        start_ns: time of the first row [ns].
        step_ns: time between rows [ns].
        times_ns: times of the requested velocities [ns], shape (m,).

    Returns:
        Time derivatives of x, y, yaw in the world frame [m/s, m/s, rad/s], shape (m, 3).
    """
    place = (np.asarray(times_ns, dtype=np.float64) - start_ns) / step_ns
    rows = np.arange(len(trajectory))
    return np.column_stack([np.interp(place, rows, trajectory[:, 3 + i]) for i in range(3)])


class LineClock:
    """Times of the lines of one camera.

    Attributes:
        period_ns: exact line period as a fraction [ns].
    """

    def __init__(self, line_rate: float) -> None:
        """Create the clock for the line rate of a camera.

        Args:
            line_rate: line rate [1/s]; the exact value of the float is used.

        Raises:
            ValueError: the rate is not finite or not above zero.
        """
        if not (math.isfinite(line_rate) and line_rate > 0.0):
            raise ValueError(f"a line rate must be above 0 1/s, not {line_rate}")
        self.period_ns = Fraction(SECOND_NS) / Fraction(line_rate)

    def lines_in(self, after_ns: int, until_ns: int) -> tuple[int, int]:
        """Return the index of the first line in an interval, and the index after the last line.

        Args:
            after_ns: start of the interval, not included [ns]; -1 includes line 0.
            until_ns: end of the interval, included [ns].
        """
        return self._count_until(after_ns), self._count_until(until_ns)

    def stamp_ns(self, line: int) -> int:
        """Return the time of the line with index `line` [ns], rounded to an integer."""
        return round(line * self.period_ns)

    def times_ns(self, first: int, end: int) -> FloatArray:
        """Return the times of the m lines ``first <= j < end`` [ns], not rounded, shape (m,)."""
        period, divisor = self.period_ns.numerator, self.period_ns.denominator
        return np.array([line * period / divisor for line in range(first, end)], dtype=np.float64)

    def _count_until(self, stamp_ns: int) -> int:
        """Return the number of lines from time 0 up to and including a stamp [ns]."""
        if stamp_ns < 0:
            return 0
        return stamp_ns * self.period_ns.denominator // self.period_ns.numerator + 1


def carried_path(
    trajectory: FloatArray, sensor: LineSensor, angles: tuple[float, float], duration: float
) -> FloatArray:
    """Return the trajectory of a body to which a camera on a steered carrier would be fixed.

    This body turns with the carrier about the steering axis. The steering angle changes linearly.

    Args:
        trajectory: x, y, yaw of base_link [m, m, rad] and their time derivatives at uniform steps,
            shape (n + 1, 6).
        sensor: the camera.
        angles: steering angles at the start and at the end [rad].
        duration: time from start to end [s].
    """
    carried, yaw = trajectory.copy(), trajectory[:, 2]
    angle = np.linspace(*angles, len(trajectory))
    rate = (angles[1] - angles[0]) / duration
    carried[:, 2] += angle
    carried[:, 5] += rate
    axis = np.tile((sensor.carrier_x, sensor.carrier_y), (len(yaw), 1))
    before, after = turned(axis, yaw), turned(axis, yaw + angle)
    carried[:, :2] += before - after  # the steering axis keeps its place
    left = np.array([-1.0, 1.0])
    carried[:, 3:5] += left * (before * trajectory[:, 5:] - after * carried[:, 5:])[:, ::-1]
    return carried


_Exposure = tuple[int, FloatArray, FloatArray | None]
"""Stamp of the newest line [ns]; poses of all lines; velocities of all lines, None for no blur."""


class LineExposures:
    """Renders the lines of all cameras, one control period after another.

    Attributes:
        cameras: the cameras.
    """

    def __init__(self, cameras: LineCameraArray, step_ns: float, *, blurred: bool) -> None:
        """Start the clocks of the cameras at time 0.

        Args:
            cameras: simulated cameras.
            step_ns: time between two rows of a trajectory [ns].
            blurred: whether to compute the velocities that motion blur requires.
        """
        self.cameras = cameras
        self._step_ns = step_ns
        self._blurred = blurred
        rates = {camera.sensor.line_rate for camera in cameras.cameras.values()}
        self._clocks = {rate: LineClock(rate) for rate in rates}
        self._batches = _Batches({}, cameras)

    def expose(
        self,
        trajectory: FloatArray,
        start_ns: int,
        end_ns: int,
        steering: Mapping[str, tuple[float, float]],
        clearance: Callable[[float, float], float],
    ) -> Mapping[str, LineBatch]:
        """Return the lines that each camera exposes between a start time and an end time.

        The lines are rendered in the background or when they are read, at the latest in the next
        call: the noise of a line depends on the number of earlier lines, so no line is skipped.

        Args:
            trajectory: trajectory from `Vehicle.advance`, shape (n + 1, 6).
            start_ns: start time, that of the trajectory's first row, not included [ns]; -1 to
                include the line at time 0.
            end_ns: end time, that of the trajectory's last row, included [ns].
            steering: steering angle of each carrier at both times [rad], keyed by wheel.
            clearance: function that returns the present ground clearance at a point x, y [m] of
                the body minus that at rest on flat ground [m].
        """
        for name in self._batches:
            self._batches[name]
        taken: dict[tuple[float, str], _Exposure] = {}
        exposures = {}
        duration = 1e-9 * self._step_ns * max(len(trajectory) - 1, 1)
        for name, camera in self.cameras.cameras.items():
            sensor, path = camera.sensor, trajectory
            camera.rise = clearance(sensor.x, sensor.y)
            key = sensor.line_rate, sensor.carrier
            if key not in taken:
                if sensor.carrier:
                    path = carried_path(path, sensor, steering[sensor.carrier], duration)
                taken[key] = self._exposure(sensor.line_rate, path, start_ns, end_ns)
            exposures[name] = taken[key]
        self._batches = _Batches(exposures, self.cameras)
        return self._batches

    def _exposure(
        self, rate: float, trajectory: FloatArray, start_ns: int, end_ns: int
    ) -> _Exposure:
        """Return the exposure of all lines at a line rate [1/s]; see `expose`."""
        clock = self._clocks[rate]
        first, last = clock.lines_in(start_ns, end_ns)
        along = (trajectory, max(start_ns, 0), self._step_ns, clock.times_ns(first, last))
        velocities = interpolate_velocities(*along) if self._blurred else None
        return clock.stamp_ns(last - 1), interpolate_poses(*along), velocities


class _Batches(Mapping[str, LineBatch]):
    """Lines of each camera in one control period, keyed by the name of the camera.

    A background thread renders the lines of one camera after another. If the lines of a camera are
    read before the thread has begun to render them, the reader renders them. The odometry can
    therefore process the lines of one camera while the lines of another camera are rendered.
    """

    def __init__(self, exposures: Mapping[str, _Exposure], cameras: LineCameraArray) -> None:
        # The background thread starts with the last camera, because readers start with the first
        # one.
        self._rendering = {
            name: in_background(partial(_render, cameras, name, exposures[name]))
            for name in reversed(tuple(exposures))
        }
        self._names = tuple(exposures)
        self._made: dict[str, LineBatch] = {}

    def __getitem__(self, name: str) -> LineBatch:
        if name not in self._made:
            self._made[name] = self._rendering[name]()
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def _render(cameras: LineCameraArray, name: str, exposure: _Exposure) -> LineBatch:
    stamp_ns, poses, velocities = exposure
    return LineBatch(stamp_ns, cameras.render_next(name, poses, velocities))
