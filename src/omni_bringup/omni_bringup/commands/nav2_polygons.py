"""``./omni nav2-polygons``: compute the collision monitor's polygons from simulated stops.

Brake a vehicle thousands of times and write the area that it needs to stop, with footprint and
swerve, for each direction, speed and turn, in the YAML of Nav2's collision monitor.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from omni_analysis.campaign.runner import CampaignError, CampaignOptions
from omni_bringup.exit_codes import EXIT_FAILED, EXIT_OK
from omni_bringup.noting import noting_library
from omni_platform.command_options import json_option, option, overrides_option
from omni_platform.configuration import ConfigurationError, parameter

if TYPE_CHECKING:
    from omni_analysis.braking.stopping_area import Cell, StopCampaign, Sweep
    from omni_analysis.loop.metrics import Metric
    from omni_platform.quantities import FloatArray

_ROUNDING = 0.001  # [m] by which an area grows, so that rounded corners cut nothing off
# Section 3.5 and straight_line: the enhanced weighting with k = 7.
_ASSISTANT = ("brake_assist.weighting=enhanced", "brake_assist.k=7")
_LONGEST = 120.0  # [s] that a stop may take


@dataclass(frozen=True, kw_only=True)
class Options(CampaignOptions):
    """Options of ``omni nav2-polygons``."""

    vehicle: str = parameter(
        "mecanum_forklift",
        description="a file of config/vehicles/, or a path that ends in .yaml; its load is taken "
        "for the heaviest one, at its farthest place from the centre",
    )
    unassisted: bool = parameter(False, description="without the brake assistant")
    speed: float = parameter(
        2.0, description="largest, in every direction", unit="m/s", above=0.0, maximum=20.0
    )
    bands: int = parameter(
        4,
        description="of speed; with 1 the ranges also fit collision monitors before 2026, which "
        "compare v_x instead of the speed",
        minimum=1,
        maximum=20,
    )
    yaw_rate: float = parameter(
        0.5, description="largest, to either side", unit="rad/s", above=0.0, maximum=10.0
    )
    turns: int = parameter(3, description="bands of the yaw rate", minimum=1, maximum=9)
    friction_min: float = parameter(
        0.6, description="lowest of the ground, as a factor", minimum=0.05, maximum=2.0
    )
    friction_max: float = parameter(
        1.0, description="highest of the ground, as a factor", minimum=0.05, maximum=2.0
    )
    reaction_time: float = parameter(
        0.2,
        description="from an obstacle in the area to the pedal: sensor, monitor, network",
        unit="s",
        minimum=0.0,
        maximum=5.0,
    )
    padding: float = parameter(
        0.0, description="added around every area", unit="m", minimum=0.0, maximum=5.0
    )
    coverage: float = parameter(
        0.99,
        description="share of stops that stay within the area of their motion",
        minimum=0.5,
        maximum=0.9999,
    )
    confidence: float = parameter(
        0.95, description="with which each area has it", minimum=0.5, maximum=0.9999
    )
    held_out: int = parameter(
        10_000, description="further stops by which the areas are checked", minimum=0
    )
    seed: int = parameter(1, description="of everything drawn", minimum=0)
    overrides: tuple[str, ...] = overrides_option("vehicle.brake.max_torque=900")
    out: Path | None = option(
        None,
        metavar="DIR",
        description="folder of YAML, picture and stops (default: results/nav2-polygons/VEHICLE)",
    )
    json: bool = json_option()

    def check_consistency(self) -> None:
        """Refuse frictions in the wrong order."""
        super().check_consistency()
        if self.friction_min > self.friction_max:
            raise ConfigurationError("--friction-min", "must not be above --friction-max")


def run(options: Options, workspace: Path) -> int:
    """Brake, write the areas and check them; return the exit code."""
    from omni_analysis.braking.stopping_area import Sweep, areas, inside
    from omni_analysis.braking.stopping_area_figure import areas_figure
    from omni_analysis.campaign.runner import run_campaign
    from omni_analysis.figures.style import save_figure
    from omni_analysis.loop.metrics import results_entry
    from omni_bringup.progress_bar import progress_bar

    name = Path(options.vehicle).stem
    folder: Path = options.out or workspace / "results" / "nav2-polygons" / name
    campaign = _campaign(options, workspace)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with progress_bar("nav2-polygons") as report:
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
            print(f"{len(sweeps)} stops are kept in {folder}; --merge puts pieces together")
            return EXIT_OK
        limits = areas(campaign, sweeps) + options.padding
        held_out = sweeps[campaign.fitted :]
        stays = inside(campaign, limits, held_out)
        metrics = _metrics(options, campaign, limits, held_out, stays.tolist())
        file = folder / "collision_monitor.yaml"
        file.write_text(_file(options, name, campaign.cells, limits, metrics), encoding="utf-8")
        figure = areas_figure(
            campaign.cells, limits, campaign.base.vehicle, f"{name}, {_variant(options)}"
        )
        picture = save_figure(figure, folder / "areas.png")
        document = {
            "name": "nav2-polygons",
            "metrics": {key: results_entry(metric) for key, metric in metrics.items()},
        }
        text = json.dumps(document, indent=2, allow_nan=False)
        (folder / "summary.json").write_text(text + "\n")
    except (OSError, CampaignError) as error:
        print(f"omni nav2-polygons: {error}", file=sys.stderr)
        return EXIT_FAILED
    if options.json:
        print(text)
    else:
        _print(options, campaign, metrics)
        print(f"wrote {file}\nwrote {picture}")
    return EXIT_OK


def _campaign(options: Options, workspace: Path) -> StopCampaign:
    from omni_analysis.braking.stopping_area import (
        HULL_STOPS,
        StopCampaign,
        calibration_stops,
        make_cells,
    )

    fixed = [
        f"vehicle={options.vehicle}",
        "feedback=velocity_sensor",
        "simulation.render_lines=false",
        f"simulation.duration_limit={_LONGEST}",
        *_ASSISTANT,
        *options.overrides,
        f"brake_assist.enabled={str(not options.unassisted).lower()}",
    ]
    return StopCampaign(
        base=noting_library(workspace, "omni nav2-polygons").load(
            "straight_line", "assisted", fixed
        ),
        cells=make_cells(options.speed, options.bands, options.yaw_rate, options.turns),
        friction=(options.friction_min, options.friction_max),
        reaction_time=options.reaction_time,
        per_cell=HULL_STOPS + calibration_stops(options.coverage, options.confidence),
        seed=options.seed,
    )


def _variant(options: Options) -> str:
    return "unassisted" if options.unassisted else "assisted"


def _metrics(
    options: Options,
    campaign: StopCampaign,
    limits: FloatArray,
    held_out: Sequence[Sweep],
    stays: Sequence[bool],
) -> dict[str, Metric]:
    import numpy as np

    from omni_analysis.braking.stopping_area import corners
    from omni_analysis.loop.metrics import Metric
    from omni_platform.geometry import cross

    allowed = round(1.0 - options.coverage, 12)  # not 0.010000000000000009
    extreme = [campaign.extreme(sweep.seed) for sweep in held_out]
    metrics = {}
    for case, kinds in (("uniform", (False,)), ("extremes", (True,)), ("all", (False, True))):
        chosen = [stay for stay, kind in zip(stays, extreme, strict=True) if kind in kinds]
        metrics[f"held_out_stops.{case}"] = Metric(len(chosen), "1")
        share = 1.0 - sum(chosen) / len(chosen) if chosen else math.nan
        metrics[f"outside_share.{case}"] = Metric(share, "1", limit=allowed)
    metrics["confidence.each_polygon"] = Metric(options.confidence, "1")
    for cell, limit in zip(campaign.cells, limits, strict=True):
        points = corners(limit)
        area = 0.5 * float(np.sum(cross(points, np.roll(points, -1, axis=0))))
        metrics[f"area.{cell.name}"] = Metric(area, "m^2")
    return metrics


def _file(
    options: Options,
    name: str,
    cells: Sequence[Cell],
    limits: FloatArray,
    metrics: dict[str, Metric],
) -> str:
    """Return the parameters of the collision monitor."""
    from omni_analysis.braking.stopping_area import corners

    outside, count = metrics["outside_share.all"].value, metrics["held_out_stops.all"].value
    checked = f"# Of {count:.0f} stops held out {outside:.2%} left theirs.\n" if count else ""
    # Monitors that compare v_x see all from -speed to speed in one band.
    lowest = -options.speed if options.bands == 1 else 0.0
    lines = [
        f"# Stopping areas of {name}, {_variant(options)}, full braking {options.reaction_time:g} s"
        " after the alarm, in base_link.",
        f"# At least {options.coverage:.2%} of stops stay within the polygon of their motion, with "
        f"a confidence of {options.confidence:.0%} for each polygon:",
        f"# friction {options.friction_min:g} to {options.friction_max:g}, any load up to that of "
        "the vehicle's file, up to its place.",
        f"{checked}collision_monitor:",
        "  ros__parameters:",
        "    polygons: [VelocityPolygonStop]",
        "    VelocityPolygonStop:",
        "      type: velocity_polygon",
        "      action_type: stop",
        "      min_points: 4",
        "      visualize: true",
        "      enabled: true",
        "      polygon_pub_topic: velocity_polygon_stop",
        "      holonomic: true",
        "      velocity_polygons:",
        *(f"        - {cell.name}" for cell in cells),
    ]
    for cell, limit in zip(cells, limits, strict=True):
        points = ", ".join(f"[{x:.3f}, {y:.3f}]" for x, y in corners(limit + _ROUNDING))
        lines += [
            f"      {cell.name}:",
            f'        points: "[{points}]"',
            f"        linear_min: {min(lowest, cell.speed[0]):.4f}",
            f"        linear_max: {cell.speed[1]:.4f}",
            f"        theta_min: {cell.yaw_rate[0]:.4f}",
            f"        theta_max: {cell.yaw_rate[1]:.4f}",
            f"        direction_start_angle: {cell.direction[0]:.5f}",
            f"        direction_end_angle: {cell.direction[1]:.5f}",
        ]
    return "\n".join(lines) + "\n"


def _print(options: Options, campaign: StopCampaign, metrics: dict[str, Metric]) -> None:
    areas = [metric.value for key, metric in metrics.items() if key.startswith("area.")]
    print(
        f"{len(campaign.cells)} polygons of {min(areas):.2f} to {max(areas):.2f} m^2, "
        f"{_variant(options)}, from {campaign.fitted} stops: at least {options.coverage:.2%} of "
        f"stops stay inside, with a confidence of {options.confidence:.0%} for each polygon"
    )
    for case in ("uniform", "extremes"):
        count = metrics[f"held_out_stops.{case}"].value
        if count:
            share = metrics[f"outside_share.{case}"].value
            print(f"held out, {case}: {share:.2%} of {count:.0f} stops leave their polygon")
