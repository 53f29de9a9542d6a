"""Detection of unsuitable views: occluded cameras, and cameras over oblique textures.

If a camera is occluded, for example by a lid or by dirt on the lens, its lines match perfectly at
zero displacement, but so do lines of the ground at rest and in motion across the axis. A camera
therefore counts as occluded only in two cases: its view becomes constant sooner than a vehicle can
stop (at most 15 m/s^2), or its view does not change although the camera moves.

Each pixel of a line camera averages the brightness across the axis, over the width of the view. In
motion across the axis, new ground enters the view, and of ordinary ground nothing remains after one
width of the view. If the texture is oblique to the axis, the same stripes remain in the view and
shift along the line, so motion across the axis looks like motion along it. A single camera cannot
distinguish the two motions. The twist, however, gives the motion across the axis, and thus how much
of the ground should remain: if more of the texture remains, it is oblique.
"""

import bisect
import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from linescan_odometry.joint.spectra import SIGNIFICANT
from linescan_odometry.measurements import Decay, SensorReading
from omni_core.quantities import FloatArray
from omni_core.sensors import LineSensor, velocity_row

# Share of the width; after this motion across the axis, at most half of the ground texture of a
# view remains, which no longer counts as static (`sensor.py`).
_STILL_SHARE = 0.5
_STILL_PIXELS = 2.0  # px; after this motion along the axis a view must change
_HARDEST_STOP = 15.0  # m/s^2; a hard stop on a dry road reaches 10
# m/s^2; hardest stop of one camera while others move on: 5 rad/s^2 between cameras 1 m apart
_HARDEST_TURN = 5.0
_CERTAIN = 4.0  # standard deviations by which a stop must be too hard
_REMEMBERED_NS = 1_280_000_000  # ns; twists are stored for this time, longer than a keyframe
# Limit on the time without a twist over which the motion is extrapolated, and time for which the
# view of an occluded camera must change before the camera is used again [ns].
_GAP_NS = 50_000_000
# Limits on the share of a texture that moves on in the view [1]: below the first, features of
# independent slopes pass; above the second, the texture has one slope, like that of fibers.
_ORDINARY = 0.25
_OBLIQUE = 0.5
# m/s, standard deviation; a texture of unknown slope confirms no other camera above it
_WIDEST = 0.5
_SLOWEST = 0.03  # m/s across the axis; at lower speeds, oblique texture causes no significant error


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
        self._start_anew()

    def _start_anew(self) -> None:
        self._stamps: list[int] = []
        self._paths: list[FloatArray] = []  # distance across each axis [m]
        self._covered: dict[str, str] = {}
        # Stamps [ns] at which textures were decided to be ordinary or oblique, and the decisions.
        self._textures: dict[str, tuple[int, str]] = {}
        self._alone: set[str] = set()  # covered cameras that stopped while others moved on
        self._static_ns: dict[str, int] = {}  # stamps at which views last were constant [ns]
        self._twist: FloatArray = np.zeros(3)
        # Deviations of the velocities of that twist, and of the present ones, over textures of
        # known slope [m/s].
        self._deviations: dict[str, float] = {}
        self._own: dict[str, float] = {}
        self._stamp_ns = 0
        self._interval_ns = 0  # time between the last two twists [ns]

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
        # An unknown slope of the texture falsifies the velocity, but a view that shifted at this
        # velocity must change all the same.
        self._own = {name: math.sqrt(reading.variance) for name, reading in readings.items()}
        static = {n: r for n, r in readings.items() if n in self._sensors and _is_static(r)}
        for name in self._sensors.keys() & readings.keys() - static.keys():
            # Because of noise, a constant view is not recognized in every batch.
            if stamp_ns - self._static_ns.get(name, stamp_ns) > _GAP_NS:
                self._covered.pop(name, None)
        self._static_ns |= dict.fromkeys(static, stamp_ns)
        sudden, moving = "", self._moving_on(readings)
        self._alone &= self._covered.keys()
        for name, reading in static.items():
            along, across = (float(v) for v in self._rows[name] @ self._twist)
            speed = math.hypot(along, across)
            # The last twist is a mean over its batch, so the stop began within that batch.
            stopping = stamp_ns - self._stamp_ns - round(1e9 * reading.static_time)
            elapsed = 1e-9 * (max(stopping, 0) + self._interval_ns)
            uncertain = _CERTAIN * self._deviations.get(name, 0.0)
            shows = self._would_show(name, along, across, reading.static_time)
            after = f"{1e3 * elapsed:.3g} ms after it moved at {speed:.3g} m/s"
            reason = f"covered: its view does not change, {after}"
            if speed > _HARDEST_STOP * elapsed + uncertain and shows:
                sudden = after
                self._covered[name] = reason
            elif moving and abs(along) > _HARDEST_TURN * elapsed + uncertain and shows:
                self._alone.add(name)
                self._covered.setdefault(name, reason)
        if sudden:
            # A vehicle that cannot be at rest turns about one static view at most.
            stopped = stamp_ns - self._stamp_ns + self._interval_ns
            also = [n for n, r in static.items() if 1e9 * r.static_time < stopped]
            reason = f"covered: its view does not change, like that of a camera {sudden}"
            self._covered = dict.fromkeys(also, reason) | self._covered
        at_rest = len(static) == len(self._sensors)
        return {
            name: readings[name].rejected(reason)
            for name, reason in self._covered.items()
            if name in readings
            and (name in static or readings[name].measured)
            and not (at_rest and name in self._alone)
        }

    def _moving_on(self, readings: Mapping[str, SensorReading]) -> bool:
        """Return whether a camera moves on along its axis at half of its last speed or more."""
        for name, rows in self._rows.items():
            last, reading = float(rows[0] @ self._twist), readings.get(name)
            if reading is None or not reading.measured or reading.static_time > 0.0:
                continue
            certain = _CERTAIN * math.sqrt(reading.variance)
            if reading.velocity * last > 0.0 and abs(reading.velocity) - certain > 0.5 * abs(last):
                return True
        return False

    def sloping(
        self, stamp_ns: int, readings: Mapping[str, SensorReading], twist: FloatArray
    ) -> dict[str, SensorReading]:
        """Return the readings of textures with an unknown slope, with increased variance.

        Args:
            stamp_ns: stamp of the readings [ns].
            readings: readings of all cameras, keyed by name.
            twist: twist estimated from the readings, from which the velocity across each axis
                follows.
        """
        sloping = {}
        for name, reading in readings.items():
            if name in self._sensors and reading.measured and reading.slope > 0.0:
                across = float(self._rows[name][1] @ twist)
                share = self._slope_share(stamp_ns, name, reading, across)
                variance = reading.variance + share * (reading.slope * across) ** 2
                sloping[name] = dataclasses.replace(reading, variance=variance, slope=0.0)
                if variance > _WIDEST**2:
                    sloping[name] = reading.rejected("uncertain: the texture may be oblique")
        return sloping

    def _slope_share(
        self, stamp_ns: int, name: str, reading: SensorReading, across: float
    ) -> float:
        """Return the factor with which the variance of the slope of a texture counts [1].

        It is the mean square of the share of the texture that moves on in the view; the prior
        deviation of this share is 1. In ordinary texture, the mean of the independent slopes of its
        features counts at most.

        Args:
            stamp_ns: stamp of the reading [ns].
            name: name of the camera.
            reading: reading of the camera.
            across: velocity across the camera's axis [m/s].
        """
        texture = self._texture(stamp_ns, name, reading, across)
        smallest = 1.0 / max(reading.features, 1.0) if texture and not texture[1] else 1.0
        for decay in reading.decays:
            expected = self._expected(stamp_ns, name, decay, across)
            lost = 1.0 - expected
            if lost > 0.0 and math.isfinite(decay.variance):
                error = decay.variance / lost**2
                gain = 1.0 / (1.0 + error)
                share = gain * min(max((decay.most - expected) / lost, 0.0), 1.0)
                smallest = min(smallest, share**2 + gain * error)
        return smallest

    def _texture(
        self, stamp_ns: int, name: str, reading: SensorReading, across: float
    ) -> tuple[int, str] | None:
        """Return when it was decided whether a texture is oblique [ns], and the reason.

        The reason is empty for ordinary texture. The result is None without a decision, for
        instance if a texture changes for another reason than that it leaves the view. A decision
        holds until the view has moved across by its width.

        Args:
            stamp_ns: stamp of the reading [ns].
            name: name of the camera.
            reading: reading of the camera.
            across: velocity across the camera's axis [m/s].
        """
        found, remains = None, True
        for decay in reading.decays:
            expected = self._expected(stamp_ns, name, decay, across)
            deviation, lost = math.sqrt(decay.variance), 1.0 - expected
            error, oblique = SIGNIFICANT * deviation, expected + _OBLIQUE * lost
            if expected - error < decay.most < expected + _ORDINARY * lost - error:
                return stamp_ns, ""
            # A periodic ground leaves the view and returns; fibers remain in all comparisons.
            remains = remains and decay.most > oblique - deviation
            if decay.shifted and decay.least > oblique + error:
                path = self._path_across(name, stamp_ns, decay.age, across)
                found = (
                    stamp_ns,
                    f"oblique texture: {100.0 * decay.least:.0f} % in common after "
                    f"{1e3 * path:.3g} mm across the axis",
                )
        if found and remains:
            return found
        if name in self._textures:
            age = 1e-9 * (stamp_ns - self._textures[name][0])
            if self._path_across(name, stamp_ns, age, across) < self._sensors[name].width:
                return self._textures[name]
        return None

    def _expected(self, stamp_ns: int, name: str, decay: Decay, across: float) -> float:
        """Return the share of its texture that an ordinary ground would keep [1].

        Args:
            stamp_ns: present time [ns].
            name: name of the camera.
            decay: comparison of lines.
            across: velocity across the camera's axis [m/s].
        """
        width = self._sensors[name].width
        blur = abs(across) * decay.duration / width
        path = self._path_across(name, stamp_ns, decay.age, across) / width
        return common_ground(path, blur) / common_ground(0.0, blur)

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
            self._deviations = self._own
        return found

    def unconfirmed(
        self, stamp_ns: int, readings: Mapping[str, SensorReading]
    ) -> dict[str, SensorReading]:
        """Return the readings that an oblique texture may have falsified, marked as unmeasured.

        If a twist was measured shortly before, only cameras over oblique textures are rejected.
        Without such a twist, the motion across the axes is unknown. Textures of unknown slope are
        then rejected, and if the lines of some camera change without a match, all readings are.

        Args:
            stamp_ns: stamp of the readings [ns].
            readings: readings of all cameras, keyed by name; too few are valid for a twist.

        Returns:
            Rejected readings, and those with an increased variance, keyed by camera name.
        """
        if len(self._stamps) > 1 and 0 < stamp_ns - self._stamps[-1] < _GAP_NS:
            sloping = self.sloping(stamp_ns, readings, self._twist)
            known = {**readings, **sloping}
            return sloping | self._over_oblique_texture(stamp_ns, known, self._twist)
        blind = [
            name
            for name in self._sensors
            if readings[name].unmatched and not readings[name].measured
        ]
        cause = f"no match for {', '.join(blind)}" if blind else "the texture has few features"
        return {
            name: reading.rejected(f"unconfirmed: the texture may be oblique, {cause}")
            for name, reading in readings.items()
            if reading.measured and (blind or (name in self._sensors and reading.slope > 0.0))
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
        self._interval_ns = min(stamp_ns - self._stamp_ns, _GAP_NS)
        elapsed = 1e-9 * self._interval_ns if self._stamps else 0.0
        self._stamp_ns = stamp_ns
        self._twist = twist
        across = np.array([rows[1] @ twist for rows in self._rows.values()])
        self._paths.append((self._paths[-1] if self._paths else 0.0) + across * elapsed)
        self._stamps.append(stamp_ns)
        while stamp_ns - self._stamps[0] >= _REMEMBERED_NS:
            del self._stamps[0], self._paths[0]

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
        self._covered |= {name: reading.reason for name, reading in covered.items()}
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
            texture = self._texture(stamp_ns, name, reading, across)
            if texture is None:
                self._textures.pop(name, None)
                continue
            self._textures[name] = texture
            if texture[1] and abs(across) > _SLOWEST:
                rejected[name] = reading.rejected(texture[1])
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
        after = bisect.bisect(self._stamps, since)
        number = list(self._rows).index(name)
        path = float(self._paths[-1][number] - self._paths[after][number])
        if after > 0:
            begin, end = self._stamps[after - 1], self._stamps[after]
            step = float(self._paths[after][number] - self._paths[after - 1][number])
            path += step * (end - since) / (end - begin)
        return abs(path + across * (newest if 1e9 * newest < _GAP_NS else 0.0))

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


def _is_static(reading: SensorReading) -> bool:
    """Return whether the view of a camera does not change, and its texture does not leave it."""
    time, kept = reading.static_time, [d for d in reading.decays if d.age <= reading.static_time]
    return time > 0.0 and all(d.most + SIGNIFICANT * math.sqrt(d.variance) >= 1.0 for d in kept)


def common_ground(path: float, blur: float) -> float:
    """Return the share of the ground that lines of one mean have in common with those of another.

    It is the mean of ``max(1 - |x|, 0)`` over all pairs of lines, at their distances x.

    Args:
        path: distance between the means across the axis, relative to the width of the view [1].
        blur: distance that the view moves during each of them, relative to its width [1].
    """
    if blur < 1e-3:
        return max(1.0 - path, 0.0)
    ends = _twice_integrated(path + blur) + _twice_integrated(path - blur)
    return (ends - 2.0 * _twice_integrated(path)) / blur**2


def _twice_integrated(x: float) -> float:
    """Return the function whose second derivative is ``max(1 - |x|, 0)``."""
    size = abs(x)
    return 0.5 * size**2 - size**3 / 6.0 if size < 1.0 else 0.5 * size - 1.0 / 6.0
