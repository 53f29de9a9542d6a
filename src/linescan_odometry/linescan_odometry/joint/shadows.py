"""Displacements of bars of shadow, which move with a velocity of their own.

In shapes, c is the number of candidates.
"""

import math

import numpy as np

from linescan_odometry.joint import candidates, spectra
from linescan_odometry.joint.details import spread
from linescan_odometry.joint.maximum import View
from omni_core.kernels import kernel

# Sections of a line (`PLACES`) whose details a bar of shadow changes: around each of its two edges,
# 3 in which the moving average differs from the lines, and 0.75 of penumbra.
_SHADOW = 2.0 * (3.0 + 0.75)


@kernel
def may_be_shadow(motion: spectra.Doubles, view: View, layout: candidates.Layout) -> bool:
    """Return whether all that moves with a displacement may be a bar of shadow.

    It is False for a shift within the batch below the smallest distance between two peaks, because
    the mean of the lines, which the details lack, then contains most of the ground.

    Args:
        motion: displacement per line [px] and its change from line to line [px], shape (2,).
        view: the batch.
        layout: sizes of the batch.
    """
    if abs(motion[0]) * (layout.lines - 1) < candidates.APART:
        return False
    # At the largest of all spacings, only few pairs of lines remain.
    which = min(candidates.farthest(motion[0], layout), candidates.SPACINGS - 2)
    distance = candidates.spacings(layout.lines)[which]
    number, others = spread(view.details, motion, distance, math.ceil(_SHADOW))
    return bool(number < _SHADOW and others < spectra.SIGNIFICANT)


@kernel
def only_ground(view: View, layout: candidates.Layout, evidence: spectra.Doubles) -> int:
    """Return the index of the only likely candidate that is no bar of shadow; -1 if there is none.

    A bar of shadow may be many times more likely than the ground that it moves over.

    Args:
        view: the batch.
        layout: sizes of the batch.
        evidence: log-likelihood ratio of each candidate [nats], shape (c,).
    """
    found, only, least = view.found, -1, candidates.LIKELY
    for i in np.argsort(-evidence):
        if evidence[i] < least:
            break
        rival = only < 0 or abs(found[i] - found[only]) >= candidates.APART
        if rival and not may_be_shadow(np.array([found[i], 0.0]), view, layout):
            if only >= 0:
                return -1
            only, least = int(i), candidates.RATIO * evidence[i]
    return only
