"""Stopping areas as parameters of Nav2's collision monitor."""

import math
from collections.abc import Sequence

import numpy as np

from omni_core import geometry, quantities
from omni_core.kinematics import require_omni_wheels
from omni_runs.experiment import WITHOUT_CAMERAS, ExperimentLibrary, short_name
from omni_runs.metrics import Metric
from omni_runs.yaml_files import commented_yaml
from omni_tools.stopping_area import area
from omni_tools.stopping_area.options import AreaOptions

# As in section 3.5 and the experiment straight_line: the enhanced weighting with k = 7.
_ASSISTANT = ("brake_assist.weighting=enhanced", "brake_assist.k=7")

# A stop ends after this time at rest [s]. In the next 2 s, tires and chassis move the footprint by
# less than 0.6 mm (2000 stops of the vehicles on omni-wheels in config/), which `_MARGIN` contains.
_AT_REST = 0.1
_MARGIN = 0.002  # by which areas are enlarged: 1 mm for rounding, 1 mm for motion after a stop [m]

# The rule by which the monitor selects a polygon changed with nav2_collision_monitor 1.3.12
# (VelocityPolygon::isInRange).
_VERSIONS = {
    False: "For every version of nav2_collision_monitor in Jazzy, Kilted and Lyrical.",
    True: "Only for nav2_collision_monitor of Jazzy from 1.3.12 and of Lyrical: Jazzy up to 1.3.11 "
    "and\nKilted up to 1.4.2 compare v_x with the speed bands and need --bands 1.",
}


def stop_campaign(options: AreaOptions, library: ExperimentLibrary) -> area.StopCampaign:
    """Return the campaign of stops from which the stopping areas are computed.

    Raises:
        UnusablePlatformError: a wheel is conventional.
    """
    require_omni_wheels(library.vehicle(options.vehicle).wheels, "nav2-polygons")
    fixed = [
        f"vehicle={options.vehicle}",
        *WITHOUT_CAMERAS,
        "simulation.duration_limit=120",
        f"simulation.settling_time={_AT_REST}",
        *_ASSISTANT,
        *options.overrides,
        f"brake_assist.enabled={str(not options.unassisted).lower()}",
    ]
    return area.StopCampaign(
        base=library.load("straight_line", "assisted", fixed),
        cells=area.make_cells(
            options.top_speed,
            options.bands,
            options.yaw_rate,
            options.turns,
            None if options.limits is None else np.array(options.limits),
        ),
        friction=(options.friction_min, options.friction_max),
        reaction_time=options.reaction_time,
        per_cell=area.HULL_STOPS + area.calibration_stops(options.coverage, options.confidence),
        seed=options.seed,
        limits=options.limits,
    )


def area_metrics(
    options: AreaOptions,
    campaign: area.StopCampaign,
    limits: quantities.FloatArray,
    held_out: Sequence[area.Sweep],
    stays: Sequence[bool],
) -> dict[str, Metric]:
    """Return metrics: share of held-out stops that leave their area, and size of each area."""
    allowed = round(1.0 - options.coverage, 12)  # removes the rounding error of 1 - coverage
    extreme = [campaign.extreme(sweep.seed) for sweep in held_out]
    metrics = {}
    for case, kinds in (("uniform", (False,)), ("extremes", (True,)), ("all", (False, True))):
        chosen = [stay for stay, kind in zip(stays, extreme, strict=True) if kind in kinds]
        metrics[f"held_out_stops.{case}"] = Metric(len(chosen), "1")
        share = 1.0 - sum(chosen) / len(chosen) if chosen else math.nan
        metrics[f"outside_share.{case}"] = Metric(share, "1", at_most=allowed)
    metrics["confidence.each_polygon"] = Metric(options.confidence, "1")
    for cell, limit in zip(campaign.cells, limits, strict=True):
        points = area.corners(limit)
        size = 0.5 * float(np.sum(geometry.cross(points, np.roll(points, -1, axis=0))))
        metrics[f"area.{cell.name}"] = Metric(size, "m^2")
    return metrics


def monitor_parameters(
    options: AreaOptions,
    cells: Sequence[area.Cell],
    limits: quantities.FloatArray,
    metrics: dict[str, Metric],
) -> str:
    """Return the parameters of Nav2's collision monitor as YAML."""
    name = short_name(options.vehicle)
    outside, count = metrics["outside_share.all"].value, metrics["held_out_stops.all"].value
    checked = f"\nOf {count:.0f} held-out stops, {outside:.2%} left their polygon." if count else ""
    # A monitor that compares the signed v_x needs a band from -speed to speed.
    lowest = -options.top_speed if options.bands == 1 else 0.0
    covered = f"{options.speed:g} m/s, sqrt(v_x^2 + v_y^2),"
    if options.limits is not None:
        covered = "{:g} m/s for v_x, {:g} m/s for v_y,".format(*options.limits)
    heading = (
        f"Stopping areas of {name}, {options.variant}, full braking {options.reaction_time:g} s "
        "after the alarm, in base_link.\n"
        f"At least {options.coverage:.2%} of stops stay within the polygon of their motion, with "
        f"a confidence of {options.confidence:.0%} for each polygon:\n"
        f"friction {options.friction_min:g} to {options.friction_max:g}, any load up to the mass "
        f"and the offset in the vehicle's file.{checked}\n"
        f"{_VERSIONS[options.bands > 1]}\n"
        f"No polygon covers more than {covered} or {options.yaw_rate:g} rad/s: the monitor\n"
        "then keeps its last polygon. Limit the velocity to these values"
        + ("; Nav2's controllers limit v_x and v_y separately." * (options.limits is None) or ".")
    )
    polygons = {
        cell.name: {
            "points": str(np.round(area.corners(limit + _MARGIN), 3).tolist()),
            "linear_min": round(min(lowest, cell.speed[0]), 4),
            "linear_max": round(cell.speed[1], 4),
            "theta_min": round(cell.yaw_rate[0], 4),
            "theta_max": round(cell.yaw_rate[1], 4),
            "direction_start_angle": round(cell.direction[0], 5),
            "direction_end_angle": round(cell.direction[1], 5),
        }
        for cell, limit in zip(cells, limits, strict=True)
    }
    monitor = {
        "type": "velocity_polygon",
        "action_type": "stop",
        "min_points": 4,
        "visualize": True,
        "enabled": True,
        "polygon_pub_topic": "velocity_polygon_stop",
        "holonomic": True,
        "velocity_polygons": list(polygons),
        **polygons,
    }
    parameters = {"polygons": ["VelocityPolygonStop"], "VelocityPolygonStop": monitor}
    return commented_yaml({"collision_monitor": {"ros__parameters": parameters}}, heading)
