"""Detection of occluded cameras, for example by a lid or by dirt on the lens.

The image of an occluded camera matches itself perfectly at zero displacement, like the image of the
ground at rest or in motion across the axis. A camera therefore counts as occluded in two cases: its
view becomes constant sooner than a vehicle can stop (at most 50 m/s^2), or its view does not change
although the camera moves.
"""

import math
from collections.abc import Mapping

import numpy as np

from linescan_odometry.measurements import SensorReading
from omni_platform.quantities import FloatArray
from omni_platform.sensors import LineSensor, velocity_row

_STILL_SHARE = 0.25  # share of the width; after this motion across the axis a view must change
_STILL_PIXELS = 2.0  # px; after this motion along the axis a view must change
_HARDEST_STOP = 50.0  # m/s^2; a larger deceleration is impossible


class Covers:
    """Detects occluded cameras by comparing the view of each camera with its motion."""

    def __init__(self, sensors: Mapping[str, LineSensor]) -> None:
        """Create the detection for some of the cameras, keyed by name.

        Until a measurement, the vehicle is assumed to be at rest, and no camera is occluded.
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
        self._covered: dict[str, str] = {}
        self._twist = np.zeros(3)
        self._stamp_ns = 0

    def remember(self, stamp_ns: int, twist: FloatArray) -> None:
        """Store a measured twist (v_x, v_y [m/s], yaw rate [rad/s]) and its stamp [ns]."""
        self._stamp_ns = stamp_ns
        self._twist = twist

    def stopped(
        self, stamp_ns: int, readings: Mapping[str, SensorReading]
    ) -> dict[str, SensorReading]:
        """Return the readings of occluded cameras, marked as unmeasured.

        A camera counts as occluded if its view became constant sooner than a vehicle can stop. The
        camera remains occluded until its view changes.

        Args:
            stamp_ns: stamp of the readings [ns].
            readings: readings of all cameras, keyed by name.
        """
        if stamp_ns < self._stamp_ns:  # the recording is played again
            self._start_anew()
        elapsed = 1e-9 * (stamp_ns - self._stamp_ns)
        dismissed = {}
        for name, reading in readings.items():
            if name not in self._sensors or reading.static_time == 0.0:
                self._covered.pop(name, None)
                continue
            along, across = (float(v) for v in self._rows[name] @ self._twist)
            speed = math.hypot(along, across)
            if speed > _HARDEST_STOP * elapsed and self._would_show(
                name, along, across, reading.static_time
            ):
                self._covered[name] = (
                    f"covered: its view does not change, {1e3 * elapsed:.3g} ms after it moved at "
                    f"{speed:.3g} m/s"
                )
            if name in self._covered:
                dismissed[name] = reading.rejected(self._covered[name])
        return dismissed

    def contradicted(
        self, readings: Mapping[str, SensorReading], twist: FloatArray
    ) -> dict[str, SensorReading]:
        """Return the reading whose constant view contradicts the twist most, marked as unmeasured.

        Args:
            readings: readings of all cameras, keyed by name.
            twist: twist estimated from the readings.

        Returns:
            This reading, keyed by camera name; empty if no view contradicts the twist.
        """
        farthest, covered = _STILL_SHARE, {}
        for name, reading in readings.items():
            static = reading.static_time if name in self._sensors else 0.0
            if not reading.measured or static == 0.0:
                continue
            across = float(self._rows[name][1] @ twist)
            share = abs(across) * static / self._sensors[name].width
            if share > farthest:
                farthest = share
                reason = (
                    "covered: its view does not change, but the platform moves across it at "
                    f"{abs(across):.3g} m/s"
                )
                covered = {name: reading.rejected(reason)}
        return covered

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
