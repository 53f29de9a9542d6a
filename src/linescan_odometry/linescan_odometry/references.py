"""Reference tables of a camera: dark signal, gain of each pixel, fixed pattern of an earlier run.

The dark signal is measured with a covered camera, and the gains with an evenly lit white surface.
Both are used to correct lines before a measurement. Pixels that receive hardly any light are
interpolated. Dirt, shadows and mud are not part of the references; they are estimated together with
the displacement. The file with the tables may also contain the fixed pattern that was estimated in
an earlier run; the estimator then starts with this pattern.
"""

from pathlib import Path

import numpy as np

from linescan_odometry.joint.spectra import FixedPattern
from omni_core.quantities import BoolArray, FloatArray
from omni_core.signals import LineBatchError, Lines

_STRONGEST = 4.0  # limit on the gain; a pixel that needs a larger one counts as dead


class References:
    """Corrects the lines of one camera for the camera's dark signal and gains.

    Attributes:
        dark: dark signal [gray levels], shape (n,).
        gain: gain of each pixel [1], shape (n,).
        dead: whether each pixel is dead and therefore interpolated, shape (n,).
        pattern: fixed pattern from an earlier run, or None.
    """

    def __init__(self, pixels: int) -> None:
        """Create references that leave lines unchanged.

        Args:
            pixels: number of pixels n of a line.
        """
        self.dark: FloatArray = np.zeros(pixels)
        self.gain: FloatArray = np.ones(pixels)
        self.dead: BoolArray = np.zeros(pixels, np.bool_)
        self.pattern: FixedPattern | None = None

    @property
    def white(self) -> bool:
        """Whether the gains of the pixels are known from a white reference."""
        return bool((self.gain != 1.0).any())

    def take(self, dark: Lines | None, white: Lines | None) -> None:
        """Compute dark signal and gains from lines of a covered camera and a white surface.

        Args:
            dark: lines without light [gray levels], shape (m, n); None for no dark signal.
            white: lines of an evenly lit surface, shape (m, n); None for equal gains.

        Raises:
            LineBatchError: the lines have another number of pixels than the camera, or the white
                lines are not brighter than the dark lines.
        """
        pixels = len(self.dark)
        for lines in (dark, white):
            if lines is not None and lines.shape[1:] != (pixels,):
                raise LineBatchError(
                    f"reference lines must have the shape (m, {pixels}), not {lines.shape}"
                )
        self.dark = np.zeros(pixels) if dark is None else dark.mean(axis=0)
        if white is not None:
            light = white.mean(axis=0) - self.dark
            if light.mean() <= 0.0:
                raise LineBatchError("the white reference is no brighter than the dark one")
            relative = light / light.mean()
            self.dead = relative < 1.0 / _STRONGEST
            self.gain = 1.0 / np.maximum(relative, 1.0 / _STRONGEST)

    def save(self, path: Path) -> None:
        """Write the references to a NumPy file (.npz)."""
        none = FixedPattern(np.zeros(0, np.complex64), np.zeros(0))
        pattern = none if self.pattern is None else self.pattern
        np.savez(path, dark=self.dark, gain=self.gain, dead=self.dead, **pattern._asdict())

    def load(self, path: Path) -> None:
        """Read the references from a file that `save` has written.

        Raises:
            LineBatchError: the references are invalid, or have another number of pixels than the
                camera.
        """
        try:
            with np.load(path, allow_pickle=False) as file:
                tables = dict(file)
            dark, gain, dead = (tables[name] for name in ("dark", "gain", "dead"))
            pattern = FixedPattern(tables["information"], tables["precision"])
        except (OSError, ValueError, KeyError) as error:
            raise LineBatchError(f"{path} contains no tables of a camera: {error}") from None
        if len(dark) != len(self.dark):
            raise LineBatchError(
                f"{path} has tables for {len(dark)} px, but this camera has {len(self.dark)} px"
            )
        self.dark, self.gain, self.dead = dark, gain, dead
        self.pattern = pattern if len(pattern.precision) else None

    def correct(self, lines: Lines) -> Lines:
        """Return lines corrected for dark signal and gains, with 16 bits.

        At a gain of 1, the lines use a quarter of the 16-bit range, so that pixels with larger
        gains do not saturate. Without references, the given lines are returned.

        Args:
            lines: m lines of n pixels, shape (m, n).
        """
        if not self.dark.any() and not self.white:
            return lines
        scale = 64.0 if lines.dtype == np.uint8 else 0.25
        light = (lines - self.dark) * (scale * self.gain)
        if self.dead.any():
            place = np.arange(len(self.dead))
            sound = ~self.dead
            for row in light:
                row[self.dead] = np.interp(place[self.dead], place[sound], row[sound])
        corrected: Lines = np.rint(light).clip(0.0, 65535.0).astype(np.uint16)
        return corrected
