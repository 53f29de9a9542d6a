"""One run of the robustness campaign: a stop without and with the assistant, and its limits.

If a run violates a limit, its disturbances are removed one after the other, and the run is repeated
after each removal. The disturbance whose removal ends the violation is reported as the cause.
"""

from typing import Any, NamedTuple

import numpy as np

from omni_loop import compiled, experiment
from omni_studies.campaign.random_braking import RandomBraking, Tree, draw


class Allowed(NamedTuple):
    """Limits of an assisted stop.

    Attributes:
        orientation: largest excess of the orientation change over that of the unassisted stop
            [deg].
        distance: largest ratio of the stopping distance to the unassisted one [1], which allows for
            the release of half of the wheels.
        energy: largest rise of the energy during braking, relative to the start of braking [1].
        shortest: smallest stopping distance that is used in comparisons [m].
    """

    orientation: float = 5.0
    distance: float = 2.0
    energy: float = 1e-3
    shortest: float = 0.2


ALLOWED = Allowed()
"""Limits that apply to every run."""

CAUSES = ("failure", "noise", "patches", "rotation", "direction", "law")
"""Causes of a violated limit: the sensor is faulty; the sensor is noisy, biased or slow; wheels
meet patches; the vehicle rotates at the start of braking; it does not move straight ahead; or
none of these, so that the control law itself is the cause."""

LIMITS = ("energy", "orientation", "distance", "rest")
"""Names of the limits; `Outcome` has a field of the same name for the cause of each violation."""


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
        tipping: whether the vehicle would have tipped over in any of the runs, 0 or 1; the planar
            model only reports it.
        rejected_share: share of the braking time with all brakes on because of rejected inputs [1].
        energy: cause of a violated energy limit, one of `CAUSES`; empty without a violation.
        orientation: cause of a violated orientation limit; empty without a violation.
        distance: cause of a violated distance limit; empty without a violation.
        rest: cause if the assisted vehicle does not come to rest but the unassisted one does.
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
    rejected_share: float
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
    """Run a drawn stop without and with the assistant, and return both results."""
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
        rejected_share=float(np.mean(~assisted.valid[assisted.brake_start :])),
    )


def without(drawn: Tree, cause: str) -> Tree:
    """Return a drawn run after removal of one of its disturbances."""
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

    The energy is the kinetic and elastic energy on flat ground, relative to its value when the
    brake pedal opens the clutch of the drive. From then on it must not rise, because brakes can
    only remove energy.
    """
    free = run.pedal >= configuration.vehicle.drive.clutch_threshold
    energy = run.energy[free]
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
