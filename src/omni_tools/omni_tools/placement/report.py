"""Results of `sensor_design`: numbers, sentences and a file for experiments."""

import math
from collections.abc import Mapping
from typing import Any

from omni_loop.commented_yaml import commented_yaml
from omni_loop.metrics import Metric, results_entry
from omni_tools.placement import design, judged, trials


def entries(
    task: design.DesignTask, result: design.Design, driven: Mapping[str, trials.PlacementTrial]
) -> dict[str, dict[str, Any]]:
    """Return the metrics of the results' document."""
    radius = result.criterion.gyration
    found: dict[str, dict[str, Any]] = {}

    def add(name: str, value: float, unit: str, note: str = "") -> None:
        found[name] = results_entry(Metric(value, unit, note=note))

    for name, sensor in result.best.sensors.items():
        add(f"x.{name}", sensor.x, "m")
        add(f"y.{name}", sensor.y, "m")
        add(f"heading.{name}", sensor.heading_deg, "deg")
    for placement in result.placements:
        case = placement.name
        add(f"mean_error.{case}", placement.mean_error, "m/s", placement.singular)
        for axis, quantity in enumerate(("v_x", "v_y", "yaw_rate")):
            unit = "rad/s" if axis == 2 else "m/s"
            add(f"deviation_{quantity}.{case}", placement.deviation[axis], unit)
        for motion, error in placement.by_motion.items():
            add(f"mean_error_{motion}.{case}", error, "m/s")
        if len(placement.sensors) > 3:
            add(f"mean_error_after_failure.{case}", placement.worst_without, "m/s")
        add(f"condition_number.{case}", placement.condition, "1")
        add(f"axes_spread.{case}", placement.spread_deg, "deg")
        add(f"effective_lever.{case}", placement.lever, "m")
        add(f"singular.{case}", float(bool(placement.singular)), "1", placement.singular)
        add(f"mountable.{case}", float(not placement.mounting), "1", placement.mounting)
        if case in driven:
            add(f"mean_error_measured.{case}", driven[case].mean_error(radius), "m/s")
    add("rounding_loss.best", result.found.rounding, "1")
    camera = result.trial
    add("speed.design", task.speed, "m/s")
    add("deviation.one_camera_straight", math.sqrt(camera.error.straight), "m/s")
    add("deviation.one_camera_sideways", float(camera.fitted[-1]), "m/s")
    add("misfit.one_camera", camera.misfit, "1")
    return found


def column(
    placement: judged.JudgedPlacement, trial: trials.PlacementTrial | None, gyration: float
) -> dict[str, Metric]:
    """Return a column of the table in millimeters per second."""
    singular = f"singular: {placement.singular}" if placement.singular else ""
    deviation = placement.deviation
    values = {
        "mean_error": Metric(1e3 * placement.mean_error, "mm/s", note=singular),
        "forward": Metric(1e3 * deviation[0], "mm/s"),
        "sideways": Metric(1e3 * deviation[1], "mm/s"),
        "yaw_rate": Metric(1e3 * deviation[2], "mrad/s"),
    }
    if len(placement.sensors) > 3:
        values["after_one_failure"] = Metric(1e3 * placement.worst_without, "mm/s")
    if trial is not None:
        values["measured"] = Metric(1e3 * trial.mean_error(gyration), "mm/s")
    values["condition_number"] = Metric(placement.condition, "1")
    values["axes_spread"] = Metric(placement.spread_deg, "deg")
    values["effective_lever"] = Metric(placement.lever, "m")
    return values


def findings(task: design.DesignTask, result: design.Design, conditions: str) -> list[str]:
    """Return the results in sentences."""
    best, found, camera = result.best, result.found, result.trial
    fitted = 1e3 * camera.fitted[[0, -1]]
    sentences = [
        f"One camera errs by {fitted[0]:.2g} mm/s moving along its axis and {fitted[1]:.2g} mm/s "
        f"across it at {conditions} (the law is within a factor of "
        f"{1.0 + camera.misfit:.2f} of the trials).",
        f"The best placement is {found.symmetry or 'not symmetric'}; rounded to 1 mm and 1 deg it "
        f"is {100.0 * found.rounding:.2f} % worse.",
    ]
    if task.count > design.FEWEST_SENSORS:
        sentences.append(
            f"Without any one camera it stays regular, at worst without {best.missed_most}: "
            f"{1e3 * best.worst_without:.2f} mm/s."
            if math.isfinite(best.worst_without)
            else f"Without {best.missed_most} it is singular; --redundant avoids that."
        )
    for placement in result.placements[1:]:
        if placement.singular and placement.name not in task.given:
            sentences.append(f"{placement.name} is singular: {placement.singular}.")
        elif placement.name in task.given and not placement.singular:
            sentences.append(
                f"{placement.name} is not singular: its axes spread by {placement.spread_deg:.0f} "
                f"deg (5 deg are taken for parallel, 45 deg are best), its effective lever is "
                f"{placement.lever:.2f} m (0 where all axes pass through one point); its mean "
                f"error is {_compared(placement, best)} the best one's."
            )
        if placement.mounting and placement.name in task.given:
            sentences.append(
                f"{placement.name} does not fit under this chassis: {placement.mounting}."
            )
    other = result.placement("condition")
    sentences.append(
        f"The smallest condition number, {other.condition:.2f} against {best.condition:.2f}, "
        f"comes with a mean error {_compared(other, best)} the best one's."
    )
    return sentences


def _compared(placement: judged.JudgedPlacement, best: judged.JudgedPlacement) -> str:
    share = placement.mean_error / best.mean_error - 1.0
    return f"{100.0 * abs(share):.0f} % {'below' if share < 0.0 else 'above'}"


def sensor_file(task: design.DesignTask, result: design.Design, vehicle: str) -> str:
    """Return the YAML that an experiment names as its sensors."""
    best = result.best
    heading = (
        f"{task.count} line cameras under {vehicle}: mean twist error "
        f"{1e3 * best.mean_error:.2f} mm/s at {task.speed:.3g} m/s,\n"
        f"v_x {1e3 * best.deviation[0]:.2f} mm/s, v_y {1e3 * best.deviation[1]:.2f} mm/s, "
        f"yaw rate {1e3 * best.deviation[2]:.2f} mrad/s."
    )
    keys = ("x", "y", "heading_deg", "pixels", "length", "width", "line_rate")
    sensors = {
        name: {key: getattr(sensor, key) for key in keys} for name, sensor in best.sensors.items()
    }
    return commented_yaml(sensors, heading)
