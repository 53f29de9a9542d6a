"""Division of a recorded drive into its stops, each of which is a run of its own."""

import dataclasses
import math

import numpy as np

from omni_loop.history import SIGNALS, RunHistory
from omni_loop.metrics import rest_stamp
from omni_platform.quantities import SECOND_NS


def cut(history: RunHistory, first: int, last: int) -> RunHistory:
    """Return the part of a history from one index to another, both included."""
    part = slice(first, last + 1)
    signals = {name: getattr(history, name)[part].copy() for name in SIGNALS}
    return dataclasses.replace(history, assist_state=history.assist_state[part], **signals)


def stops_of(history: RunHistory) -> tuple[RunHistory, ...]:
    """Return the stops of a history, in order.

    A stop begins when the pedal is pressed in motion, and ends at rest with the pedal still down.
    The part of the history also contains one second before and half a second after the stop.
    Braking that does not end at rest is not a stop. A history without a stop, or with a single stop
    that begins in motion, is returned unchanged.
    """
    spans = _spans(history)
    if not spans or (len(spans) == 1 and _moves(history, 0)):
        return (history,)
    return tuple(cut(history, first, last) for first, last in spans)


def _moves(history: RunHistory, index: int, least: float = 0.2) -> bool:
    """Return whether the vehicle is faster than `least` [m/s or rad/s] at a stamp."""
    twist = history.twist[index]
    return math.hypot(twist[0], twist[1]) > least or abs(twist[2]) > least


def _spans(history: RunHistory) -> list[tuple[int, int]]:
    """Return the first and last index of each stop."""
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
