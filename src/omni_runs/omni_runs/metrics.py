"""Metrics of a braking run, such as distance, rotation, brake switching and odometry error.

Braking lasts from the first stamp with the pedal down to the end of the history. By then, the
vehicle must have come to rest (`rest_stamp`). If the vehicle has not come to rest, or if the pedal
is never pressed or is pressed at rest, some quantities are undefined. Their value is then NaN,
never an intermediate value, and their note gives the reason.

All positions are those of `base_link`. The quantities, in the order of the result, are

==================== ===== ===================================================================
stopping_distance    m     straight line from the start of braking to the final position
path_length          m     length of the path from the start of braking to the final position
orientation_change   deg   magnitude of the total change of yaw, including full turns
lateral_deviation    m     largest distance from the line along the initial direction of motion
stopping_time        s     time from the start of braking until the vehicle comes to rest
peak_yaw_rate        rad/s largest magnitude of the yaw rate from the start of braking on
brake_switchings     1     number of changes of the enables while stopping, over all wheels
brake_switchings.<w> 1     number of changes of the enable of wheel <w> while stopping
fail_safe_share      1     share of the stamps from braking to rest at which all brakes were on
                           because of a fault; the note names the most frequent fault
twist_rmse           m/s   root mean square of the error vector of the odometry's velocity
yaw_rate_rmse        rad/s root mean square error of the odometry's yaw rate
real_time_factor     1     simulated time divided by elapsed time
==================== ===== ===================================================================

Each measurement of the odometry is compared with the true twist at the control stamp at which the
brake assistant uses the measurement.
"""

import dataclasses
import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from omni_brake_assist.conditions import AssistState
from omni_core.quantities import FloatArray
from omni_runs.history import RunHistory

REST_SPEED, REST_YAW_RATE = 0.1, 0.1
"""A vehicle is at rest if its speed [m/s] and its yaw rate [rad/s] do not exceed these limits."""

_ROCKING_SPEED, _ROCKING_YAW_RATE = 0.4, 0.4  # m/s, rad/s; limits for a rocking vehicle
_NEVER_PRESSED = "the brake pedal is never pressed"
_NO_REST = "the vehicle does not come to rest in this history"
_NO_DIRECTION = "braking starts at standstill, so there is no direction of motion"
NO_ODOMETRY = "no twist of the odometry can be compared with the true motion"
"""Note of a metric that needs the twist of the odometry and, as in simulation, the true motion."""
_NO_ENABLES = "there are no brake enables"
_FAULTS = frozenset(state.value for state in AssistState if state.is_fault)
_NO_STATES = "there are no states of the brake assistant"
_BRAKING_QUANTITIES = {
    "stopping_distance": "m", "path_length": "m", "orientation_change": "deg",
    "lateral_deviation": "m", "stopping_time": "s", "peak_yaw_rate": "rad/s",
    "brake_switchings": "1", "fail_safe_share": "1",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Metric:
    """A measured quantity with its unit, reference value and limits.

    Attributes:
        value: measured value, in `unit`; NaN if it is undefined.
        unit: SI symbol, ``deg`` or ``1``.
        reference: value in the dissertation, in `unit`; None if there is none.
        at_most: upper limit on the value, in `unit`; None if there is none.
        at_least: lower limit on the value, in `unit`; None if there is none.
        note: reason why the value is NaN, or a remark for the reader; otherwise empty.
    """

    value: float
    unit: str
    reference: float | None = None
    at_most: float | None = None
    at_least: float | None = None
    note: str = ""

    @property
    def status(self) -> str:
        """``met`` or ``missed`` (NaN misses every limit); empty if the metric has no limit."""
        if self.at_most is None and self.at_least is None:
            return ""
        above = self.at_least is None or self.value >= self.at_least
        below = self.at_most is None or self.value <= self.at_most
        return "met" if above and below else "missed"


def rest_stamp(twist: FloatArray, start: int = 0) -> int | None:
    """Return the index of the first stamp at rest; None if the vehicle moves until the end.

    The tires are elastic, so a stopping vehicle rocks back and forth for a moment. The vehicle
    comes to rest at the first stamp at which it is no faster than `REST_SPEED` and `REST_YAW_RATE`,
    provided that it never exceeds `_ROCKING_SPEED` and `_ROCKING_YAW_RATE` afterwards. At a
    deceleration a, this stamp precedes the time of zero speed by `REST_SPEED` / a.

    A simulation cannot foresee later rocking and therefore ends by another rule
    (`omni_sim.run_progress.run_outcome`): the vehicle must have been at rest for some time.

    Args:
        twist: body twists [m/s, m/s, rad/s], shape (T, 3).
        start: index of the first stamp to consider.
    """
    speed = np.hypot(twist[:, 0], twist[:, 1])
    yaw_rate = np.abs(twist[:, 2])
    moving = (speed > _ROCKING_SPEED) | (yaw_rate > _ROCKING_YAW_RATE)
    moving_at = np.flatnonzero(moving[start:])
    settled = start + (int(moving_at[-1]) + 1 if moving_at.size else 0)
    slow = (speed[settled:] <= REST_SPEED) & (yaw_rate[settled:] <= REST_YAW_RATE)
    slow_at = np.flatnonzero(slow)
    return settled + int(slow_at[0]) if slow_at.size else None


def run_metrics(history: RunHistory) -> dict[str, Metric]:
    """Return the metrics of a run, keyed by quantity; the table of this module lists them."""
    metrics = _braking_metrics(history) | _odometry_metrics(history)
    metrics["real_time_factor"] = Metric(history.real_time_factor, "1")
    return metrics


def still_rolls(history: RunHistory) -> bool:
    """Return whether the vehicle still moves, with the pedal down, at the end of its history."""
    start = history.brake_start
    if start is None or not history.pedal[-1] > 0.0:
        return False
    return rest_stamp(history.twist, start) is None


def results_document(
    name: str, metrics_by_variant: Mapping[str, Mapping[str, Metric]]
) -> dict[str, Any]:
    """Return the JSON document of a command that computes metrics.

    A metric is named ``<quantity>.<variant>``. The metric of a wheel is named
    ``<quantity>.<variant>_<wheel>``; its entry also contains `variant` and `wheel` separately.
    Values that are not finite become None, with the reason in `note`.

    Args:
        name: name of the experiment.
        metrics_by_variant: results of `run_metrics`, keyed by variant.
    """
    entries: dict[str, dict[str, Any]] = {}
    for variant, metrics in metrics_by_variant.items():
        for key, metric in metrics.items():
            quantity, _, wheel = key.partition(".")
            case = f"{variant}_{wheel}" if wheel else variant
            apart = {"variant": variant, "wheel": wheel} if wheel else {}
            entries[f"{quantity}.{case}"] = results_entry(metric) | apart
    return {"name": name, "metrics": entries}


def results_entry(metric: Metric) -> dict[str, Any]:
    """Return a metric as an entry of the JSON document; values that are not finite become None."""
    entry: dict[str, Any] = {"value": _finite(metric.value), "unit": metric.unit}
    for name in ("reference", "at_most", "at_least"):
        if (number := getattr(metric, name)) is not None:
            entry[name] = _finite(number)
    if metric.status:
        entry["status"] = metric.status
    if metric.note:
        entry["note"] = metric.note
    return entry


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _braking_metrics(history: RunHistory) -> dict[str, Metric]:
    """Return the metrics of a stop; NaN with a note if the run contains no complete stop."""
    units: dict[str, str] = {}
    for name, unit in _BRAKING_QUANTITIES.items():
        units[name] = unit
        if name == "brake_switchings":
            units |= {f"{name}.{wheel}": unit for wheel in history.wheel_names}
    start = history.brake_start
    stop = None if start is None else rest_stamp(history.twist, start)
    if start is None or stop is None:
        note = _NEVER_PRESSED if start is None else _NO_REST
        return {name: Metric(math.nan, unit, note=note) for name, unit in units.items()}
    path = history.pose[start:, :2]
    steps = np.diff(path, axis=0)
    values = {
        "stopping_distance": history.stopping_distance,
        "path_length": float(np.sum(np.hypot(steps[:, 0], steps[:, 1]))),
        "orientation_change": history.orientation_change,
        "lateral_deviation": _lateral_deviation(path, history.velocity_world[start]),
        "stopping_time": float(history.stamp_ns[stop] - history.stamp_ns[start]) * 1e-9,
        "peak_yaw_rate": float(np.max(np.abs(history.twist[start:, 2]))),
    }
    # The stamp before braking is included, so that a release at the first stamp of braking is
    # counted.
    switchings = _switchings(history.enable[max(start - 1, 0) : stop + 1])
    values["brake_switchings"] = float(np.sum(switchings))
    for wheel, count in zip(history.wheel_names, switchings.tolist(), strict=True):
        values[f"brake_switchings.{wheel}"] = count
    metrics = {}
    for name, value in values.items():
        reason = _NO_DIRECTION if name == "lateral_deviation" else _NO_ENABLES
        note = reason if math.isnan(value) else ""
        metrics[name] = Metric(value, units[name], note=note)
    return metrics | {"fail_safe_share": _fail_safe_share(history.assist_state[start : stop + 1])}


def _lateral_deviation(path: FloatArray, v_c0: FloatArray) -> float:
    """Return the largest distance of a path from the line along its initial velocity [m].

    It is NaN if the initial speed is at most `REST_SPEED`, because there is no such line.

    Args:
        path: positions from the start of braking on [m], shape (T, 2).
        v_c0: velocity at the start of braking [m/s], shape (2,).
    """
    speed = math.hypot(*v_c0)
    if speed <= REST_SPEED:
        return math.nan
    offset = path - path[0]
    return float(np.max(np.abs(v_c0[0] * offset[:, 1] - v_c0[1] * offset[:, 0]))) / speed


def _fail_safe_share(states: tuple[str, ...]) -> Metric:
    """Return the share of faults among the given states of the brake assistant [1].

    The value is NaN if no state is known.
    """
    if not any(states):
        return Metric(math.nan, "1", note=_NO_STATES)
    faults = Counter(state for state in states if state in _FAULTS)
    if not faults:
        return Metric(0.0, "1")
    share = faults.total() / len(states)
    worst, _ = faults.most_common(1)[0]
    note = f"all brakes on for {share:.0%} of braking, mostly due to {worst.replace('_', ' ')}"
    return Metric(share, "1", note=note)


def _switchings(enable: FloatArray) -> FloatArray:
    """Return how often the enable of each wheel changes [1], shape (N,); NaN without enables.

    Args:
        enable: brake enables [1], shape (T, N).
    """
    counts = np.full(enable.shape[1], np.nan)
    for wheel in range(enable.shape[1]):
        known = enable[np.isfinite(enable[:, wheel]), wheel]
        if known.size:
            counts[wheel] = np.count_nonzero(np.diff(known))
    return counts


def _odometry_metrics(history: RunHistory) -> dict[str, Metric]:
    measured, square, note = history.measured, np.full(3, math.nan), NO_ODOMETRY
    if np.any(measured):
        error = history.estimate[measured] - history.twist[measured]
        square, note = np.mean(error**2, axis=0), ""
    return {
        "twist_rmse": Metric(math.sqrt(square[0] + square[1]), "m/s", note=note),
        "yaw_rate_rmse": Metric(math.sqrt(square[2]), "rad/s", note=note),
    }
