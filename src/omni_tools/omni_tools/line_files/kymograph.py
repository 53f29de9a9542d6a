"""Kymograph of a line camera: lines over time, with displacements and correlations."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.matching import search, subpixel
from linescan_odometry.measurements import SensorReading
from linescan_odometry.sensor import SensorOdometry
from omni_core import quantities, signals
from omni_core.sensors import LineSensor
from omni_runs.figures import style


class Kymograph(NamedTuple):
    """Lines of one camera over time, and the odometry's estimates from these lines.

    Attributes:
        sensor: the camera.
        lines: lines of the camera, oldest first, shape (m, n).
        time: time of each line [s], shape (m,).
        displacement: displacement of each line from the previous one [px], shape (m - 1,); NaN if
            the lines do not match.
        correlation: correlation of each pair of lines at its displacement [1], shape (m - 1,).
        ends: time of the newest line of each batch [s], shape (b,).
        readings: odometry's estimate of each batch, length b.
    """

    sensor: LineSensor
    lines: signals.Lines
    time: quantities.FloatArray
    displacement: quantities.FloatArray
    correlation: quantities.FloatArray
    ends: quantities.FloatArray
    readings: tuple[SensorReading, ...]

    @property
    def measured(self) -> float:
        """Share of the batches that have a valid measurement, 0 to 1."""
        return float(np.mean([reading.measured for reading in self.readings]))


def match_lines(
    sensor: LineSensor, batches: Sequence[signals.LineBatch], configuration: OdometryConfiguration
) -> Kymograph:
    """Return the lines of one camera and their displacements in consecutive batches.

    Args:
        sensor: the camera.
        batches: recorded batches; batches without lines are omitted.
        configuration: configuration of the odometry.
    """
    odometry = SensorOdometry(sensor, configuration)
    readings = tuple(odometry.update(batch) for batch in batches)
    whole = [batch for batch in batches if batch.lines.shape[1:] == (sensor.pixels,)]
    lines: signals.Lines = np.ascontiguousarray(np.concatenate([batch.lines for batch in whole]))
    period = 1.0 / sensor.line_rate
    time = np.concatenate(
        [1e-9 * b.stamp_ns + period * np.arange(1 - len(b.lines), 1) for b in whole]
    )
    pairs = search.PairMatcher(
        search.METRICS[configuration.metric](configuration.shift_limit(sensor)),
        subpixel.SubpixelRefiner(sensor.pixels),
        configuration.minimum_correlation,
    ).match(lines)
    joined = np.abs(np.diff(time) - period) < 0.5 * period
    displacement = np.where(pairs.usable & joined, pairs.displacement, np.nan)
    ends = np.array([1e-9 * batch.stamp_ns for batch in batches])
    return Kymograph(sensor, lines, time, displacement, pairs.similarity, ends, readings)


def draw_kymographs(kymographs: Mapping[str, Kymograph], title: str, most: int = 1200) -> Figure:
    """Draw a row for each camera: lines over time, displacements and correlations.

    Args:
        kymographs: lines and estimates, keyed by camera name.
        title: title of the figure.
        most: limit on the number of lines in a picture.
    """
    size = (13.0, 0.8 + 3.6 * len(kymographs))
    figure, panels = style.panels(
        title, len(kymographs), 3, size=size, y="time [s]", width_ratios=(1.5, 1.0, 0.7)
    )
    for (seen, moved, similarity), (name, kymograph) in zip(
        panels, kymographs.items(), strict=True
    ):
        step = -(-len(kymograph.lines) // most)
        begin, end = float(kymograph.time[0]), float(kymograph.time[-1])
        seen.grid(False)
        seen.imshow(
            kymograph.lines[::step], cmap="gray", aspect="auto", interpolation="antialiased",
            extent=(0.0, 1e3 * kymograph.sensor.length, end, begin),
        )  # fmt: skip
        seen.set_xlabel("along the axis [mm]")
        seen.set_title(f"{name}: lines over time")
        _draw_displacements(moved, kymograph)
        similarity.plot(kymograph.correlation, kymograph.time[1:], ".", ms=2.0, color=style.BLUE)
        similarity.set_xlim(-0.05, 1.05)
        similarity.set_xlabel("correlation [1]")
        for axes in (moved, similarity):
            axes.set_ylim(end, begin)
    style.legend_below(figure, 3, markerscale=3.0)  # on the axes it would cover points
    return figure


def _draw_displacements(axes: Axes, kymograph: Kymograph) -> None:
    label = "of each pair of lines"
    times = kymograph.time[1:]
    axes.plot(kymograph.displacement, times, ".", ms=2.0, color=style.GRAY, label=label)
    scale = kymograph.sensor.pixel_pitch * kymograph.sensor.line_rate
    velocity = np.array([r.velocity if r.measured else np.nan for r in kymograph.readings])
    axes.plot(
        velocity / scale, kymograph.ends, "-", color=style.ORANGE, lw=1.4, label="of the batch"
    )
    lost = kymograph.ends[np.isnan(velocity)]
    if lost.size:
        # Drawn at the left edge of the axes, independent of the displacements.
        axes.plot(
            np.zeros(len(lost)), lost, "x", ms=4.0, color=style.VERMILLION, label="not measured",
            transform=axes.get_yaxis_transform(), clip_on=False,
        )  # fmt: skip
    axes.set_xlabel("displacement [px]")
    title = f"1 px/line = {scale:.3g} m/s; {100.0 * kymograph.measured:.0f} % of batches measured"
    axes.set_title(title)
    axes.locator_params(axis="x", nbins=5)  # labels such as 25.525 are wide
