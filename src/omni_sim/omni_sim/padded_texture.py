"""A ground texture prepared for the line cameras: padded, in both orientations, in levels."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from omni_platform.configuration import ConfigurationError
from omni_platform.sensors import LineSensor
from omni_sim.ground_texture import GroundTexture

LEAST_WIDTH = 10.0
"""Narrowest footprint that is integrated well [texels]."""

_CACHE_LINE = 64  # bytes
_MARGIN = 48  # texels that a run may be longer than the footprint's length times sqrt(2)
_TEXELS_PER_PIXEL = 4  # a coarser level of the texture must still have that many
_TEXELS_ACROSS = 128  # and that many across the footprint
# Across a wide footprint so many texels are averaged that one for each pixel is enough.
_ENOUGH_ACROSS = 400
_MOST_TEXELS = 12288  # per period of a level, which takes up to 0.5 GB
_BAND = 512  # rows halved at a time


@dataclasses.dataclass(frozen=True)
class PaddedTexture:
    """A periodic texture prepared for `integrate_lines`.

    Attributes:
        rows: grey - middle, row after row, each continued periodically to `stride` texels.
        columns: the same of the transposed texture.
        middle: grey level kept as 0, near the mean, so that small errors of weight cost little.
        texels: texels per period.
        stride: length of a padded row [texels].
        texel: edge of a texel [m].
        reach: longest footprint that may be integrated [m].
    """

    rows: NDArray[np.int8]
    columns: NDArray[np.int8]
    middle: int
    texels: int
    stride: int
    texel: float
    reach: float

    @classmethod
    def build(cls, texture: GroundTexture, reach: float) -> PaddedTexture:
        """Prepare a texture.

        Args:
            texture: the ground.
            reach: longest footprint that will be integrated [m].
        """
        texels = len(texture.grey)
        columns = math.ceil(math.sqrt(2.0) * reach / texture.texel) + _MARGIN
        # An odd number of cache lines per row: a power of two would map all rows on a few sets.
        stride = (math.ceil((texels + columns) / _CACHE_LINE) | 1) * _CACHE_LINE
        grey = texture.grey
        middle = min(max(round(float(grey.mean())), int(grey.max()) - 127), int(grey.min()) + 128)
        centred = (grey - np.uint8(middle)).view(np.int8)  # modulo 256, as two's complement
        return cls(
            rows=_continued(centred, stride),
            columns=_continued(np.ascontiguousarray(centred.T), stride),
            middle=middle,
            texels=texels,
            stride=stride,
            texel=texture.texel,
            reach=reach,
        )

    @property
    def nbytes(self) -> int:
        """Memory held [bytes]."""
        return self.rows.nbytes + self.columns.nbytes


def halved(texture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a texture of half as many texels per period, each the rounded mean of 2 x 2.

    Halves are rounded up and down in the pattern of a chess-board: always up would brighten the
    texture by an eighth of a grey level.
    """
    result = np.empty((len(texture) // 2, texture.shape[1] // 2), np.uint8)
    for first in range(0, len(result), _BAND):
        rows = texture[2 * first : 2 * (first + _BAND)]
        total = rows[0::2, 0::2].astype(np.uint16)
        total += rows[1::2, 0::2]
        total += rows[0::2, 1::2]
        total += rows[1::2, 1::2]
        total[0::2, 0::2] += 2
        total[1::2, 1::2] += 2
        total[0::2, 1::2] += 1
        total[1::2, 0::2] += 1
        result[first : first + _BAND] = total >> 2
    return result


def padded_levels(
    sensors: Mapping[str, LineSensor], texture: GroundTexture
) -> dict[str, PaddedTexture]:
    """Return the ground for each sensor, the coarsest level that shows it the same lines.

    Raises:
        ConfigurationError: a footprint is longer or wider than the period of the ground, or
            narrower than 10 texels.
    """
    check_footprints(sensors, texture)
    levels = {name: _level(sensor, texture) for name, sensor in sensors.items()}
    padded: dict[int, PaddedTexture] = {}
    grey = texture.grey
    for level in range(max(levels.values(), default=-1) + 1):
        grey = halved(grey) if level > 0 else grey
        lengths = [sensors[name].length for name in sensors if levels[name] == level]
        if lengths:
            padded[level] = PaddedTexture.build(GroundTexture(grey, texture.size), max(lengths))
    return {name: padded[level] for name, level in levels.items()}


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


def _level(sensor: LineSensor, texture: GroundTexture) -> int:
    """Return how often a texture may be halved for a sensor."""
    texels = len(texture.grey)
    coarsest = max(
        min(sensor.pixel_pitch / _TEXELS_PER_PIXEL, sensor.width / _TEXELS_ACROSS),
        min(sensor.pixel_pitch, sensor.width / _ENOUGH_ACROSS),
    )
    level = max(0, math.floor(math.log2(coarsest / texture.texel) + 1e-9))
    while texels >> level > _MOST_TEXELS:
        level += 1
    while texels % 2**level:
        level -= 1
    return level


def _continued(texture: NDArray[np.int8], stride: int) -> NDArray[np.int8]:
    texels = len(texture)
    padded = np.empty((texels, stride), dtype=np.int8)
    for start in range(0, stride, texels):
        end = min(start + texels, stride)
        padded[:, start:end] = texture[:, : end - start]
    return padded.reshape(-1)
