"""Sensor noise and quantization of rendered lines.

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

import numpy as np

from omni_core.kernels import kernel
from omni_core.quantities import Float32Array
from omni_core.signals import Lines
from omni_sim.camera.configuration import FULL_SCALE, CameraConfiguration

_TABLE_BITS = 12


def expose(
    grays: Float32Array, camera: CameraConfiguration, key: np.uint64, first_line: int
) -> Lines:
    """Return ``gain gray + offset + noise``, rounded and clipped, shape (m, pixels).

    With 16 bits, the value 65535 corresponds to the gray level 255.

    Args:
        grays: gray levels of the ground on the 8-bit scale, shape (m, pixels).
        camera: gain, offset, noise and bit depth.
        key: key of the sensor's noise, see `camera.noise_key`.
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
