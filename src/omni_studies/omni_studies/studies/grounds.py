"""Pictures and spectra of all grounds, and the contrast in a wide view (Figures 59, 67).

The pictures show 100 x 100 mm of each ground. For the generic camera (50 x 20 mm, 1024 px), the
study computes the contrast of the lines, which average 20 mm across the axis, and the frequency
below which half of the power is found.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_figures import style
from omni_loop.metrics import Metric
from omni_platform import quantities, sensors
from omni_sim.camera.camera import CameraConfiguration, LineCameraArray
from omni_sim.texture.texture import GroundTexture
from omni_studies.line_trials.options import TextureOptions, grounds_of, grounds_option
from omni_studies.study import StudyResult, StudyRun

_DECADES = (0.02, 10.0)  # range of frequencies in the figure [cycles per mm]
_PHOTOGRAPHED = {"asphalt": (1.9, 3.1), "worn_asphalt": (1.9, 3.1)}
"""Contrast of photographs of asphalt, averaged over 20 mm [gray levels]."""

_GROUNDS = (
    "cork", "asphalt", "stone", "wood", "plastic", "metal", "walking_tile", "dry_earth",
    "worn_asphalt", "concrete", "wet_concrete", "gravel", "sand", "grass", "bark", "brick",
    "cobble", "planks",
)  # fmt: skip


class Options(TextureOptions):
    """Grounds, their resolution and the seed of the positions."""

    ground: tuple[str, ...] = grounds_option(*_GROUNDS)


@dataclass(frozen=True)
class Appearance:
    """Picture, contrast and spectrum of one ground.

    Attributes:
        patch: gray levels of the section that is shown, shape (k, k).
        contrast: mean standard deviation along the lines of the camera [gray levels].
        frequency: frequencies of the spectrum [cycles per mm], shape (f,).
        spectrum: mean power density of the lines [gray levels^2 mm], shape (f,).
        median_frequency: frequency below which half of the power is found [cycles per mm].
        texels_per_pixel: number of texels of the ground per pixel of the camera.
    """

    patch: quantities.FloatArray
    contrast: float
    frequency: quantities.FloatArray
    spectrum: quantities.FloatArray
    median_frequency: float
    texels_per_pixel: float


def run(options: Options, study: StudyRun) -> StudyResult:
    """Render the grounds; write the plate of pictures, the spectra and a table."""
    appearances = {
        name: _appearance(ground, options.seed)
        for name, ground in grounds_of(options, study.experiments).items()
    }
    metrics: dict[str, Metric] = {}
    for name, appearance in appearances.items():
        note = "gray levels, after a box of 20 mm"
        if name in _PHOTOGRAPHED:
            note += "; photographed {:g} to {:g}".format(*_PHOTOGRAPHED[name])
        metrics |= {
            f"contrast.{name}": Metric(appearance.contrast, "1", note=note),
            f"median_frequency.{name}": Metric(appearance.median_frequency, "1/mm"),
            f"texels_per_pixel.{name}": Metric(appearance.texels_per_pixel, "1"),
        }
    study.figure("grounds.png", _plate(appearances))
    study.plot("spectra", _spectra(appearances))
    return study.result(metrics)


def _appearance(
    texture: GroundTexture, seed: int, lines: int = 200, shown: float = 0.1, dots: int = 480
) -> Appearance:
    """Return a picture, the contrast and the spectrum of a ground.

    Args:
        texture: the ground.
        seed: seed of the positions of the lines.
        lines: number of lines.
        shown: edge of the picture on the ground [m].
        dots: edge of the picture in the figure [px].
    """
    sensor = sensors.LineSensor(x=0.0, y=0.0, heading_deg=0.0)
    cameras = LineCameraArray(
        {"eye": sensor}, texture, CameraConfiguration(noise=0.0), np.random.SeedSequence(seed)
    )
    generator = np.random.default_rng(seed)
    places = generator.uniform(0.0, texture.size, (lines, 2))
    poses = np.column_stack((places, generator.uniform(0.0, 2.0 * math.pi, lines)))
    gray = cameras.render({"eye": poses})["eye"].astype(np.float64)
    gray -= gray.mean(axis=1, keepdims=True)
    pitch = 1e3 * sensor.pixel_pitch
    window = np.hanning(sensor.pixels)
    power = np.abs(np.fft.rfft(gray * window, axis=1)) ** 2 * pitch / np.sum(window**2)
    spectrum = np.asarray(power.mean(axis=0)[1:], np.float64)
    frequency = np.asarray(np.fft.rfftfreq(sensor.pixels, pitch)[1:], np.float64)
    share = np.cumsum(spectrum) / np.sum(spectrum)
    block = max(1, round(shown / texture.texel / dots))
    count = block * max(1, round(shown / texture.texel / block))
    patch = np.tile(texture.gray, (1 + count // len(texture.gray),) * 2)[:count, :count]
    picture = patch.reshape(count // block, block, -1, block).mean(axis=(1, 3))
    return Appearance(
        np.asarray(picture, np.float64),
        float(gray.std(axis=1).mean()),
        frequency,
        spectrum,
        float(frequency[np.searchsorted(share, 0.5)]),
        sensor.pixel_pitch / texture.texel,
    )


def _panels(
    title: str, count: int, size: tuple[float, float], columns: int = 6, **look: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure with a number of panels of a size [in]."""
    rows = math.ceil(count / columns)
    whole = size[0] * columns, size[1] * rows + 0.6
    figure, grid = style.panels(title, rows, columns, size=whole, **look)
    for axes in list(grid.flat)[count:]:
        axes.set_axis_off()
    return figure, list(grid.flat)[:count]


def _plate(appearances: dict[str, Appearance]) -> Figure:
    title = "Grounds, 100 x 100 mm each (Figures 59, 67), and the contrast of lines 20 mm wide"
    figure, panels = _panels(title, len(appearances), (2.2, 2.65))
    for axes, (name, appearance) in zip(panels, appearances.items(), strict=False):
        axes.set_axis_off()
        axes.imshow(appearance.patch, cmap="gray", vmin=0.0, vmax=255.0, origin="lower")
        axes.set_title(f"{name.replace('_', ' ')}: {appearance.contrast:.1f}", pad=3.0)
    return figure


def _spectra(appearances: dict[str, Appearance]) -> Figure:
    title = (
        "Spectra of lines 20 mm wide; dashed: noise of one gray level; upright: half of the power"
    )
    words: dict[str, Any] = {
        "x": "cycles per mm",
        "y": "levels² mm",
        "sharex": True,
        "sharey": True,
    }
    figure, panels = _panels(title, len(appearances), (2.3, 2.0), **words)
    for axes, (name, appearance) in zip(panels, appearances.items(), strict=False):
        axes.loglog(appearance.frequency, appearance.spectrum, color=style.BLUE, linewidth=1.0)
        axes.axhline(
            0.5 / appearance.frequency[-1], color=style.GRAY, linestyle="--", linewidth=0.9
        )
        axes.axvline(appearance.median_frequency, color=style.VERMILLION, linewidth=0.9)
        axes.set_xlim(*_DECADES)
        axes.set_title(name.replace("_", " "), pad=3.0)
    return figure
