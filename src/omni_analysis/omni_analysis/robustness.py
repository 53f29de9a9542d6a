"""One run of the robustness campaign: the same braking unassisted and assisted, and its limits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omni_analysis.experiment import ExperimentConfiguration
from omni_analysis.fast_loop import FastRun, run_fast_loop
from omni_analysis.random_braking import RandomBraking, draw

ORIENTATION_LIMIT = 5.0
"""How much worse the orientation change may be than unassisted [deg]."""

DISTANCE_FACTOR = 1.5
"""How many times longer the stopping distance may be than unassisted [1]."""

ENERGY_LIMIT = 1e-3
"""Share of the energy at the start of braking that may come back while braking [1]."""

SHORTEST_DISTANCE = 0.2
"""Stopping distances below this are compared as if they were this long [m]."""


class Outcome(NamedTuple):
    """What a run comes to.

    Attributes:
        seed: of the run.
        vehicle: name of its file.
        orientation_unassisted: change of orientation while braking [deg].
        orientation_assisted: likewise.
        distance_unassisted: stopping distance [m].
        distance_assisted: likewise.
        energy_rise_unassisted: largest rise of the energy while braking, as a share [1].
        energy_rise_assisted: likewise.
        stopped_unassisted: whether the vehicle came to rest, 0 or 1.
        stopped_assisted: likewise.
        tipping: whether a vehicle would have tipped over with either, which the planar model only
            reports, 0 or 1.
        distrusted: share of the braking in which the assistant had all brakes on for want of
            trust [1].
    """

    seed: int
    vehicle: str
    orientation_unassisted: float
    orientation_assisted: float
    distance_unassisted: float
    distance_assisted: float
    energy_rise_unassisted: float
    energy_rise_assisted: float
    stopped_unassisted: int
    stopped_assisted: int
    tipping: int
    distrusted: float


def outcome(braking: RandomBraking, seed: int) -> Outcome:
    """Run a seed without and with the assistant."""
    drawn = draw(seed)
    configurations = braking.configurations(drawn)
    unassisted, assisted = (
        run_fast_loop(configurations[variant]) for variant in ("unassisted", "assisted")
    )
    configuration = configurations["assisted"]
    start = assisted.brake_start
    return Outcome(
        seed=seed,
        vehicle=drawn["vehicle"],
        orientation_unassisted=unassisted.orientation_change,
        orientation_assisted=assisted.orientation_change,
        distance_unassisted=unassisted.stopping_distance,
        distance_assisted=assisted.stopping_distance,
        energy_rise_unassisted=energy_rise(unassisted, configuration),
        energy_rise_assisted=energy_rise(assisted, configuration),
        stopped_unassisted=int(unassisted.stopped),
        stopped_assisted=int(assisted.stopped),
        tipping=int(unassisted.tipping_steps + assisted.tipping_steps > 0),
        distrusted=float(np.mean(~assisted.trusted[start:])),
    )


def energy_rise(run: FastRun, configuration: ExperimentConfiguration) -> float:
    """Return the largest rise of the energy from any stamp to a later one [1].

    Kinetic and elastic energy on flat ground, from the moment on at which the pedal has opened the
    clutch, as a share of the energy at that moment: brakes only take.
    """
    free = run.pedal >= configuration.vehicle.drive.clutch_threshold
    energy = run.energy[free]
    rise = np.max(energy - np.minimum.accumulate(energy))
    return float(rise / energy[0])


def violations(result: Outcome) -> tuple[str, ...]:
    """Return the limits that a run breaks: ``energy``, ``orientation``, ``distance``, ``rest``."""
    longest = DISTANCE_FACTOR * max(result.distance_unassisted, SHORTEST_DISTANCE)
    broken = {
        "energy": max(result.energy_rise_unassisted, result.energy_rise_assisted) > ENERGY_LIMIT,
        "orientation": result.orientation_assisted
        > result.orientation_unassisted + ORIENTATION_LIMIT,
        "distance": result.distance_assisted > longest,
        "rest": result.stopped_assisted < result.stopped_unassisted,
    }
    return tuple(name for name, is_broken in broken.items() if is_broken)
