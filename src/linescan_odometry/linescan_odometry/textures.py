"""Unknown slope of a texture against the direction across a camera's axis.

Each pixel of a line camera averages the brightness across the axis, over the width of the view. In
motion across the axis, new ground enters the view, and of ordinary ground nothing remains after one
width of the view. If the texture is oblique to the axis, the same stripes remain in the view and
shift along the line, so motion across the axis looks like motion along it. A single camera cannot
distinguish the two motions. The twist, however, gives the motion across the axis, and thus how much
of the ground should remain: if more of the texture remains, it is oblique.

The slope of an oblique texture is limited by its finest details. A stripe that remains in the view
extends over its whole width, so the average over the width blurs it along the axis, by the product
of slope and width. The effect of a slope up to this limit is added to the variance.
"""

import dataclasses
import math
from collections.abc import Mapping

from linescan_odometry.joint.spectra import SIGNIFICANT
from linescan_odometry.measurements import Decay, SensorReading
from linescan_odometry.paths_across import PathsAcross
from omni_core.sensors import LineSensor

# Share of a texture that moves on in the view [1]; above it, the texture has one slope (fibers).
_OBLIQUE = 0.5
# m/s, standard deviation; a texture of unknown slope confirms no other camera above it
_WIDEST = 0.5


class Textures:
    """Decides whether textures are oblique, and adds the effect of unknown slopes to variances."""

    def __init__(self, sensors: Mapping[str, LineSensor], paths: PathsAcross) -> None:
        """Create the decision; nothing is known of any texture.

        Args:
            sensors: watched cameras, keyed by name.
            paths: motion of the cameras across their axes, which the caller updates.
        """
        self._sensors = sensors
        self._paths = paths

    def sloping(
        self, stamp_ns: int, readings: Mapping[str, SensorReading], across: Mapping[str, float]
    ) -> dict[str, SensorReading]:
        """Return the readings of oblique textures and of unknown slopes, with increased variance.

        Args:
            stamp_ns: stamp of the readings [ns].
            readings: readings of all cameras, keyed by name.
            across: velocity across the axis of each watched camera [m/s].
        """
        sloping = {}
        for name, reading in readings.items():
            if name not in self._sensors or not reading.measured or reading.oblique:
                continue
            reason = self._oblique(stamp_ns, name, reading, across[name])
            if reason:
                slope, oblique = self._steepest(name, reading), True
            elif reading.slope > 0.0:
                reason, oblique, share = "uncertain: the texture may be oblique", False, 1.0
                if reading.static_time == 0.0:  # a constant view loses no texture
                    share = self._slope_share(stamp_ns, name, reading, across[name])
                slope = math.sqrt(share) * reading.slope
            else:
                continue
            variance = reading.variance + (slope * across[name]) ** 2
            sloping[name] = dataclasses.replace(
                reading, variance=variance, slope=0.0, oblique=oblique
            )
            if variance > _WIDEST**2 and (oblique or reading.static_time == 0.0):
                sloping[name] = reading.rejected(reason)
        return sloping

    def _steepest(self, name: str, reading: SensorReading) -> float:
        """Return the standard deviation of the slope of an oblique texture [1].

        It is the limit on the slope, with the error of the velocity across the axis, which other
        cameras measure over the same texture: for a slope s, the variances of the two velocities
        obey ``V = s^2 (v^2 + V)``. Textures with a slope of 1 or more determine no motion.

        Args:
            name: name of the camera.
            reading: reading of the camera.
        """
        sensor = self._sensors[name]
        blur = min((decay.blur for decay in reading.decays), default=math.inf)
        slope = blur * sensor.pixel_pitch / sensor.width
        return slope / math.sqrt(1.0 - slope**2) if slope < 1.0 else math.inf

    def _slope_share(
        self, stamp_ns: int, name: str, reading: SensorReading, across: float
    ) -> float:
        """Return the factor with which the variance of the slope of a texture counts [1].

        It is the mean square of the share of the texture that moves on in the view; the prior
        deviation of this share is 1.

        Args:
            stamp_ns: stamp of the reading [ns].
            name: name of the camera.
            reading: reading of the camera.
            across: velocity across the camera's axis [m/s].
        """
        smallest = 1.0
        for decay in reading.decays:
            expected = self._expected(stamp_ns, name, decay, across)
            lost = 1.0 - expected
            if lost > 0.0 and math.isfinite(decay.variance):
                error = decay.variance / lost**2
                gain = 1.0 / (1.0 + error)
                share = gain * min(max((decay.most - expected) / lost, 0.0), 1.0)
                smallest = min(smallest, share**2 + gain * error)
        return smallest

    def _oblique(self, stamp_ns: int, name: str, reading: SensorReading, across: float) -> str:
        """Return why a texture is oblique; empty if it is not.

        Args:
            stamp_ns: stamp of the reading [ns].
            name: name of the camera.
            reading: reading of the camera.
            across: velocity across the camera's axis [m/s].
        """
        found, remains = "", True
        for decay in reading.decays:
            deviation = math.sqrt(decay.variance)
            expected = self._expected(stamp_ns, name, decay, across)
            oblique = expected + _OBLIQUE * (1.0 - expected)
            # A periodic ground leaves the view and returns; fibers remain in all comparisons.
            remains = remains and decay.most > oblique - deviation
            if decay.shifted and decay.least > oblique + SIGNIFICANT * deviation:
                path = self._paths.length(name, stamp_ns, decay.age, across)
                found = (
                    f"oblique texture: {100.0 * decay.least:.0f} % in common after "
                    f"{1e3 * path:.3g} mm across the axis"
                )
        return found if remains else ""

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
        path = self._paths.length(name, stamp_ns, decay.age, across) / width
        return common_ground(path, blur) / common_ground(0.0, blur)


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
