"""``./omni nav2-polygons``: compute polygons of the collision monitor from simulated stops.

Simulate thousands of stops of a vehicle. For each direction, speed and yaw rate, write the area
that the vehicle's footprint covers, including rotation, as YAML for Nav2's collision monitor.
"""

from pathlib import Path

from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report, make_folder, write_text
from omni_runs.workspace import ExperimentWorkspace
from omni_tools.stopping_area.options import AreaOptions


class Options(AreaOptions, CommandOptions):
    """Options of ``omni nav2-polygons``."""

    out: Path | None = option(None, metavar="DIR")
    """folder for YAML, picture and stops (default: results/nav2-polygons/VEHICLE)"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Simulate the stops, write the areas and check them."""
    from omni_runs.experiment import short_name
    from omni_runs.figures.style import save_figure
    from omni_runs.metrics import results_entry
    from omni_tools.campaign.runner import run_campaign
    from omni_tools.stopping_area import collision_monitor
    from omni_tools.stopping_area.area import Sweep, areas, inside
    from omni_tools.stopping_area.figure import areas_figure

    name = short_name(options.vehicle)
    campaign = collision_monitor.stop_campaign(options, workspace.checked_experiments())
    folder = make_folder(workspace.results(options.out, "nav2-polygons", name))
    with workspace.progress() as report:
        sweeps = run_campaign(
            campaign.stop,
            range(campaign.fitted + options.held_out),
            Sweep,
            options,
            folder / "stops.csv",
            campaign.fingerprint,
            report,
        )
    if options.seeds:
        words = f"{len(sweeps)} stops are kept in {folder}; combine the parts with --merge"
        return Report(text=(words,))
    limits = areas(campaign, sweeps) + options.padding
    held_out = sweeps[campaign.fitted :]
    stays = inside(campaign, limits, held_out)
    metrics = collision_monitor.area_metrics(options, campaign, limits, held_out, stays.tolist())
    document = collision_monitor.monitor_parameters(options, campaign.cells, limits, metrics)
    title = f"{name}, {options.variant}"
    figure = areas_figure(campaign.cells, limits, campaign.base.vehicle, title)
    found = [metric.value for key, metric in metrics.items() if key.startswith("area.")]
    text = [
        f"{len(campaign.cells)} polygons of {min(found):.2f} to {max(found):.2f} m^2, "
        f"{options.variant}, from {campaign.fitted} stops: at least {options.coverage:.2%} of "
        f"stops stay inside, with a confidence of {options.confidence:.0%} for each polygon"
    ]
    for case in ("uniform", "extremes"):
        if count := metrics[f"held_out_stops.{case}"].value:
            share = metrics[f"outside_share.{case}"].value
            text.append(f"held out, {case}: {share:.2%} of {count:.0f} stops leave their polygon")
    return Report(
        name="nav2-polygons",
        metrics={key: results_entry(metric) for key, metric in metrics.items()},
        text=text,
        files=(
            write_text(folder / "collision_monitor.yaml", document),
            save_figure(figure, folder / "areas.png"),
            folder / "stops.csv",
        ),
        summary=folder,
    )
