"""Stops that lose a brake or come onto ice, beside the best stop that any controller could reach.

The bound (`omni_runs.limit.bounds`) is valid for stops that keep the heading, so its rotation is
zero, with full knowledge of the failure or the ice in advance.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from omni_runs.metrics import Metric
from omni_studies.campaign.sensor_faults import StopWithFault, limits

THREE_WHEELS = "three_wheel_diagonal"
"""Case whose vehicle has three wheels: after the loss of a brake, it cannot keep its heading."""

_DELAYS = {"median": (50, 0.12), "worst": (100, 0.4)}
"""Percentile [%] and, with an IMU, limit of each delay until a lost brake is found [s]."""

_MOST = 1.15  # limit on distance / bound if no stop keeps heading and limit on the distance [1]


def metrics(stops: Sequence[StopWithFault]) -> dict[str, Metric]:
    """Return the metrics of the stops that lose a brake or come onto ice.

    Args:
        stops: stops with any faults.
    """
    lost = [stop for stop in stops if (stop.channel, stop.kind) == ("brake", "brake")]
    three = [stop for stop in lost if stop.case == THREE_WHEELS]
    found: dict[str, Metric] = {}
    for law in sorted({stop.law for stop in lost}):
        found |= _at_rest(f"{law}_three_wheels", [stop for stop in three if stop.law == law])
    groups: dict[str, list[StopWithFault]] = {}
    for stop in stops:
        if stop.counted and stop.kind == "ice":
            groups.setdefault(stop.group, []).append(stop)
    for stop in lost:
        if stop.counted and stop.case != THREE_WHEELS:
            when = "during" if stop.onset >= 0.0 else "before"
            groups.setdefault(f"{stop.group}_lost_{when}", []).append(stop)
    for group, chosen in sorted(groups.items()):
        found |= dict(_beside_the_bound(group, chosen))
        if group.endswith("_during"):
            found |= _detections(group, chosen)
    return found


def _detections(group: str, stops: Sequence[StopWithFault]) -> dict[str, Metric]:
    """Return how many of the brakes that are lost during the stops are found, and when."""
    seen = [stop for stop in stops if math.isfinite(stop.observable)]
    delays = [max(s.found - s.observable, 0.0) for s in seen if math.isfinite(s.found)]
    metrics = {
        f"never_observable.{group}": Metric(len(stops) - len(seen), "1"),
        f"found.{group}": Metric(100.0 * len(delays) / max(len(seen), 1), "%"),
    }
    for name, (share, limit) in _DELAYS.items() if delays else ():
        most = limit if stops[0].imu else None
        delay = float(np.percentile(delays, share))
        metrics[f"delay_{name}.{group}"] = Metric(delay, "s", at_most=most)
    return metrics


def _at_rest(group: str, stops: Sequence[StopWithFault]) -> dict[str, Metric]:
    """Return the numbers of stops that do not come to rest."""
    worse = sum(stop.counted and not stop.rest for stop in stops)
    return {
        f"runs.{group}": Metric(len(stops), "1"),
        f"not_at_rest.{group}": Metric(sum(not stop.rest for stop in stops), "1"),
        f"not_at_rest_all_on.{group}": Metric(sum(not stop.counted for stop in stops), "1"),
        f"not_at_rest_assisted_alone.{group}": Metric(worse, "1", at_most=0.0),
    }


def _beside_the_bound(group: str, stops: Sequence[StopWithFault]) -> Iterator[tuple[str, Metric]]:
    """Yield the metrics of the stops of a group beside those of the bound."""
    limit = limits(stops[0].extent, imu=bool(stops[0].imu))
    known = [stop for stop in stops if stop.bound > 0.0]
    yield f"runs.{group}", Metric(len(stops), "1")
    rotation = max(stop.rotation - stop.all_on_rotation for stop in stops)
    yield f"rotation_beyond_all_on.{group}", Metric(rotation, "deg", at_most=limit.rotation)
    yield f"bounded.{group}", Metric(len(known), "1")
    if not known:
        return
    bound, distance, all_on = np.array([(s.bound, s.distance, s.all_on_distance) for s in known]).T
    for name, ratios in (("over_bound", distance / bound), ("all_on_over_bound", all_on / bound)):
        yield f"{name}_median.{group}", Metric(float(np.median(ratios)), "1")
        yield f"{name}_worst.{group}", Metric(float(np.max(ratios)), "1")
    impossible = bound > (limit.distance or math.inf)
    yield f"impossible.{group}", Metric(int(np.sum(impossible)), "1")
    if np.any(impossible):
        worst = float(np.max(distance[impossible] / bound[impossible]))
        yield f"over_bound_impossible.{group}", Metric(worst, "1", at_most=_MOST)
