"""Optics, dirt, motion blur and faulty pixels of the cameras."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from omni_core.configuration import ConfigurationError
from omni_core.quantities import Float32Array, FloatArray, IntArray
from omni_core.sensors import LineSensor
from omni_sim.camera.configuration import BLUR_MARGIN, FULL_SCALE, TELECENTRIC, CameraConfiguration

_SAMPLES_PER_PIXEL = 4  # samples per pixel of motion along the axis in a blurred line
_SAMPLES_PER_WIDTH = 16  # samples per width of motion across the axis in a blurred line
_MOST_SAMPLES = 128
_TAPS = 8  # number of amplifiers that read out a line
_BLUR_REACH = 4.0  # standard deviations beyond which blur is neglected
_PENUMBRA = 0.002  # width of the soft edge of a shadow [m]


class Optics(NamedTuple):
    """What the optics of a camera do to the light from the ground.

    Attributes:
        view: the camera, with the field of view that results from its actual height.
        transmission: factor by which optics and pixel gain scale the light on each pixel [1], shape
            (pixels,); None if there is no loss and all gains are equal.
        faults: faults of the pixels; None if no pixel is faulty.
    """

    view: LineSensor
    transmission: Float32Array | None
    faults: PixelFaults | None


def optics_of(
    sensors: Mapping[str, LineSensor],
    configuration: CameraConfiguration,
    keys: Mapping[str, np.uint64],
) -> dict[str, Optics]:
    """Return the optics of all cameras, keyed by name.

    Args:
        sensors: mounting position and field of view of each camera, keyed by name.
        configuration: exposure and optics of all cameras.
        keys: key of each camera's noise, keyed by name.

    Raises:
        ConfigurationError: an exposure lasts longer than a line period, or a field of view is
            larger than permitted.
    """
    check_exposure(sensors, configuration)
    scale = 1.0
    if configuration.lens != TELECENTRIC:
        scale += configuration.height_error / configuration.working_distance
    made = {}
    for name, sensor in sensors.items():
        view, key = sensor, keys[name]
        if scale != 1.0:
            length, width = sensor.length * scale, sensor.width * scale
            view = dataclasses.replace(sensor, length=length, width=width)
        lost = transmission(sensor, configuration, key)
        made[name] = Optics(view, lost, pixel_faults(sensor, configuration, key))
    return made


def check_exposure(sensors: Mapping[str, LineSensor], configuration: CameraConfiguration) -> None:
    """Check that the exposure is not longer than the line period of any sensor.

    Raises:
        ConfigurationError: the exposure is too long; the message names the sensor.
    """
    for name, sensor in sensors.items():
        if configuration.exposure_time * sensor.line_rate > 1.0:
            raise ConfigurationError(
                "camera.exposure_time",
                f"{configuration.exposure_time:g} s is longer than the line period of {name}, "
                f"{1.0 / sensor.line_rate:g} s",
            )


def transmission(
    sensor: LineSensor, configuration: CameraConfiguration, key: np.uint64
) -> Float32Array | None:
    """Return the factor by which optics and pixel gain scale the light on each pixel.

    The loss due to shading is proportional to the squared distance from the middle.

    Args:
        sensor: the camera.
        configuration: optics of the camera.
        key: seed of the positions and sizes of the specks, and of the gains of the pixels.

    Returns:
        Factors [1], shape (pixels,); None if there is no loss and all gains are equal.
    """
    unlike = configuration.photo_response > 0.0
    if configuration.shading == 0.0 and configuration.dirt_spots == 0 and not unlike:
        return None
    place = (np.arange(sensor.pixels) + 0.5) / sensor.pixels
    share: FloatArray = 1.0 - configuration.shading * (2.0 * place - 1.0) ** 2
    share *= specks(pattern(key, 1), sensor, configuration, configuration.dirt_spots)
    if unlike:
        response = pattern(key, 2).standard_normal(sensor.pixels)
        share *= np.maximum(1.0 + configuration.photo_response * response, 0.0)
    return share.astype(np.float32)


def specks(
    generator: np.random.Generator,
    sensor: LineSensor,
    configuration: CameraConfiguration,
    count: int,
) -> FloatArray:
    """Return the factor by which specks of dirt on the optics scale the light, shape (pixels,).

    The specks are out of focus. Their shadows have the profile ``(1 - r^2)^2``, where ``r`` is the
    distance from the center divided by the radius. Their diameters are 0.5 to 1.5 times the mean
    diameter.

    Args:
        generator: source of positions and sizes.
        sensor: the camera.
        configuration: size and opacity of the specks.
        count: number of specks.
    """
    place = (np.arange(sensor.pixels) + 0.5) / sensor.pixels
    share = np.ones(sensor.pixels)
    for middle, size in generator.uniform((0.0, 0.5), (1.0, 1.5), (count, 2)):
        radius = 0.5 * size * configuration.dirt_size / sensor.length
        r = np.minimum(np.abs(place - middle) / radius, 1.0)
        share *= 1.0 - configuration.dirt_opacity * (1.0 - r * r) ** 2
    return share


@dataclasses.dataclass(frozen=True, eq=False)
class PixelFaults:
    """Deviations of each pixel: a signal that does not come from the ground, and a loss of light.

    Attributes:
        offset: dark signal plus light from mud on the optics [gray levels of an 8-bit scale], shape
            (pixels,).
        sight: share of the ground's light that each pixel measures [1], shape (pixels,); 0 behind
            mud and at a stuck pixel.
    """

    offset: Float32Array
    sight: Float32Array


def pixel_faults(
    sensor: LineSensor, configuration: CameraConfiguration, key: np.uint64
) -> PixelFaults | None:
    """Return the faults of a camera's pixels; None if no pixel is faulty.

    Args:
        sensor: the camera.
        configuration: faults of the camera.
        key: seed of the positions of the faults.
    """
    pixels = sensor.pixels
    generator = pattern(key, 3)
    offset: FloatArray = configuration.dark_signal * generator.standard_normal(pixels)
    offset += configuration.dark_steps * (np.arange(pixels) * _TAPS // pixels % 2)
    sight = np.ones(pixels)
    # All random values are drawn before use, so that one kind of fault does not affect another.
    order, levels = generator.permutation(pixels), generator.uniform(20.0, 120.0, pixels)
    grays = mud(generator, sensor)
    hidden = np.arange(pixels) >= round((1.0 - configuration.mud) * pixels)
    offset[hidden], sight[hidden] = grays[hidden], 0.0
    hot = order[: configuration.hot_pixels]
    offset[hot] += levels[hot]
    stuck = order[::-1][: configuration.stuck_pixels]
    offset[stuck], sight[stuck] = np.where(stuck % 2 == 0, 2.0 * FULL_SCALE, -FULL_SCALE), 0.0
    if not offset.any() and sight.all():
        return None
    return PixelFaults(offset.astype(np.float32), sight.astype(np.float32))


def shade(
    grays: Float32Array, sensor: LineSensor, configuration: CameraConfiguration, first_line: int
) -> Float32Array:
    """Return lines with a shadow, whose soft edge is fixed or moves back and forth along the line.

    Args:
        grays: gray levels of the ground, shape (m, pixels).
        sensor: the camera.
        configuration: optics of the camera, including the shadow.
        first_line: index of the first line since the start of the run.
    """
    time = elapsed(first_line, len(grays), sensor.line_rate)
    moved = 0.35 + configuration.shadow_speed * time / sensor.length  # [lengths of the view]
    edge = 0.1 + 0.8 * np.abs((moved - 0.1) / 0.8 % 2.0 - 1.0)
    shaded = grays * (1.0 - configuration.shadow * (1.0 - lit(sensor, edge))).astype(np.float32)
    return np.asarray(shaded, np.float32)


def elapsed(first_line: int, count: int, line_rate: float) -> FloatArray:
    """Return the times at which lines are exposed [s], shape (count,).

    Args:
        first_line: index of the first line since the start of the run.
        count: number of lines.
        line_rate: line rate [1/s].
    """
    return np.asarray((first_line + np.arange(count)) / line_rate, np.float64)


def lit(sensor: LineSensor, edge: FloatArray) -> FloatArray:
    """Return the share of the light that reaches each pixel beside a shadow, shape (m, pixels).

    Args:
        sensor: the camera.
        edge: place of the shadow's edge in each line, as a share of the line; the pixels before it
            are in the shadow, shape (m,).
    """
    place = (np.arange(sensor.pixels) + 0.5) / sensor.pixels
    share = np.clip((place - edge[:, None]) * sensor.length / _PENUMBRA + 0.5, 0.0, 1.0)
    return np.asarray(share, np.float64)


def defocus_weights(blur: float, pixels: int) -> tuple[Float32Array, int]:
    """Return the weights of the parts of pixels that contribute to a pixel, and parts per pixel.

    The weights are a Gaussian, convolved with the pixel. A part is at most as long as its standard
    deviation, so sampling changes the modulation transfer function by less than 1e-8. Blur across
    the axis is neglected, because a pixel is much wider than the blur.

    Args:
        blur: standard deviation of the blur [px].
        pixels: number of pixels of a line, which limits the blur.
    """
    blur = min(blur, BLUR_MARGIN * pixels / (2.0 * _BLUR_REACH + 1.0))
    parts = math.ceil(1.0 / blur) if blur < 1.0 else 1
    reach = math.ceil(_BLUR_REACH * blur * parts)
    bell = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (blur * parts)) ** 2)
    weights = np.convolve(bell / bell.sum(), np.full(parts, 1.0 / parts))
    return weights.astype(np.float32), parts


def defocused(fine: Float32Array, weights: Float32Array, parts: int) -> Float32Array:
    """Return blurred pixels from the gray levels of their parts, shape (m, pixels).

    Args:
        fine: gray levels of the parts of pixels, which extend beyond the ends of the lines.
        weights: weights from `defocus_weights`.
        parts: number of parts per pixel.
    """
    windows = np.lib.stride_tricks.sliding_window_view(fine, len(weights), axis=1)[:, ::parts]
    return np.asarray(windows @ weights, np.float32)


def mud(generator: np.random.Generator, sensor: LineSensor) -> FloatArray:
    """Return the gray levels of a line that is covered with mud, shape (pixels,).

    The gray level is random at points 0.6 mm apart and is interpolated linearly between them.
    """
    nodes = np.arange(0.0, sensor.length + 1e-3, 6e-4)
    place = (np.arange(sensor.pixels) + 0.5) * sensor.pixel_pitch
    grays = generator.normal(70.0, 20.0, len(nodes)).clip(10.0, 140.0)
    return np.asarray(np.interp(place, nodes, grays))


def pattern(key: np.uint64, *number: int) -> np.random.Generator:
    """Return the generator of a camera's pattern with a number, such as that of its dirt."""
    return np.random.default_rng(np.random.SeedSequence(int(key), spawn_key=number))


def blur_samples(
    sensor: LineSensor, exposure_time: float, headings: FloatArray, velocities: FloatArray
) -> IntArray:
    """Return the number of instants at which the exposure of each line is rendered, shape (m,).

    Between two instants, the footprint moves by at most a quarter of a pixel along its axis and a
    sixteenth of its width across the axis. The number is rounded up to a power of two and limited
    to 128.

    Args:
        sensor: the camera, with its true field of view.
        exposure_time: duration of an exposure [s].
        headings: direction of the camera's axis in the world [rad], shape (m,).
        velocities: velocity of the footprint's center along x and y of the world, and yaw rate
            [m/s, m/s, rad/s], shape (m, 3).
    """
    cosine, sine = np.cos(headings), np.sin(headings)
    along = np.abs(cosine * velocities[:, 0] + sine * velocities[:, 1])
    across = np.abs(cosine * velocities[:, 1] - sine * velocities[:, 0])
    across += 0.5 * sensor.length * np.abs(velocities[:, 2])
    wanted = exposure_time * np.maximum(
        _SAMPLES_PER_PIXEL * along / sensor.pixel_pitch, _SAMPLES_PER_WIDTH * across / sensor.width
    )
    exponent = np.ceil(np.log2(np.clip(wanted, 1.0, _MOST_SAMPLES)) - 1e-9)
    return np.asarray(2 ** exponent.astype(np.int64))


def instants(samples: int, exposure_time: float) -> FloatArray:
    """Return the times within an exposure, relative to the line's stamp [s], shape (samples,).

    The times are the centers of equal parts of the exposure.
    """
    middles: FloatArray = (np.arange(samples) + 0.5) / samples - 0.5
    return middles * exposure_time
