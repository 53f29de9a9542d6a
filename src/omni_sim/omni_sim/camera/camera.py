"""Line cameras that view a ground texture from a moving vehicle.

Source: dissertation, sections 4.3.2 and 4.4. Each line is rendered at the pose that the vehicle has
at the time of exposure. The value of a pixel is the mean of the texture over the pixel's rotated
footprint, which is a pixel pitch long and as wide as the field of view. White noise is added, and
the sum is quantized to 8 or 16 bits. By default the exposure is instantaneous and the optics are
ideal; the module `configuration` describes the effects that can be switched on.

The noise depends only on the key, the line index and the pixel (counter-based generator). The noise
of a line is therefore independent of the division of lines into batches and threads. For each pair
of pixels, a 64-bit SplitMix hash gives four 12-bit numbers, two for each pixel. The noise of a
pixel is the sum of the two values that its numbers select from a table of normal quantiles. The
noise has about 2^23 different values and exactly the configured standard deviation. The magnitude
of its excess kurtosis is below 0.01, and it is limited to 5.2 standard deviations. Drawing normal
variates would take much longer.
"""

import functools
import math
import statistics
from collections.abc import Mapping

import numpy as np

from omni_core.kernels import kernel, lean
from omni_core.quantities import Float32Array, FloatArray
from omni_core.sensors import LineSensor
from omni_core.signals import Lines
from omni_sim.camera import optics
from omni_sim.camera.configuration import FULL_SCALE, CameraConfiguration
from omni_sim.camera.faults import TimedFault, faults_of, moved_to, turned_poses
from omni_sim.camera.footprint.integral import integrate_lines
from omni_sim.camera.footprint.padding import PaddedTexture, padded_levels
from omni_sim.texture.texture import GroundTexture

__all__ = ["CameraConfiguration", "LineCamera", "LineCameraArray"]

_TABLE_BITS = 12


class LineCamera:
    """A line camera above a ground.

    Attributes:
        sensor: mounting and field of view of the camera.
        rise: present height of the camera above its mounting height [m].
    """

    def __init__(
        self,
        sensor: LineSensor,
        texture: PaddedTexture,
        configuration: CameraConfiguration,
        key: np.uint64,
        made: optics.Optics,
        timed: tuple[TimedFault, ...] = (),
    ) -> None:
        """Create a camera above a ground.

        Args:
            sensor: mounting position and field of view.
            texture: texture of the ground.
            configuration: exposure and optics.
            key: key of the camera's noise, see `noise_key`.
            made: optics of the camera.
            timed: faults of this camera that begin and end during a run.
        """
        self.sensor = sensor
        self._seen, self._transmission, self._faults = made
        self._texture = texture
        self._configuration = configuration
        self._key = key
        self._timed = timed
        self.rise = 0.0

    @property
    def texels(self) -> int:
        """Number of texels per period in the texture that this camera uses."""
        return self._texture.texels

    def footprints(self, poses: FloatArray) -> FloatArray:
        """Return center x, y [m] and axis direction [rad] of each line's footprint, shape (m, 3).

        Args:
            poses: x, y, yaw of `base_link` in the world, one per line, shape (m, 3).
        """
        footprints = np.empty((len(poses), 3))
        _place(poses, self.sensor.x, self.sensor.y, self.sensor.heading, footprints)
        return footprints

    def grays(self, poses: FloatArray, velocities: FloatArray | None = None) -> Float32Array:
        """Return the light on each pixel in gray levels, without noise and quantization.

        The light is the mean gray level of the pixel's footprint times the transmission of the
        optics and the gain of the pixel. The result has the shape (m, pixels).

        Args:
            poses: poses of `base_link` [m, m, rad], one per line, shape (m, 3).
            velocities: time derivatives of the poses, shape (m, 3), for motion blur; None for no
                blur.

        Raises:
            ValueError: a pose is not finite.
        """
        grays = self.ground(poses, velocities)
        if self._transmission is not None:
            grays *= self._transmission
        return grays

    def ground(
        self, poses: FloatArray, velocities: FloatArray | None = None, first_line: int = 0
    ) -> Float32Array:
        """Return the mean gray level of each pixel's footprint, shape (m, pixels).

        Args:
            poses: poses of `base_link` [m, m, rad], one per line, shape (m, 3).
            velocities: time derivatives of the poses, shape (m, 3), for motion blur; None for no
                blur.
            first_line: index of the first line since the start of the run, on which faults of the
                mounting depend.
        """
        for timed in self._timed:
            rows = timed.turns(optics.elapsed(first_line, len(poses), self.sensor.line_rate))
            if len(rows):
                turned = turned_poses(poses, self.footprints(poses), rows, timed.fault.amplitude)
                velocities = None if velocities is None else moved_to(velocities, turned - poses)
                poses = turned
        if velocities is None or self._configuration.exposure_time == 0.0:
            return self._integrate(poses)
        return self._blurred(poses, velocities)

    def _integrate(self, poses: FloatArray) -> Float32Array:
        view, (wider, blur) = self._seen, self._configuration.focus(self.rise)
        footprints, width = self.footprints(poses), view.width * wider
        blur /= view.pixel_pitch * wider  # [px]
        if blur == 0.0:
            return integrate_lines(
                self._texture, footprints, view.length * wider, width, view.pixels
            )
        weights, parts = optics.defocus_weights(blur, view.pixels)
        count = parts * view.pixels + len(weights) - parts
        length = view.length * wider * count / (parts * view.pixels)
        fine = integrate_lines(self._texture, footprints, length, width, count)
        return optics.defocused(fine, weights, parts)

    def _blurred(self, poses: FloatArray, velocities: FloatArray) -> Float32Array:
        """Return the result of `ground`, averaged over the motion during the exposure."""
        exposure_time = self._configuration.exposure_time
        footprints = self.footprints(poses)
        motion = velocities.copy()  # velocity of the footprint: v + Omega k x r, Eq. (23)
        motion[:, 0] -= velocities[:, 2] * (footprints[:, 1] - poses[:, 1])
        motion[:, 1] += velocities[:, 2] * (footprints[:, 0] - poses[:, 0])
        samples = optics.blur_samples(self._seen, exposure_time, footprints[:, 2], motion)
        grays = np.zeros((len(poses), self._seen.pixels), np.float32)
        for count in np.unique(samples):
            chosen = samples == count
            for instant in optics.instants(int(count), exposure_time):
                grays[chosen] += self._integrate(poses[chosen] + instant * velocities[chosen])
            grays[chosen] /= np.float32(count)
        return grays

    def lines(
        self, poses: FloatArray, first_line: int, velocities: FloatArray | None = None
    ) -> Lines:
        """Return exposed lines with noise as uint8 or uint16, shape (m, pixels).

        Args:
            poses: x, y, yaw of `base_link` in the world [m, m, rad], one per line, shape (m, 3).
            first_line: index of the first line since the start of the run; this index determines
                the noise.
            velocities: time derivatives of these poses [m/s, m/s, rad/s], shape (m, 3), for motion
                blur; None for no blur.

        Raises:
            ValueError: a pose is not finite.
        """
        return self.develop(self.ground(poses, velocities, first_line), first_line)

    def develop(self, ground: Float32Array, first_line: int) -> Lines:
        """Apply optics, shadow, faults and noise; return 8-bit or 16-bit lines.

        Args:
            ground: result of `ground`, shape (m, pixels).
            first_line: index of the first line since the start of the run.

        Returns:
            Gray levels, shape (m, pixels).
        """
        exposure = self._configuration
        grays = ground if self._transmission is None else ground * self._transmission
        if exposure.shadow > 0.0:
            grays = optics.shade(grays, self._seen, exposure, first_line)
        if self._timed:
            time = optics.elapsed(first_line, len(ground), self.sensor.line_rate)
            grays = grays.copy()
            for timed in self._timed:
                timed.change(grays, time)
        if self._faults is not None:
            grays = grays * self._faults.sight + self._faults.offset / np.float32(exposure.gain)
        return expose(grays, exposure, self._key, first_line)


@lean
def _place(poses: FloatArray, x: float, y: float, heading: float, footprints: FloatArray) -> None:
    for i in range(len(poses)):
        yaw = poses[i, 2]
        cosine, sine = math.cos(yaw), math.sin(yaw)
        footprints[i, 0] = poses[i, 0] + cosine * x - sine * y
        footprints[i, 1] = poses[i, 1] + sine * x + cosine * y
        footprints[i, 2] = yaw + heading


def expose(
    grays: Float32Array, camera: CameraConfiguration, key: np.uint64, first_line: int
) -> Lines:
    """Return ``gain gray + offset + noise``, rounded and clipped, shape (m, pixels).

    With 16 bits, the value 65535 corresponds to the gray level 255.

    Args:
        grays: gray levels of the ground on the 8-bit scale, shape (m, pixels).
        camera: gain, offset, noise and bit depth.
        key: key of the sensor's noise, see `noise_key`.
        first_line: index of the first of these lines since the start of the run.
    """
    lines: Lines = np.empty(grays.shape, np.uint8 if camera.bit_depth == 8 else np.uint16)
    scale = 1.0 if camera.bit_depth == 8 else 257.0
    response = np.array([camera.gain, camera.offset, FULL_SCALE]) * scale
    deviation = camera.noise
    if camera.signal_to_noise_db > 0.0:
        deviation = float(FULL_SCALE / 10.0 ** (camera.signal_to_noise_db / 20.0))
    table = _quantiles(deviation * scale)
    _expose(grays, response.astype(np.float32), table, key, np.uint64(first_line), lines)
    return lines


@functools.lru_cache(maxsize=16)
def _quantiles(deviation: float) -> Float32Array:
    """Return a table of normal quantiles; the noise of a pixel is the sum of two of them.

    Args:
        deviation: standard deviation of the noise [gray levels of the output].

    Returns:
        Equidistant quantiles of a normal distribution with half the variance of the noise [gray
        levels of the output], shape (4096,).
    """
    count = 1 << _TABLE_BITS
    normal = statistics.NormalDist()
    upper = np.array([normal.inv_cdf((i + 0.5) / count) for i in range(count // 2, count)])
    values = np.concatenate((-upper[::-1], upper))
    values *= math.sqrt(0.5 / np.mean(values**2))
    return values.astype(np.float32) * np.float32(deviation)


@kernel
def _expose(
    grays: Float32Array,
    response: Float32Array,
    table: Float32Array,
    key: np.uint64,
    first_line: np.uint64,
    lines: Lines,
) -> None:
    """Write the exposed lines to `lines`; `response` holds gain, offset and white level."""
    gain, offset, white = response[0], response[1], response[2]
    pixels = grays.shape[1]
    mask = np.uint64((1 << _TABLE_BITS) - 1)
    pairs = (pixels + 1) // 2
    half = np.float32(0.5)
    black = np.float32(0.0)
    # These loops are separate because the compiler vectorizes all of them except the one that reads
    # the table. The second pixel of a pair adds its two numbers one after the other.
    hashed = np.empty(pairs, np.uint64)
    noisy = np.empty(2 * pairs, np.float32)
    late = np.zeros(2 * pairs, np.float32)
    for row in range(len(grays)):
        gray = grays[row]
        line = lines[row]
        counter = (first_line + np.uint64(row)) * np.uint64(pairs)
        for pair in range(pairs):
            # SplitMix64: a Weyl sequence followed by a finalizer with full avalanche.
            bits = key + (counter + np.uint64(pair)) * np.uint64(0x9E3779B97F4A7C15)
            bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            hashed[pair] = bits ^ (bits >> np.uint64(31))
        for pair in range(pairs):
            bits = hashed[pair]
            noisy[2 * pair] = table[bits & mask] + table[(bits >> np.uint64(12)) & mask]
            bits >>= np.uint64(24)
            noisy[2 * pair + 1] = table[bits & mask]
            late[2 * pair + 1] = table[(bits >> np.uint64(12)) & mask]
        for pixel in range(pixels):
            value = gain * gray[pixel] + offset + noisy[pixel] + late[pixel]
            line[pixel] = np.int32(min(max(value, black), white) + half)


def noise_key(seed: np.random.SeedSequence, name: str) -> np.uint64:
    """Return the key of a sensor's noise, which does not depend on the other sensors.

    Args:
        seed: seed of the run, common to all sensors.
        name: name of the sensor.
    """
    child = np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, *name.encode()))
    return np.uint64(child.generate_state(1, np.uint64)[0])


class LineCameraArray:
    """All line cameras of a vehicle, over one ground.

    The array counts the lines of each camera. The noise of a line depends only on the seed, the
    name of the camera and the line number.

    Attributes:
        cameras: cameras, keyed by name.
    """

    def __init__(
        self,
        sensors: Mapping[str, LineSensor],
        texture: GroundTexture,
        configuration: CameraConfiguration,
        seed: np.random.SeedSequence,
    ) -> None:
        """Prepare the ground texture and place the cameras.

        Args:
            sensors: mounting position and field of view of each camera, keyed by name.
            texture: texture of the ground.
            configuration: exposure of all cameras.
            seed: seed of the noise.

        Raises:
            ConfigurationError: a footprint exceeds the period of the texture, a footprint is
                narrower than 10 texels, or an exposure lasts longer than a line period.
        """
        keys = {name: noise_key(seed, name) for name in sensors}
        made = optics.optics_of(sensors, configuration, keys)
        views = {name: one.view for name, one in made.items()}
        padded = padded_levels(views, texture, configuration.most_widening)
        self.cameras: dict[str, LineCamera] = {}
        for name, sensor in sensors.items():
            timed = faults_of(name, views[name], configuration, keys[name])
            self.cameras[name] = LineCamera(
                sensor, padded[name], configuration, keys[name], made[name], timed
            )
        self._next_line = dict.fromkeys(self.cameras, 0)

    def render(self, poses: Mapping[str, FloatArray]) -> dict[str, Lines]:
        """Return the next lines of each camera without motion blur, shape (m, pixels).

        Args:
            poses: x, y, yaw of `base_link` in the world [m, m, rad] at the middle of each line's
                exposure, oldest first, shape (m, 3), keyed by camera. The number m may differ
                between cameras and may be 0.

        Raises:
            ValueError: a pose is not finite.
        """
        return {name: self.render_next(name, entry) for name, entry in poses.items()}

    def render_next(
        self, name: str, poses: FloatArray, velocities: FloatArray | None = None
    ) -> Lines:
        """Return the next lines of one camera, shape (m, pixels), oldest first.

        Args:
            name: name of the camera.
            poses: x, y, yaw of `base_link` in the world [m, m, rad] at the middle of each line's
                exposure, shape (m, 3).
            velocities: time derivatives of these poses [m/s, m/s, rad/s], shape (m, 3), for motion
                blur; None for no blur.
        """
        lines = self.cameras[name].lines(poses, self._next_line[name], velocities)
        self._next_line[name] += len(poses)
        return lines
