"""Stops of a run: a drive with several stops is divided into one history for each stop."""

import dataclasses
import math

import numpy as np

from omni_core.quantities import SECOND_NS
from omni_runs.history import SIGNALS, RunHistory
from omni_runs.metrics import Metric, rest_stamp, run_metrics


def named_stops(history: RunHistory, name: str) -> dict[str, RunHistory]:
    """Return the history of each stop of a run, keyed by name, see `stops_of`.

    Args:
        history: history of the run.
        name: name of the run, and of its only stop; several stops are named ``<name>/stop_<N>``.
    """
    stops = stops_of(history)
    if len(stops) == 1:
        return {name: stops[0]}
    return {f"{name}/stop_{number}": stop for number, stop in enumerate(stops, 1)}


def stop_metrics(history: RunHistory) -> dict[str, Metric]:
    """Return the metrics of a stop, without those of the complete run, keyed by quantity."""
    return {k: metric for k, metric in run_metrics(history).items() if k != "real_time_factor"}


def drive_metrics(history: RunHistory, stops: int) -> dict[str, Metric]:
    """Return the metrics of a whole drive with several stops, keyed by quantity.

    Args:
        history: history of the whole drive.
        stops: number of its stops.
    """
    steps = np.diff(history.pose[:, :2], axis=0)
    length = float(np.sum(np.hypot(steps[:, 0], steps[:, 1])))
    return {"stops": Metric(stops, "1"), "path_length": Metric(length, "m")}


def _cut(history: RunHistory, first: int, last: int) -> RunHistory:
    """Return the part of a history from index `first` to index `last`, both included."""
    part = slice(first, last + 1)
    signals = {name: getattr(history, name)[part].copy() for name in SIGNALS}
    return dataclasses.replace(history, assist_state=history.assist_state[part], **signals)


def stops_of(history: RunHistory) -> tuple[RunHistory, ...]:
    """Return the history of each stop of a run, in the order of the stops.

    A stop begins when the pedal is pressed while the vehicle moves. It ends when the vehicle is at
    rest with the pedal still down. Braking that does not end at rest is not a stop. The history of
    a stop also contains up to one second before and half a second after the stop.

    The whole history is returned if it contains no stop. It is also returned if it contains a
    single stop and the vehicle already moves at the first stamp.
    """
    spans = _spans(history)
    if not spans or (len(spans) == 1 and _moves(history, 0)):
        return (history,)
    return tuple(_cut(history, first, last) for first, last in spans)


def _moves(history: RunHistory, index: int, least: float = 0.2) -> bool:
    """Return whether the speed [m/s] or the yaw rate [rad/s] at a stamp exceeds `least`."""
    twist = history.twist[index]
    return math.hypot(twist[0], twist[1]) > least or abs(twist[2]) > least


def _spans(history: RunHistory) -> list[tuple[int, int]]:
    """Return the indices of the first and last stamp of each stop's history, see `stops_of`."""
    stamps = history.stamp_ns
    pressed = np.concatenate(([False], history.pedal > 0.0, [False]))
    downs = np.flatnonzero(pressed[1:] & ~pressed[:-1])
    ups = np.flatnonzero(pressed[:-1] & ~pressed[1:])
    spans, free = [], 0
    for down, up in zip(downs.tolist(), ups.tolist(), strict=True):
        still = rest_stamp(history.twist[:up], down) if _moves(history, down) else None
        if still is not None:
            first = int(np.searchsorted(stamps, stamps[down] - SECOND_NS))
            last = int(np.searchsorted(stamps, stamps[still] + SECOND_NS // 2, side="right")) - 1
            spans.append((max(free, first), min(max(last, still), up - 1)))
        free = up
    return spans
