"""Results of a placement: metrics, sentences, and a sensor file for experiments."""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Any

from omni_core.commands.wrapped_table import WrappedTable
from omni_runs.figures.tables.comparison_table import ComparisonTable
from omni_runs.metrics import Metric, results_entry
from omni_runs.yaml_files import commented_yaml
from omni_tools.placement import design
from omni_tools.placement.error import EvaluatedPlacement

_COLUMN = {
    "mean_error": "mean_error",
    "deviation_v_x": "forward",
    "deviation_v_y": "sideways",
    "deviation_yaw_rate": "yaw_rate",
    "mean_error_after_failure": "after_one_failure",
    "mean_error_measured": "measured",
    "condition_number": "condition_number",
    "axes_spread": "axes_spread",
    "effective_lever": "effective_lever",
}
"""Label of each row in the table of placements, keyed by metric."""


def entries(
    task: design.DesignTask, result: design.Design, driven: Mapping[str, design.PlacementTrial]
) -> dict[str, dict[str, Any]]:
    """Return the metrics of all placements as entries of the results document, keyed by name."""
    found: dict[str, Metric] = {}
    for name, sensor in task.in_body(result.best.sensors).items():
        found[f"x.{name}"] = Metric(sensor.x, "m")
        found[f"y.{name}"] = Metric(sensor.y, "m")
        found[f"heading.{name}"] = Metric(sensor.heading_deg, "deg")
    for placement in result.placements:
        own = _metrics(placement, driven.get(placement.name), result.criterion.gyration)
        found |= {f"{quantity}.{placement.name}": metric for quantity, metric in own.items()}
    for steered in result.steered.values():
        found |= {f"{key}.{steered.name}": one for key, one in _metrics(steered, None, 1.0).items()}
    camera = result.trial
    found |= {
        "rounding_loss.best": Metric(result.found.rounding, "1"),
        "speed.design": Metric(task.speed, "m/s"),
        "deviation.one_camera_straight": Metric(math.sqrt(camera.error.straight), "m/s"),
        "deviation.one_camera_sideways": Metric(float(camera.fitted[-1]), "m/s"),
        "misfit.one_camera": Metric(camera.misfit, "1"),
    }
    return {name: results_entry(metric) for name, metric in found.items()}


def _metrics(
    placement: EvaluatedPlacement, trial: design.PlacementTrial | None, gyration: float
) -> dict[str, Metric]:
    metrics = {"mean_error": Metric(placement.mean_error, "m/s", note=placement.singular)}
    names = (("v_x", "m/s"), ("v_y", "m/s"), ("yaw_rate", "rad/s"))
    for value, (quantity, unit) in zip(placement.deviation, names, strict=True):
        metrics[f"deviation_{quantity}"] = Metric(value, unit)
    for motion, error in placement.by_motion.items():
        metrics[f"mean_error_{motion}"] = Metric(error, "m/s")
    if len(placement.sensors) > 3:
        metrics["mean_error_after_failure"] = Metric(placement.worst_without, "m/s")
    if trial is not None:
        metrics["mean_error_measured"] = Metric(trial.mean_error(gyration), "m/s")
    singular, mountable = bool(placement.singular), not placement.mounting
    return metrics | {
        "condition_number": Metric(placement.condition, "1"),
        "axes_spread": Metric(placement.spread_deg, "deg"),
        "effective_lever": Metric(placement.lever, "m"),
        "singular": Metric(float(singular), "1", note=placement.singular),
        "mountable": Metric(float(mountable), "1", note=placement.mounting),
    }


def printed(
    task: design.DesignTask,
    result: design.Design,
    driven: Mapping[str, design.PlacementTrial],
    conditions: str,
) -> Iterator[Any]:
    """Yield the tables and sentences that the terminal shows."""
    sensors = task.in_body(result.best.sensors)
    columns = {
        "x [m]": [f"{sensor.x:.3f}" for sensor in sensors.values()],
        "y [m]": [f"{sensor.y:.3f}" for sensor in sensors.values()],
        "heading [deg]": [f"{sensor.heading_deg:.0f}" for sensor in sensors.values()],
    }
    yield WrappedTable({"sensor": list(sensors)}, columns)
    yield ComparisonTable(
        {
            placement.name: column(placement, driven.get(placement.name), result.criterion.gyration)
            for placement in result.placements
            if placement.name in task.given or not placement.singular
        },
        title="standard deviations of the twist, and its mean error over the platform",
    )
    yield from findings(task, result, conditions)


def column(
    placement: EvaluatedPlacement, trial: design.PlacementTrial | None, gyration: float
) -> dict[str, Metric]:
    """Return the values in a placement's column of the table, keyed by metric; velocities in mm/s.

    Args:
        placement: the placement.
        trial: errors on rendered lines; None if the placement was not simulated.
        gyration: RMS distance of the platform's points from base_link [m].
    """
    metrics = _metrics(placement, trial, gyration)
    shown = {words: metrics[name] for name, words in _COLUMN.items() if name in metrics}
    if placement.singular:
        note = f"singular: {placement.singular}"
        shown["mean_error"] = dataclasses.replace(shown["mean_error"], note=note)
    return {
        words: Metric(1e3 * m.value, f"m{m.unit}", note=m.note) if m.unit.endswith("/s") else m
        for words, m in shown.items()
    }


def findings(task: design.DesignTask, result: design.Design, conditions: str) -> list[str]:
    """Return sentences that describe the results of the search."""
    best, found, camera = result.best, result.found, result.trial
    fitted = 1e3 * camera.fitted[[0, -1]]
    sentences = [
        f"The error of one camera is {fitted[0]:.2g} mm/s in motion along its axis and "
        f"{fitted[1]:.2g} mm/s across it, at {conditions} (the model is within a factor of "
        f"{1.0 + camera.misfit:.2f} of the simulated errors).",
        f"The best placement is {found.symmetry or 'not symmetric'}; rounded to 1 mm and 1 deg, "
        f"its error is {100.0 * found.rounding:.2f} % larger.",
    ]
    if task.count > design.FEWEST_SENSORS:
        sentences.append(
            f"After the failure of any one camera it is not singular; the error is largest after "
            f"that of {best.missed_most}: {1e3 * best.worst_without:.2f} mm/s."
            if math.isfinite(best.worst_without)
            else f"After the failure of {best.missed_most} it is singular; --redundant avoids that."
        )
    for placement in result.placements[1:]:
        if placement.singular and placement.name not in task.given:
            sentences.append(f"{placement.name} is singular: {placement.singular}.")
        elif placement.name in task.given and not placement.singular:
            carried = any(sensor.carrier for sensor in placement.sensors.values())
            angles = " at steering angles of 0" if carried else ""
            sentences.append(
                f"{placement.name} is not singular{angles}: its axes spread by "
                f"{placement.spread_deg:.0f} deg (5 deg count as parallel, 45 deg is best), its "
                f"effective lever is {placement.lever:.2f} m (0 where all axes pass through one "
                f"point); its mean error is {_compared(placement, best)} that of the best."
            )
        if placement.mounting and placement.name in task.given:
            sentences.append(
                f"{placement.name} does not fit under this chassis: {placement.mounting}."
            )
    sentences += [
        _steered_sentence(*key, task.steered[key].angle_deg, one)
        for key, one in result.steered.items()
    ]
    other = result.placement("condition")
    sentences.append(
        f"The placement with the smallest condition number ({other.condition:.2f}; best placement: "
        f"{best.condition:.2f}) has a mean error {_compared(other, best)} that of the best."
    )
    return sentences


def _steered_sentence(
    name: str, motion: str, angles: Mapping[str, float], placement: EvaluatedPlacement
) -> str:
    turned = ", ".join(f"{wheel} at {angle:.0f} deg" for wheel, angle in angles.items())
    result = f"its mean error is {1e3 * placement.mean_error:.2f} mm/s"
    if placement.singular:
        result = f"it is singular: {placement.singular}"
    elif placement.mounting:
        result += f", but {placement.mounting}"
    return f"{name} in {motion.removesuffix('_2')} motion ({turned}): {result}."


def _compared(placement: EvaluatedPlacement, best: EvaluatedPlacement) -> str:
    share = placement.mean_error / best.mean_error - 1.0
    return f"{100.0 * abs(share):.0f} % {'below' if share < 0.0 else 'above'}"


def sensor_file(task: design.DesignTask, result: design.Design, vehicle: str) -> str:
    """Return the text of a sensor file in YAML, which an experiment can name."""
    best = result.best
    heading = (
        f"{task.count} line cameras under {vehicle}: mean twist error "
        f"{1e3 * best.mean_error:.2f} mm/s at {task.speed:.3g} m/s,\n"
        f"v_x {1e3 * best.deviation[0]:.2f} mm/s, v_y {1e3 * best.deviation[1]:.2f} mm/s, "
        f"yaw rate {1e3 * best.deviation[2]:.2f} mrad/s."
    )
    keys = ("x", "y", "heading_deg", "pixels", "length", "width", "line_rate")
    sensors = {
        name: {key: getattr(sensor, key) for key in keys}
        for name, sensor in task.in_body(best.sensors).items()
    }
    return commented_yaml(sensors, heading)
