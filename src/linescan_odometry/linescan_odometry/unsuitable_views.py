"""Detection of unsuitable views: occluded cameras, and cameras over oblique textures.

If a camera is occluded, for example by a lid or by dirt on the lens, its lines match perfectly at
zero displacement, but so do lines of the ground at rest and in motion across the axis. A camera
therefore counts as occluded only in two cases: its view becomes constant sooner than a vehicle can
stop (at most 15 m/s^2), or its view does not change although the camera moves.

Each pixel of a line camera averages the brightness across the axis, over the width of the view. In
motion across the axis, new ground enters the view, and on ordinary ground the lines lose their
correlation after one width of the view. If the texture is oblique to the axis, the same stripes
remain in the view and shift along the line, so motion across the axis looks like motion along it. A
single camera cannot distinguish the two motions. The twist, however, gives the motion across the
axis: if a view stays correlated for longer than one width, the texture is oblique.
"""

import dataclasses
import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from linescan_odometry.measurements import WIDEST, SensorReading
from omni_core.kernels import declares, kernel
from omni_core.quantities import Float32Array, FloatArray
from omni_core.sensors import LineSensor, velocity_row
from omni_core.signals import Lines

# Share of the width; after this motion across the axis, at most half of the ground texture of a
# view remains, which no longer counts as static (`sensor.py`).
_STILL_SHARE = 0.5
_STILL_PIXELS = 2.0  # px; after this motion along the axis a view must change
_HARDEST_STOP = 15.0  # m/s^2; a hard stop on a dry road reaches 10
_CERTAIN = 4.0  # standard deviations by which a stop must be too hard
_REMEMBERED_NS = 1_280_000_000  # ns; twists are stored for this time, longer than lines (_LONGEST)
# Limit on the time without a twist over which the motion is extrapolated, and time for which the
# view of an occluded camera must change before the camera is used again [ns].
_GAP_NS = 50_000_000
_PIECE = 0.008  # m; ordinary ground leaves a view after the view's width plus this length
_FAR_ENOUGH = 0.5  # motion across the axis before a test, as a share of (view width + _PIECE)
_CLEAR_EXCESS = 0.65  # excess correlation that a single comparison does not reach by chance
_SLOWEST = 0.03  # m/s across the axis; at lower speeds, oblique texture causes no significant error
_REACH = 0.5  # share of a line; larger shifts of a view are not compared
_LONGEST = 1.0  # s; limit on the time for which a line is stored
_LEAST_SHIFT = 8.0  # px; at smaller shifts, a fixed pattern looks like an oblique texture
_SEARCHED = 3  # px searched on each side of the expected shift, plus _SEARCHED_SHARE of the shift
_SEARCHED_SHARE = 0.01
_FEWEST = 16  # smallest number of pixels for a comparison
_EXCESS = 0.35  # excess correlation that two successive comparisons do not reach by chance


class Keyframe:
    """Stores an earlier line of one camera, and compares newer lines with this line."""

    def __init__(self, pixels: int) -> None:
        """Create the comparison for one camera, without a stored line.

        Args:
            pixels: number of pixels n of a line.
        """
        self._step = 4 if pixels > 512 else 2  # px; finer detail is noise
        self._gradient: Float32Array | None = None
        self._stamp_ns = 0
        self._shift = 0.0

    def reset(self) -> None:
        """Discard the stored line."""
        self._gradient = None

    def compare(
        self, stamp_ns: int, period_ns: float, lines: Lines | Float32Array, displacement: float
    ) -> tuple[float, float]:
        """Return the age of the stored line, and how well newer lines still match it.

        A stored line is replaced by a newer one if the shift between them is too large or the
        stored line is too old.

        Args:
            stamp_ns: stamp of the newest line [ns].
            period_ns: line period [ns].
            lines: consecutive lines, oldest first, shape (m + 1, n).
            displacement: mean displacement per line [px].

        Returns:
            Two numbers, which are 0 if the view has hardly shifted. The first is the age of the
            stored line [s]. The second is the smallest correlation of this line with three lines of
            the batch, divided by the correlation of neighboring lines [1].
        """
        span = len(lines) - 1
        pixels = lines.shape[1]
        self._shift += span * displacement
        gradient = self._gradient
        if (
            gradient is None
            or abs(self._shift) > _REACH * pixels
            or not 0.0 < 1e-9 * (stamp_ns - self._stamp_ns) < _LONGEST
        ):
            first = 0
            if abs(span * displacement) > _REACH * pixels:
                first = span - max(1, int(_REACH * pixels / abs(displacement)))
            gradient = self._remember(lines[first])
            self._stamp_ns = stamp_ns - round((span - first) * period_ns)
            self._shift = (span - first) * displacement
        # A periodic ground leaves the view and returns, whereas an oblique texture never leaves it.
        # To distinguish the two, the lines in between are compared too.
        near, far = _compare(lines, self._step, self._shift, displacement, _EXCESS**2, gradient)
        persistence = max(0.0, far) / max(near, _EXCESS)
        if persistence < _EXCESS:
            self._gradient = None  # a periodic ground would match again later
        if abs(self._shift) < _LEAST_SHIFT:
            return 0.0, 0.0
        return 1e-9 * (stamp_ns - self._stamp_ns), persistence

    def _remember(self, line: Lines | Float32Array) -> Float32Array:
        gradient: Float32Array = np.empty((3, len(line) - 2 * self._step + 1), np.float32)
        _differentiate(line, self._step, gradient[0])
        self._gradient = gradient
        return gradient


@kernel
def _differentiate(line: Lines | Float32Array, step: int, gradient: Float32Array) -> None:
    """Write to `gradient`, for each position, the sum of the next `step` pixels minus the last."""
    ahead, behind = 0.0, 0.0
    for i in range(step):
        behind += line[i]
        ahead += line[i + step]
    gradient[0] = ahead - behind
    for i in range(1, gradient.shape[0]):
        middle = float(line[i + step - 1])
        behind += middle - line[i - 1]
        ahead += line[i + 2 * step - 1] - middle
        gradient[i] = ahead - behind


@declares(error_model="python", fastmath={"reassoc", "contract", "nsz"})
def _compare(
    lines: Lines | Float32Array,
    step: int,
    shift: float,
    displacement: float,
    abort_below: float,
    gradient: Float32Array,
) -> tuple[float, float]:
    """Return two correlations: of the two newest lines, and of newer lines with an earlier line.

    Instead of the lines themselves, their gradients are correlated.

    Args:
        lines: consecutive lines, oldest first, shape (m + 1, n).
        step: number of pixels in each sum of `_differentiate`.
        shift: shift of the newest line against the earlier line [px].
        displacement: displacement per line [px].
        abort_below: correlation below which the comparison is aborted.
        gradient: gradient of the earlier line in row 0, and working memory in rows 1 and 2, shape
            (3, length of a gradient).

    Returns:
        Correlation of the two newest lines, and the smallest correlation of three lines of the
        batch with the earlier line. Each correlation is the largest one near the expected shift.
    """
    span = len(lines) - 1
    backs = (1, 0, span // 5, span // 2)
    near, far = 0.0, 1.0
    for case in range(4):
        if case == 0:
            _differentiate(lines[span], step, gradient[1])
            _differentiate(lines[span - 1], step, gradient[2])
            old, new, expected = gradient[2], gradient[1], displacement
        else:
            if case > 1:
                _differentiate(lines[span - backs[case]], step, gradient[2])
            old, new = gradient[0], gradient[1 if case == 1 else 2]
            expected = shift - backs[case] * displacement
        reach = _SEARCHED + int(_SEARCHED_SHARE * abs(expected))
        best = -1.0
        for s in range(round(expected) - reach, round(expected) + reach + 1):
            count = len(new) - abs(s)
            if count < _FEWEST:
                continue
            x, y = new[max(0, -s) :][:count], old[max(0, s) :][:count]
            xx, yy, xy = np.float32(0), np.float32(0), np.float32(0)
            for i in range(count):
                xx += x[i] * x[i]
                yy += y[i] * y[i]
                xy += x[i] * y[i]
            norm = math.sqrt(float(xx) * float(yy))
            best = max(best, float(xy) / norm if norm > 0.0 else 0.0)
        if case == 0:
            near = best
        else:
            far = min(far, best)
            if far < abort_below:
                break
    return near, far


class UnsuitableViews:
    """Detects unsuitable views by comparing the view of each camera with the camera's motion."""

    def __init__(self, sensors: Mapping[str, LineSensor]) -> None:
        """Create the detection; every view is suitable, and the vehicle is assumed to be at rest.

        Args:
            sensors: cameras to watch, keyed by name; the readings of other cameras stay as they
                are.
        """
        self._sensors = sensors
        # Rows that convert the twist to the velocity along and across each camera's axis; the
        # velocity across it is positive to the left.
        self._rows = {
            name: np.array(
                [velocity_row(s.x, s.y, s.heading + turn) for turn in (0.0, math.pi / 2)]
            )
            for name, s in sensors.items()
        }
        self._stamps: deque[int] = deque()
        self._paths: deque[FloatArray] = deque()  # distance across each axis [m]
        self._found: dict[str, str] = {}  # cameras over oblique textures, with the reasons
        self._before: dict[str, tuple[float, float]] = {}  # last persistence and its excess
        self._excess: dict[str, float] = {}  # the smaller of the last two excesses
        self._start_anew()

    def _start_anew(self) -> None:
        self._covered: dict[str, str] = {}
        self._static_ns: dict[str, int] = {}  # stamps at which views last were constant [ns]
        self._twist: FloatArray = np.zeros(3)
        self._deviations: dict[str, float] = {}  # of the velocities of that twist [m/s]
        self._stamp_ns = 0

    def stopped(
        self, stamp_ns: int, readings: Mapping[str, SensorReading]
    ) -> dict[str, SensorReading]:
        """Return the readings of occluded cameras, marked as unmeasured.

        A camera counts as occluded if its view became constant sooner than a vehicle can stop. The
        camera remains occluded until its view has changed for `_GAP_NS`.

        Args:
            stamp_ns: stamp of the readings [ns].
            readings: readings of all cameras, keyed by name.
        """
        if stamp_ns < self._stamp_ns:  # the recording is played again
            self._start_anew()
        elapsed = 1e-9 * (stamp_ns - self._stamp_ns)
        dismissed = {}
        for name, reading in readings.items():
            if name not in self._sensors:
                continue
            if reading.static_time == 0.0:
                # Because of noise, a constant view is not recognized in every batch.
                if stamp_ns - self._static_ns.get(name, stamp_ns) > _GAP_NS:
                    self._covered.pop(name, None)
                elif name in self._covered and reading.measured:
                    dismissed[name] = reading.rejected(self._covered[name])
                continue
            self._static_ns[name] = stamp_ns
            along, across = (float(v) for v in self._rows[name] @ self._twist)
            speed = math.hypot(along, across)
            possible = _HARDEST_STOP * elapsed + _CERTAIN * self._deviations.get(name, 0.0)
            if speed > possible and self._would_show(name, along, across, reading.static_time):
                self._covered[name] = (
                    f"covered: its view does not change, {1e3 * elapsed:.3g} ms after it moved at "
                    f"{speed:.3g} m/s"
                )
            if name in self._covered:
                dismissed[name] = reading.rejected(self._covered[name])
        return dismissed

    def sloping(
        self, readings: Mapping[str, SensorReading], twist: FloatArray
    ) -> dict[str, SensorReading]:
        """Return the readings of textures with an unknown slope, with increased variance.

        Args:
            readings: readings of all cameras, keyed by name.
            twist: twist estimated from the readings, from which the velocity across each axis
                follows.
        """
        sloping = {}
        for name, reading in readings.items():
            if name in self._sensors and reading.measured and reading.slope > 0.0:
                across = float(self._rows[name][1] @ twist)
                variance = reading.variance + (reading.slope * across) ** 2
                sloping[name] = dataclasses.replace(reading, variance=variance, slope=0.0)
                if variance > WIDEST**2:
                    sloping[name] = reading.rejected("uncertain: the texture may be oblique")
        return sloping

    def unsuitable(
        self, stamp_ns: int, readings: Mapping[str, SensorReading], twist: FloatArray
    ) -> dict[str, SensorReading]:
        """Return the readings of cameras with unsuitable views, marked as unmeasured.

        If cameras are occluded, the result contains the reading of one of them. Otherwise, it
        contains the readings of all cameras over oblique textures. It is keyed by camera name. If
        it is empty, the twist is stored for comparisons with later views.

        Args:
            stamp_ns: stamp of the readings [ns].
            readings: readings of all cameras, keyed by name.
            twist: twist estimated without faulty sensors, shape (3,). With a faulty twist,
                fault-free cameras would seem occluded.
        """
        found = self._contradicted(stamp_ns, readings, twist)
        found = found or self._over_oblique_texture(stamp_ns, readings, twist)
        if not found:
            self._remember(stamp_ns, twist)
            self._deviations = {name: math.sqrt(r.variance) for name, r in readings.items()}
        return found

    def unconfirmed(
        self, stamp_ns: int, readings: Mapping[str, SensorReading]
    ) -> dict[str, SensorReading]:
        """Return the readings that an oblique texture may have falsified, marked as unmeasured.

        Readings are rejected only if the lines of some camera do not match. If a twist was measured
        shortly before, only cameras over oblique textures are rejected. Without such a twist, the
        motion across the axes is unknown, so the readings of all cameras are rejected.

        Args:
            stamp_ns: stamp of the readings [ns].
            readings: readings of all cameras, keyed by name; too few are valid for a twist.

        Returns:
            Rejected readings, keyed by camera name.
        """
        blind = [
            name
            for name in self._sensors
            if readings[name].unmatched and not readings[name].measured
        ]
        if not blind:
            return {}
        if len(self._stamps) > 1 and 0 < stamp_ns - self._stamps[-1] < _GAP_NS:
            return self._over_oblique_texture(stamp_ns, readings, self._twist)
        reason = f"unconfirmed: the texture may be oblique, no match for {', '.join(blind)}"
        return {
            name: reading.rejected(reason) for name, reading in readings.items() if reading.measured
        }

    def _remember(self, stamp_ns: int, twist: FloatArray) -> None:
        """Store a twist, and integrate the motion of each camera across the camera's axis.

        Args:
            stamp_ns: stamp of the twist [ns].
            twist: measured twist (v_x, v_y [m/s], yaw rate [rad/s]), shape (3,).
        """
        if self._stamps and not 0 < stamp_ns - self._stamps[-1] < _GAP_NS:
            self._stamps.clear()
            self._paths.clear()
        elapsed = 1e-9 * (stamp_ns - self._stamps[-1]) if self._stamps else 0.0
        self._stamp_ns = stamp_ns
        self._twist = twist
        across = np.array([rows[1] @ twist for rows in self._rows.values()])
        self._paths.append((self._paths[-1] if self._paths else 0.0) + across * elapsed)
        self._stamps.append(stamp_ns)
        while stamp_ns - self._stamps[0] >= _REMEMBERED_NS:
            self._stamps.popleft()
            self._paths.popleft()

    def _contradicted(
        self, stamp_ns: int, readings: Mapping[str, SensorReading], twist: FloatArray
    ) -> dict[str, SensorReading]:
        """Return the reading whose constant view contradicts the twist most, marked as unmeasured.

        Args:
            stamp_ns: stamp of the readings [ns].
            readings: readings of all cameras, keyed by name.
            twist: twist estimated from the readings.

        Returns:
            This reading, keyed by camera name; empty if no view contradicts the twist.
        """
        farthest, covered = _STILL_SHARE, {}
        # Before the first stored twist, the motion is unknown.
        known = max(stamp_ns - self._stamps[0] if self._stamps else 0, _GAP_NS)
        for name, reading in readings.items():
            static = reading.static_time if name in self._sensors else 0.0
            if not reading.measured or static == 0.0:
                continue
            across = float(self._rows[name][1] @ twist)
            path = self._path_across(name, stamp_ns, min(static, 1e-9 * known), across)
            share = path / self._sensors[name].width
            if share > farthest:
                farthest = share
                reason = (
                    "covered: its view does not change, but the platform moves across it at "
                    f"{abs(across):.3g} m/s"
                )
                covered = {name: reading.rejected(reason)}
        return covered

    def _over_oblique_texture(
        self, stamp_ns: int, readings: Mapping[str, SensorReading], twist: FloatArray
    ) -> dict[str, SensorReading]:
        """Return the readings of the cameras over oblique textures, marked as unmeasured.

        Args:
            stamp_ns: stamp of the readings [ns].
            readings: readings of all cameras, keyed by name.
            twist: twist estimated from the readings.
        """
        rejected = {}
        for name, reading in readings.items():
            if name not in self._sensors or not reading.measured:
                continue
            across = float(self._rows[name][1] @ twist)
            speed = abs(across)
            lifetime = self._sensors[name].width + _PIECE
            path = self._path_across(name, stamp_ns, reading.reference_age, across)
            if path > _FAR_ENOUGH * lifetime:
                excess = reading.persistence - max(0.0, 1.0 - path / lifetime)
                # A single excess may be chance, because a line contains few independent texture
                # values.
                before, excess_before = self._before.get(name, (0.0, 0.0))
                if reading.persistence != before:  # otherwise this reading was already processed
                    self._excess[name] = min(excess, excess_before)
                    self._before[name] = reading.persistence, excess
                least = self._excess.get(name, 0.0)
                self._found.pop(name, None)
                if excess > _CLEAR_EXCESS or least > _EXCESS:
                    self._found[name] = (
                        f"oblique texture: {100.0 * reading.persistence:.0f} % correlation "
                        f"after {1e3 * path:.3g} mm across the axis"
                    )
            if name in self._found and speed > _SLOWEST:
                rejected[name] = reading.rejected(self._found[name])
        return rejected

    def _path_across(self, name: str, stamp_ns: int, age: float, across: float) -> float:
        """Return how far a camera has moved across its axis in the last `age` seconds [m].

        Before the first stored twist, the motion is assumed to be zero.

        Args:
            name: name of the camera.
            stamp_ns: present time [ns].
            age: duration of the motion [s].
            across: present velocity across the axis [m/s].
        """
        since = stamp_ns - round(1e9 * age)
        if not self._stamps or since >= self._stamps[-1]:
            return abs(across) * age
        newest = 1e-9 * (stamp_ns - self._stamps[-1])
        number = list(self._rows).index(name)
        paths = [float(path[number]) for path in self._paths]
        before = float(np.interp(since, list(self._stamps), paths))
        return abs(paths[-1] - before + across * (newest if 1e9 * newest < _GAP_NS else 0.0))

    def _would_show(self, name: str, along: float, across: float, duration: float) -> bool:
        """Return whether a motion would have changed the view of a camera.

        Args:
            name: name of the camera.
            along: velocity along the camera's axis [m/s].
            across: velocity across the camera's axis [m/s].
            duration: duration of the motion [s].
        """
        sensor = self._sensors[name]
        return (
            abs(across) * duration > _STILL_SHARE * sensor.width
            or abs(along) * duration > _STILL_PIXELS * sensor.pixel_pitch
        )
