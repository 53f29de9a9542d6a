"""Detection of unsuitable views: occluded cameras, and cameras over oblique textures.

If a camera is occluded, for example by a lid or by dirt on the lens, its lines match perfectly at
zero displacement, but so do lines of the ground at rest and in motion across the axis. A camera
therefore counts as occluded only in four cases: its view becomes constant sooner than a vehicle
can stop (at most 15 m/s^2), or while the other cameras move on; a constant view replaces another
one, of which more would remain after any stop; or the view does not change although the camera
moves.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from linescan_odometry.joint.spectra import SIGNIFICANT
from linescan_odometry.keyframe import UNSHIFTED
from linescan_odometry.measurements import SensorReading
from linescan_odometry.paths_across import CERTAIN, GAP_NS, HARDEST_STOP, PathsAcross
from linescan_odometry.textures import Textures
from omni_core.quantities import FloatArray
from omni_core.sensors import LineSensor, velocity_row

# Share of the width; after this motion across the axis, at most half of the ground texture of a
# view remains, which no longer counts as static (`sensor.py`).
_STILL_SHARE = 0.5


class _Motion(NamedTuple):
    """A measured twist, from which covered cameras are noticed.

    Attributes:
        stamp_ns: stamp of the twist [ns].
        interval_ns: time since the twist before [ns], at most `GAP_NS`.
        twist: mean over the batch (v_x, v_y [m/s], yaw rate [rad/s]), shape (3,).
        deviations: standard deviation of the velocity along the axis of each camera whose view
            changed, over textures of known slope [m/s].
    """

    stamp_ns: int
    interval_ns: int
    twist: FloatArray
    deviations: Mapping[str, float]


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
        # A rotation counts as much as a translation that moves the farthest camera equally.
        lever = max((math.hypot(s.x, s.y) for s in sensors.values()), default=0.0)
        self._scale = np.array([lever, lever, 1.0])
        self._start_anew()

    def _start_anew(self) -> None:
        self._paths = PathsAcross(self._sensors)
        self._textures = Textures(self._sensors, self._paths)
        self._covered: dict[str, str] = {}
        # Covered cameras whose view may also be that of a vehicle at rest.
        self._alone: set[str] = set()
        # Stamps since and at which views last were constant, with gaps of up to `GAP_NS` [ns].
        self._static_ns: dict[str, tuple[int, int]] = {}
        self._last = np.zeros(3)  # last twist
        # The last motions in which each camera certainly moved along (0) or across its axis (1),
        # and its view changed.
        self._motions: dict[tuple[str, int], _Motion] = {}
        # Deviations of the present velocities of changing views, over known slopes [m/s].
        self._own = dict.fromkeys(self._sensors, 0.0)
        self._stamp_ns = 0  # of the newest readings

    def stopped(
        self, stamp_ns: int, readings: Mapping[str, SensorReading]
    ) -> dict[str, SensorReading]:
        """Return the readings of occluded cameras, marked as unmeasured.

        A camera counts as occluded if its view became constant sooner than a vehicle can stop, or
        in place of another view or of a motion that the other cameras continue. The camera remains
        occluded until its view has changed for `GAP_NS`.

        Args:
            stamp_ns: stamp of the readings [ns].
            readings: readings of all cameras, keyed by name.
        """
        if stamp_ns < self._stamp_ns:  # the recording is played again
            self._start_anew()
        self._stamp_ns = stamp_ns
        # An unknown slope of the texture falsifies the velocity, but a view that shifted at this
        # velocity must change all the same.
        self._own = {n: math.sqrt(r.variance) for n, r in readings.items() if r.static_time == 0.0}
        static = {n: r for n, r in readings.items() if n in self._sensors and _is_static(r)}
        for name in self._sensors.keys() & readings.keys() - static.keys():
            # Because of noise, a constant view is not recognized in every batch.
            if stamp_ns - self._static_ns.get(name, (0, stamp_ns))[1] > GAP_NS:
                self._covered.pop(name, None)
        self._alone &= self._covered.keys()
        for name, reading in static.items():
            begun_ns, ended_ns = self._static_ns.get(name, (0, -GAP_NS))
            if stamp_ns - ended_ns > GAP_NS:
                begun_ns = stamp_ns - round(1e9 * reading.static_time)
            self._static_ns[name] = begun_ns, stamp_ns
            after = self._motion_before(stamp_ns, name, reading)
            if after:
                self._covered[name] = f"covered: its view does not change, {after}"
            elif reading.replaced or self._stops_alone(name, readings):
                self._alone |= {name} - self._covered.keys()
                cause = "was replaced by one that" if reading.replaced else "alone"
                self._covered.setdefault(name, f"covered: its view {cause} does not change")
        resting = [name for name, reading in static.items() if reading.measured]
        at_rest = 1 < len(resting) == len(self._sensors)
        if at_rest:
            self._motions.clear()
        return {
            name: readings[name].rejected(reason)
            for name, reason in self._covered.items()
            if name in readings
            and (name in static or readings[name].measured)
            and not (at_rest and name in self._alone)
        }

    def _motion_before(self, stamp_ns: int, name: str, reading: SensorReading) -> str:
        """Return which motion shortly before a constant view excludes that the camera stopped.

        Args:
            stamp_ns: stamp of the readings [ns].
            name: name of the camera, whose view does not change.
            reading: reading of the camera.

        Returns:
            Description of the motion; empty if the camera may have stopped.
        """
        sensor, static_time = self._sensors[name], reading.static_time
        for axis, shift in enumerate((UNSHIFTED * sensor.pixel_pitch, _STILL_SHARE * sensor.width)):
            last = self._motions.get((name, axis))
            newest = last and last.stamp_ns == self._paths.stamps[-1]
            # An older motion across may have become too slow to change the view.
            if not last or not (newest or axis == 0):
                continue
            velocities = np.abs(self._rows[name] @ last.twist)
            # A velocity is a mean over its batch, which a vehicle that brakes reaches in the middle
            # of the batch. A view without a measurement may only seem constant.
            begun = 0.5 if reading.measured else 1.0
            elapsed = 1e-9 * (stamp_ns - last.stamp_ns + begun * last.interval_ns) - static_time
            speed = math.hypot(*velocities) if newest else velocities[axis]
            hard = speed > HARDEST_STOP * elapsed + CERTAIN * last.deviations[name]
            if hard and velocities[axis] * static_time > shift:
                return f"{1e3 * elapsed:.3g} ms after it moved at {speed:.3g} m/s"
        return ""

    def _stops_alone(self, name: str, readings: Mapping[str, SensorReading]) -> bool:
        """Return whether a camera has stopped, but at least two others hardly changed their motion.

        Any acceleration of the vehicle that stops one camera changes the velocities of the others,
        unless its direction hides it from them. The smallest acceleration that explains what the
        others see is compared with the hidden one that the stop needs besides. A stop that was
        measured almost to its end must also be harder than usual.

        Args:
            name: name of the camera, whose view does not change.
            readings: readings of all cameras, keyed by name.
        """
        last = self._motions.get((name, 0))
        if not last:
            return False
        elapsed_ns = self._static_ns[name][0] - last.stamp_ns
        usual = HARDEST_STOP / SIGNIFICANT * 1e-9 * max(elapsed_ns + 0.5 * last.interval_ns, 0.0)
        speed = abs(float(self._rows[name][0] @ last.twist))
        if elapsed_ns < GAP_NS and speed < usual + CERTAIN * last.deviations[name]:
            return False
        others = [n for n in last.deviations if n in self._rows and n != name]
        names = [name, *(n for n in others if n in readings and readings[n].measured)]
        if len(names) < 3 or not any(_moves(readings[n]) for n in names):
            return False
        rows = np.array([self._rows[n][0] for n in names])
        change = np.array([readings[n].velocity for n in names]) - rows @ last.twist
        variance = np.array([readings[n].variance + last.deviations[n] ** 2 for n in names])
        rows *= self._scale
        explained = np.linalg.pinv(rows[1:])
        seen = np.sum((explained @ change[1:]) ** 2) + np.sum(explained**2 @ variance[1:])
        weight = np.append(1.0, -rows[0] @ explained)
        hidden = np.sum((weight @ rows) ** 2)
        limit = SIGNIFICANT**2 * seen * hidden + CERTAIN**2 * (weight**2 @ variance)
        return bool((weight @ change) ** 2 > limit)

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
        return self._textures.sloping(stamp_ns, readings, self._across(twist))

    def _across(self, twist: FloatArray) -> dict[str, float]:
        """Return the velocity across the axis of each watched camera [m/s], keyed by name."""
        return {name: float(rows[1] @ twist) for name, rows in self._rows.items()}

    def unsuitable(
        self, stamp_ns: int, readings: Mapping[str, SensorReading], twist: FloatArray
    ) -> dict[str, SensorReading]:
        """Return the readings of cameras with unsuitable views, marked as unmeasured.

        If cameras are occluded, the result contains the reading of one of them. It is keyed by
        camera name. If it is empty, the twist is stored for comparisons with later views.

        Args:
            stamp_ns: stamp of the readings [ns].
            readings: readings of all cameras, keyed by name.
            twist: twist estimated without faulty sensors, shape (3,). With a faulty twist,
                fault-free cameras would seem occluded.
        """
        found = self._contradicted(stamp_ns, readings, twist)
        if not found:
            self._remember(stamp_ns, twist)
        return found

    def unconfirmed(
        self, stamp_ns: int, readings: Mapping[str, SensorReading]
    ) -> dict[str, SensorReading]:
        """Return the readings that an oblique texture may have falsified, marked as unmeasured.

        If twists were measured shortly before, only cameras over oblique textures are rejected.
        Without such twists, the motion across the axes is unknown. Textures of unknown slope are
        then rejected, and if the lines of some camera change without a match, all readings are.

        Args:
            stamp_ns: stamp of the readings [ns].
            readings: readings of all cameras, keyed by name; too few are valid for a twist.

        Returns:
            Rejected readings, and those with an increased variance, keyed by camera name.
        """
        found: dict[str, SensorReading] = {}
        stamps = self._paths.stamps
        if stamps and 0 < stamp_ns - stamps[-1] < GAP_NS:
            found = self.sloping(stamp_ns, readings, self._last)
            if len(stamps) > 1:  # a single twist may be accidental
                return found
        # A covered camera shows nothing of the ground.
        blind = [
            name
            for name in self._sensors
            if name not in self._covered
            and readings[name].unmatched
            and not readings[name].measured
        ]
        cause = f"no match for {', '.join(blind)}" if blind else "the texture has few features"
        return found | {
            name: reading.rejected(f"unconfirmed: the texture may be oblique, {cause}")
            for name, reading in readings.items()
            if reading.measured and (blind or (name in self._sensors and _slopes(reading)))
        }

    def _remember(self, stamp_ns: int, twist: FloatArray) -> None:
        """Store a twist, and integrate the motion of each camera across the camera's axis.

        Args:
            stamp_ns: stamp of the twist [ns].
            twist: measured twist (v_x, v_y [m/s], yaw rate [rad/s]), shape (3,).
        """
        interval_ns = min(stamp_ns - max(self._paths.stamps, default=0), GAP_NS)
        for name, rows in self._rows.items():
            for axis, speed in enumerate(np.abs(rows @ twist)):
                if speed > CERTAIN * self._own.get(name, math.inf):
                    self._motions[name, axis] = _Motion(stamp_ns, interval_ns, twist, self._own)
        self._last = twist
        self._paths.append(stamp_ns, self._across(twist))

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
        stamps = self._paths.stamps
        known = max(stamp_ns - stamps[0] if stamps else 0, GAP_NS)
        for name, reading in readings.items():
            static = reading.static_time if name in self._sensors else 0.0
            if not reading.measured or static == 0.0:
                continue
            across = float(self._rows[name][1] @ twist)
            path = self._paths.length(name, stamp_ns, min(static, 1e-9 * known), across)
            share = path / self._sensors[name].width
            if share > farthest:
                farthest = share
                reason = (
                    "covered: its view does not change, but the platform moves across it at "
                    f"{abs(across):.3g} m/s"
                )
                covered = {name: reading.rejected(reason)}
        self._covered |= {name: reading.reason for name, reading in covered.items()}
        self._alone |= covered.keys()
        return covered


def _is_static(reading: SensorReading) -> bool:
    """Return whether the view of a camera does not change, and its texture does not leave it."""
    if reading.static_time == 0.0 or reading.unmatched:
        return False
    kept = [decay for decay in reading.decays if decay.age <= reading.static_time]
    return all(decay.most + SIGNIFICANT * math.sqrt(decay.variance) >= 1.0 for decay in kept)


def _moves(reading: SensorReading) -> bool:
    """Return whether a camera certainly moves along its axis."""
    certain = CERTAIN * math.sqrt(reading.variance)
    return reading.measured and reading.static_time == 0.0 and abs(reading.velocity) > certain


def _slopes(reading: SensorReading) -> bool:
    """Return whether the texture of a view that changes has an unknown slope."""
    return reading.slope > 0.0 and reading.static_time == 0.0
