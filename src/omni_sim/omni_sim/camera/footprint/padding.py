"""Ground texture prepared for the line cameras: padded, transposed, and at several resolutions.

In a coarser texture, each texel is the exact mean over its area, so the integral over every area
that is composed of texels is preserved. The number of texels per period is arbitrary: a new texel
contains a share of each old texel that its edges cut. All these computations use integers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_core.configuration import ConfigurationError
from omni_core.kernels import kernel
from omni_core.sensors import LineSensor
from omni_sim.camera.footprint import rows
from omni_sim.texture.texture import GroundTexture


@kernel
def average_texels(gray: NDArray[np.uint8], middle: int, averages: NDArray[np.int8]) -> None:
    """Average a texture over coarser texels, and write the rounded means minus `middle`.

    They are written to ``averages[:, :len(averages)]``. Fractions of one half are rounded
    alternately up and down, in a checkerboard pattern. Always rounding up would increase the means
    of 2 x 2 texels by an eighth of a gray level.

    Args:
        gray: gray levels of the texture, shape (n, n).
        middle: gray level that is stored as 0.
        averages: output, one row per coarse texel in a period, at most n rows.
    """
    fine, coarse = len(gray), len(averages)
    # A fine texel is `coarse` units long, a coarse one `fine` units.
    area = np.int64(fine) * fine
    sums = np.empty(fine, np.int32)
    for i in range(coarse):
        sums[:] = 0
        low = i * fine
        for j in range(low // coarse, (low + fine - 1) // coarse + 1):
            share = np.int32(min(low + fine, (j + 1) * coarse) - max(low, j * coarse))
            row = gray[j]
            for c in range(fine):
                sums[c] += share * np.int32(row[c])
        j = 0
        for k in range(coarse):
            end = (k + 1) * fine
            at = k * fine
            total = np.int64(0)
            while at < end:
                until = min(end, (j + 1) * coarse)
                total += (until - at) * np.int64(sums[j])
                at = until
                if at == (j + 1) * coarse:
                    j += 1
            rounded = (2 * total + area - ((i + k) & 1)) // (2 * area)
            averages[i, k] = rounded - middle


LEAST_WIDTH = 10.0
"""Minimum width of a footprint for which the integral is accurate enough [texels]."""

_CACHE_LINE = 64  # bytes
# Number of texels that may be read beyond the footprint's length times sqrt(2): room for the
# corners of the footprint, and for the two blocks of columns in which the rows of the integral end.
_MARGIN = 2 * 8 + 3 * rows.BLOCK


class Coarsening(NamedTuple):
    """Rules for the use of texels that are coarser than the texels of the ground.

    The texels must satisfy one of two conditions, `sufficient` or `wide`. Each condition consists
    of a minimum number of texels per pixel along the axis, and a minimum number of texels across
    the footprint.

    Attributes:
        sufficient: condition for any footprint.
        wide: condition that only wide footprints satisfy; it permits nearly one texel per pixel.
        most: limit on the number of texels per period, which limits the memory.
        worth: ratio of coarse to fine texel size below which fine texels are used [1].
        whole: limit on the factor by which the number of coarse texels may be increased so that
            each of them consists of whole texels of the ground [1].
    """

    sufficient: tuple[float, float] = (4.0, 128.0)
    wide: tuple[float, float] = (1.15, 450.0)
    most: int = 9472
    worth: float = 1.25
    whole: float = 1.1


_COARSENING = Coarsening()


class PaddedTexture(NamedTuple):
    """A periodic texture prepared for `integrate_lines`.

    Attributes:
        rows: gray levels minus `middle`, row by row; each row is continued periodically to `stride`
            texels.
        columns: transposed texture in the layout of `rows`.
        middle: gray level stored as 0; it is near the mean, so that rounding of weights has little
            effect.
        texels: texels per period.
        stride: number of texels in a padded row.
        texel: edge length of a texel [m].
        reach: length of the longest footprint that can be integrated [m].
        averaged: whether the texels are means of finer texels.
    """

    rows: NDArray[np.int8]
    columns: NDArray[np.int8]
    middle: int
    texels: int
    stride: int
    texel: float
    reach: float
    averaged: bool

    @classmethod
    def build(cls, texture: GroundTexture, reach: float, texels: int = 0) -> PaddedTexture:
        """Return a texture that is prepared for `integrate_lines`.

        The ground is not copied, because it may occupy a third of a gigabyte.

        Args:
            texture: the ground.
            reach: longest footprint that will be integrated [m].
            texels: number of texels per period, at most that of the ground; 0 for that of the
                ground.
        """
        texels = texels or len(texture.gray)
        texel = texture.size / texels
        columns = math.ceil(math.sqrt(2.0) * reach / texel) + _MARGIN
        # The number of cache lines per row is odd, because a power of two would map all rows to a
        # few sets of the cache.
        stride = (math.ceil((texels + columns) / _CACHE_LINE) | 1) * _CACHE_LINE
        gray = texture.gray
        middle = min(max(round(float(gray.mean())), int(gray.max()) - 127), int(gray.min()) + 128)
        rows = _room(texels, stride)
        if texels == len(gray):
            # Modulo 256 gives the two's complement.
            np.subtract(gray, np.uint8(middle), out=rows[:, :texels].view(np.uint8))
        else:
            average_texels(gray, middle, rows)
        turned = _room(texels, stride)
        for first in range(0, texels, _CACHE_LINE):
            # A band that is copied first stays in the cache while it is transposed.
            band = np.ascontiguousarray(rows[:, first : min(first + _CACHE_LINE, texels)])
            turned[first : first + _CACHE_LINE, :texels] = band.T
        for padded in (rows, turned):
            for start in range(texels, stride, texels):
                end = min(start + texels, stride)
                padded[:, start:end] = padded[:, : end - start]
        averaged = texels < len(gray)
        layout = rows.reshape(-1), turned.reshape(-1), middle, texels, stride
        return cls(*layout, texel, reach, averaged)


def _room(texels: int, stride: int) -> NDArray[np.int8]:
    """Return an uninitialized array, shape (texels, stride), with rows aligned to cache lines."""
    room = np.empty(texels * stride + _CACHE_LINE, np.int8)
    first = -room.ctypes.data % _CACHE_LINE
    return room[first : first + texels * stride].reshape(texels, stride)


def padded_levels(
    sensors: Mapping[str, LineSensor], texture: GroundTexture, headroom: float = 1.0
) -> dict[str, PaddedTexture]:
    """Return a padded ground for each camera, keyed by name.

    The texels are as coarse as the camera's accuracy permits.

    Args:
        sensors: cameras, keyed by name.
        texture: the ground.
        headroom: limit on the factor by which heave of the chassis lengthens the fields of view
            [1].

    Raises:
        ConfigurationError: a footprint exceeds the period of the texture or is narrower than 10
            texels.
    """
    check_footprints(sensors, texture)
    texels = {name: _texels(sensor, texture) for name, sensor in sensors.items()}
    padded = {}
    for count in sorted(set(texels.values())):
        longest = max(sensors[name].length for name in sensors if texels[name] == count)
        padded[count] = PaddedTexture.build(texture, headroom * longest, count)
    return {name: padded[count] for name, count in texels.items()}


def check_footprints(sensors: Mapping[str, LineSensor], texture: GroundTexture) -> None:
    """Check that the footprints of all sensors fit into the texture of a ground.

    Raises:
        ConfigurationError: a footprint exceeds the period of the texture or is narrower than 10
            texels.
    """
    for name, sensor in sensors.items():
        for field in ("length", "width"):
            if getattr(sensor, field) > texture.size:
                raise ConfigurationError(
                    f"sensors.{name}.{field}",
                    f"{getattr(sensor, field):g} m is more than the ground's period of "
                    f"{texture.size:g} m",
                )
        if sensor.width < LEAST_WIDTH * texture.texel:
            raise ConfigurationError(
                f"sensors.{name}.width",
                f"{sensor.width:g} m is less than {LEAST_WIDTH:g} texels of the ground, "
                f"{texture.texel:g} m each",
            )


def _texels(sensor: LineSensor, texture: GroundTexture) -> int:
    """Return the number of texels per period that the texture for a camera must have.

    A coarse texel has only the mean of the gray levels within it. This causes an error only where
    the edge of a pixel cuts the texel; the error is proportional to the contrast within the texel.
    On most grounds, the errors of different texels are independent. The error of a pixel is
    therefore proportional to the ratio of texel size to pixel pitch, and to the inverse square root
    of the number of texels across the footprint. On wood, if the line is across the grain, the
    errors of these texels are equal and are not averaged out. This case determines the smallest
    number of texels per pixel.
    """
    rules = _COARSENING
    coarsest = max(
        min(sensor.pixel_pitch / per_pixel, sensor.width / across)
        for per_pixel, across in (rules.sufficient, rules.wide)
    )
    texels = len(texture.gray)
    if coarsest >= rules.worth * texture.texel:
        needed = min(math.ceil(texture.size / coarsest - 1e-6), rules.most)
        # Texels composed of whole texels of the ground preserve fine edges better.
        whole = texels // needed
        texels = texels // whole if texels % whole == 0 else needed
        texels = texels if texels <= rules.whole * needed else needed
    return min(texels, rules.most)
