"""A ground texture prepared for the line cameras: padded, in both orientations, in levels."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_platform.configuration import ConfigurationError
from omni_platform.sensors import LineSensor
from omni_sim.camera.footprint import average, blocks
from omni_sim.texture.texture import GroundTexture

LEAST_WIDTH = 10.0
"""Narrowest footprint that is integrated well [texels]."""

_CACHE_LINE = 64  # bytes
# Texels that may be read beyond the footprint's length times sqrt(2): room for its corners, and
# for the two blocks of columns in which the integral's runs end.
_MARGIN = 2 * 8 + 3 * blocks.BLOCK


class Coarsening(NamedTuple):
    """Rules for texels that are coarser than those of the ground.

    If many texels across a footprint are averaged, little more than one per pixel is enough.

    Attributes:
        sufficient: fewest texels per pixel along the axis, and across the footprint.
        wide: the same two numbers for a wide footprint.
        most: most texels per period; they need a quarter of a gigabyte: 20 cm at 1200 dpi.
        worth: smallest size of coarser texels over that of the ground, to be worth the error [1].
        whole: largest increase of the number of texels so that each consists of whole ones [1].
    """

    sufficient: tuple[float, float] = (4.0, 128.0)
    wide: tuple[float, float] = (1.15, 450.0)
    most: int = 9472
    worth: float = 1.25
    whole: float = 1.1


_COARSENING = Coarsening()


@dataclasses.dataclass(frozen=True)
class PaddedTexture:
    """A periodic texture prepared for `integrate_lines`.

    Attributes:
        rows: gray - middle, row after row, each continued periodically to `stride` texels.
        columns: rows of the transposed texture, in the same layout.
        middle: gray level that is stored as 0, near the mean, so that errors of weights are small.
        texels: texels per period.
        stride: length of a padded row [texels].
        texel: edge of a texel [m].
        reach: longest footprint that may be integrated [m].
        averaged: whether the texels are means of finer ones.
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
        """Prepare a texture.

        No copy is made meanwhile, because a ground may have a third of a gigabyte.

        Args:
            texture: the ground.
            reach: longest footprint that will be integrated [m].
            texels: texels per period, at most as many as the ground has; 0 for as many.
        """
        texels = texels or len(texture.gray)
        texel = texture.size / texels
        columns = math.ceil(math.sqrt(2.0) * reach / texel) + _MARGIN
        # An odd number of cache lines per row: a power of two would map all rows to a few sets of
        # the cache.
        stride = (math.ceil((texels + columns) / _CACHE_LINE) | 1) * _CACHE_LINE
        gray = texture.gray
        middle = min(max(round(float(gray.mean())), int(gray.max()) - 127), int(gray.min()) + 128)
        rows = _room(texels, stride)
        if texels == len(gray):
            # Modulo 256, which gives two's complement.
            np.subtract(gray, np.uint8(middle), out=rows[:, :texels].view(np.uint8))
        else:
            average.average_texels(gray, middle, rows)
        turned = _room(texels, stride)
        for first in range(0, texels, 64):
            band = rows[:, first : min(first + 64, texels)]
            turned[first : first + 64, :texels] = band.T
        for padded in (rows, turned):
            for start in range(texels, stride, texels):
                end = min(start + texels, stride)
                padded[:, start:end] = padded[:, : end - start]
        return cls(
            rows=rows.reshape(-1),
            columns=turned.reshape(-1),
            middle=middle,
            texels=texels,
            stride=stride,
            texel=texel,
            reach=reach,
            averaged=texels < len(gray),
        )

    @property
    def nbytes(self) -> int:
        """Memory held [bytes]."""
        return self.rows.nbytes + self.columns.nbytes


def _room(texels: int, stride: int) -> NDArray[np.int8]:
    """Return an array for padded rows, each aligned to a cache line."""
    room = np.empty(texels * stride + _CACHE_LINE, np.int8)
    first = -room.ctypes.data % _CACHE_LINE
    return room[first : first + texels * stride].reshape(texels, stride)


def padded_levels(
    sensors: Mapping[str, LineSensor], texture: GroundTexture, headroom: float = 1.0
) -> dict[str, PaddedTexture]:
    """Return the ground for each sensor with the coarsest texels of sufficient accuracy.

    Args:
        sensors: the cameras by name.
        texture: the ground.
        headroom: largest factor on the length of the views.

    Raises:
        ConfigurationError: a footprint is longer or wider than the period of the ground, or
            narrower than 10 texels.
    """
    check_footprints(sensors, texture)
    texels = {name: _texels(sensor, texture) for name, sensor in sensors.items()}
    padded = {}
    for count in sorted(set(texels.values())):
        longest = max(sensors[name].length for name in sensors if texels[name] == count)
        padded[count] = PaddedTexture.build(texture, headroom * longest, count)
    return {name: padded[count] for name, count in texels.items()}


def check_footprints(sensors: Mapping[str, LineSensor], texture: GroundTexture) -> None:
    """Refuse footprints that do not fit a ground.

    Raises:
        ConfigurationError: a footprint is longer or wider than the period of the ground, or
            narrower than 10 texels.
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
    """Return the texels per period that a sensor needs.

    A coarse texel loses the distribution of gray within it. This matters only where the edge of a
    pixel cuts the texel: there its error is a share of its internal contrast, on most grounds
    independent of other texels. So the error of a pixel is proportional to the texel's size over
    the pixel's pitch and to the inverse square root of the number of texels across. On wood, a line
    across the grain has the error of a single texel, which determines the smallest number per
    pixel.
    """
    rules = _COARSENING
    coarsest = max(
        min(sensor.pixel_pitch / per_pixel, sensor.width / across)
        for per_pixel, across in (rules.sufficient, rules.wide)
    )
    texels = len(texture.gray)
    if coarsest >= rules.worth * texture.texel:
        needed = min(math.ceil(texture.size / coarsest - 1e-6), rules.most)
        # Texels that consist of whole ones preserve fine edges better, if about as many are enough.
        whole = texels // needed
        texels = texels // whole if texels % whole == 0 else needed
        texels = texels if texels <= rules.whole * needed else needed
    return min(texels, rules.most)
