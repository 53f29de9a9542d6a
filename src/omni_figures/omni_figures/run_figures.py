"""The two figures of every run of an experiment."""

from collections.abc import Mapping
from pathlib import Path

from omni_figures.scene import GroundPatch, Scene
from omni_figures.style import save_figure
from omni_figures.time_series import time_series
from omni_figures.top_view import top_view
from omni_loop import experiment, history

TOP_VIEW = "top_view.png"
TIME_SERIES = "time_series.png"


def draw_run_figures(
    configurations: Mapping[str, experiment.ExperimentConfiguration],
    histories: Mapping[str, history.RunHistory],
    folder: Path,
) -> list[Path]:
    """Draw top view and time series of the runs, like Figures 24 and 31 of the dissertation.

    Args:
        configurations: configurations keyed by variant; vehicle and ground are taken from the first
            one.
        histories: time history of each variant's run, keyed by variant, in the order of the panels.
        folder: folder for the files.

    Returns:
        Paths of the written files.
    """
    first = next(iter(configurations.values()))
    figures = {
        TOP_VIEW: top_view(scene_of(first), histories, title=first.description),
        TIME_SERIES: time_series(histories, title=first.description),
    }
    return [save_figure(figure, folder / name) for name, figure in figures.items()]


def scene_of(configuration: experiment.ExperimentConfiguration) -> Scene:
    """Return the vehicle and ground of an experiment as a `Scene`."""
    vehicle = configuration.vehicle
    center = vehicle.masses.center
    return Scene(
        chassis_length=vehicle.chassis_length,
        chassis_width=vehicle.chassis_width,
        wheels=vehicle.wheels,
        center_of_gravity=(float(center[0]), float(center[1])),
        load=(vehicle.load.x, vehicle.load.y) if vehicle.load.mass > 0.0 else None,
        patches=tuple(map(GroundPatch.of, configuration.ground.patches.values())),
    )
