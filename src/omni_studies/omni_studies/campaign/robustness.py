"""One run of the robustness campaign: a stop without and with the assistant, and its limits.

A run that violates a limit is repeated with one disturbance after the other removed. The
disturbance without which the limit holds is the cause.
"""

from typing import Any, NamedTuple

import numpy as np

from omni_loop import compiled, experiment
from omni_studies.campaign.random_braking import RandomBraking, Tree, draw


class Allowed(NamedTuple):
    """Limits of an assisted stop.

    Attributes:
        orientation: largest excess of the orientation change over the unassisted one [deg].
        distance: largest ratio of the stopping distance to the unassisted one [1]; the assistant
            may have to release half of the wheels.
        energy: largest rise of the energy while braking, relative to the start of braking [1].
        shortest: lower limit of stopping distances in comparisons [m].
    """

    orientation: float = 5.0
    distance: float = 2.0
    energy: float = 1e-3
    shortest: float = 0.2


ALLOWED = Allowed()
"""Limits of every run."""

CAUSES = ("failure", "noise", "patches", "rotation", "direction", "law")
"""Causes of a violated limit: the sensor fails; it is noisy, biased or slow; wheels meet patches;
the vehicle turns when it starts to brake; it does not move straight ahead; or none of these, so
that the control law itself is the cause."""

LIMITS = ("energy", "orientation", "distance", "rest")
"""Names of the limits, which are also the fields of `Outcome` with the causes."""


class Outcome(NamedTuple):
    """Result of a run.

    Attributes:
        seed: seed of the run.
        vehicle: name of the vehicle's file.
        orientation_unassisted: change of orientation without the assistant [deg].
        orientation_assisted: change of orientation with the assistant [deg].
        distance_unassisted: stopping distance without the assistant [m].
        distance_assisted: stopping distance with the assistant [m].
        energy_rise_unassisted: largest relative rise of the energy without the assistant [1].
        energy_rise_assisted: largest relative rise of the energy with the assistant [1].
        stopped_unassisted: whether the vehicle came to rest without the assistant, 0 or 1.
        stopped_assisted: whether the vehicle came to rest with the assistant, 0 or 1.
        tipping: whether the vehicle would have tipped over in one of the runs, 0 or 1; the planar
            model only reports it.
        distrusted: share of the braking in which all brakes were on because of rejected inputs [1].
        energy: cause of a violation of the limit of energy, one of `CAUSES`, else empty.
        orientation: cause of a violation of the limit of orientation, else empty.
        distance: cause of a violation of the limit of distance, else empty.
        rest: cause of not coming to rest if the unassisted vehicle does, else empty.
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
    energy: str = ""
    orientation: str = ""
    distance: str = ""
    rest: str = ""


def outcome(braking: RandomBraking, seed: int) -> Outcome:
    """Run a seed without and with the assistant, and find the causes of violations."""
    drawn = draw(seed)
    result = compare(braking, drawn)
    open_limits = violations(result)
    causes: dict[str, Any] = {}
    for cause in CAUSES[:-1]:
        if not open_limits:
            break
        drawn = without(drawn, cause)
        still = violations(compare(braking, drawn))
        causes |= {limit: cause for limit in open_limits if limit not in still}
        open_limits = tuple(limit for limit in open_limits if limit in still)
    causes |= dict.fromkeys(open_limits, CAUSES[-1])
    return result._replace(**causes)


def compare(braking: RandomBraking, drawn: Tree) -> Outcome:
    """Run a drawn stop without and with the assistant."""
    configurations = braking.configurations(drawn)
    unassisted, assisted = (
        compiled.run_fast_loop(configurations[variant]) for variant in ("unassisted", "assisted")
    )
    configuration = configurations["assisted"]
    return Outcome(
        seed=drawn["seed"],
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
        distrusted=float(np.mean(~assisted.record.trusted[assisted.brake_start :])),
    )


def without(drawn: Tree, cause: str) -> Tree:
    """Return a drawn run without one of its disturbances."""
    if cause == "failure":
        kept = {k: v for k, v in drawn["velocity_sensor"].items() if not k.startswith("failure")}
        return drawn | {"velocity_sensor": kept}
    if cause == "noise":
        return drawn | {"velocity_sensor": {}}
    if cause == "patches":
        return drawn | {"ground": drawn["ground"] | {"patches": {}}}
    entry = "yaw_rate_deg" if cause == "rotation" else "direction_deg"
    return drawn | {"maneuver": drawn["maneuver"] | {entry: 0.0}}


def energy_rise(run: compiled.FastRun, configuration: experiment.ExperimentConfiguration) -> float:
    """Return the largest rise of the energy from any stamp to a later one [1].

    Kinetic and elastic energy on flat ground after the pedal has opened the clutch, relative to the
    energy at that moment: brakes only remove energy.
    """
    free = run.pedal >= configuration.vehicle.drive.clutch_threshold
    energy = run.record.energy[free]
    rise = np.max(energy - np.minimum.accumulate(energy))
    return float(rise / energy[0])


def violations(result: Outcome) -> tuple[str, ...]:
    """Return the limits from `LIMITS` that a run violates."""
    longest = ALLOWED.distance * max(result.distance_unassisted, ALLOWED.shortest)
    rise = max(result.energy_rise_unassisted, result.energy_rise_assisted)
    turned = result.orientation_assisted - result.orientation_unassisted
    broken = {
        "energy": rise > ALLOWED.energy,
        "orientation": turned > ALLOWED.orientation,
        "distance": result.distance_assisted > longest,
        "rest": result.stopped_assisted < result.stopped_unassisted,
    }
    return tuple(name for name, is_broken in broken.items() if is_broken)
