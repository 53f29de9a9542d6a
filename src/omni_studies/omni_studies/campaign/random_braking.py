"""Random braking maneuvers, each drawn with a seed, and the limits that they must meet.

The random values of a run are the vehicle (`VEHICLES`), its load with position and height, the
friction of the ground with up to three patches along the path, the motion and the pedal. Noise,
offset and sampling of the velocity sensor, which is faulty in some runs, are also random. The seed
of the run determines all of these values. Every value is rounded to a few digits, so that the
experiment file of a run reproduces the run exactly.

If a run violates a limit, its disturbances are removed one after the other, and the run is repeated
after each removal. The disturbance whose removal ends the violation is reported as the cause.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import yaml

from omni_core.configuration import ConfigurationError, to_mapping
from omni_runs import compiled, experiment
from omni_runs.history import FastRun
from omni_sim.driver.configuration import ManeuverConfiguration
from omni_sim.ground.configuration import FrictionPatch
from omni_sim.sensor_configuration import FAILURES, VelocitySensorConfiguration
from omni_tools.campaign.runner import digest

# By vehicle file: limits on the load [kg], on the speed [m/s], and on the offset of the load from
# the center, forward and sideways [m].
VEHICLES = {
    "mecanum_forklift": (500.0, 10.0, 0.6, 0.45),
    "three_wheel_robot": (500.0, 4.0, 0.25, 0.25),
    "six_wheel_mecanum": (1500.0, 6.0, 1.0, 0.6),
}

_BASE = "straight_line"
_SWITCHES: dict[str, dict[str, Any]] = {
    "unassisted": {"enabled": False},
    "assisted": {"enabled": True},
}
# As in section 3.5 and the experiment straight_line: the enhanced weighting with k = 7.
_LAW = {"weighting": "enhanced", "k": 7}
# Keys that an override must not contain, because their values are drawn.
_DRAWN = ("seed", "vehicle=", "vehicle.load", "ground.friction", "ground.patches", "maneuver",
          "velocity_sensor", "feedback", "brake_assist.enabled")  # fmt: skip
# Parameters of the assistant for a noisy sensor, as in config/experiments/ice_patch_noisy.yaml.
_TOLERANT = {"maximum_speed_deviation": 1.0, "speed_noise": 3.0}

Tree = dict[str, Any]


class RandomBraking:
    """Draws and runs the stop of each seed of a campaign.

    Args:
        library: library that contains the vehicle files.
        changes: ``dotted.key=value`` overrides of values that are not drawn at random.

    Raises:
        ConfigurationError: a change is invalid, or affects a drawn value.
    """

    def __init__(self, library: experiment.ExperimentLibrary, changes: Sequence[str] = ()) -> None:
        for change in changes:
            if change.startswith(_DRAWN):
                raise ConfigurationError(
                    "--set", f"{change!r}: the campaign draws this value at random"
                )
        law = [f"brake_assist.{name}={value}" for name, value in _LAW.items()]
        fixed = ["feedback=velocity_sensor", *law, *changes]
        self._bases = {
            name: library.load(_BASE, "assisted", [f"vehicle={name}", *fixed]) for name in VEHICLES
        }

    @property
    def fingerprint(self) -> str:
        """Digest of the vehicles and of the rules for the draws."""
        return digest(self._bases, [draw(seed) for seed in range(20)])

    def configurations(self, drawn: Tree) -> dict[str, experiment.ExperimentConfiguration]:
        """Return the configurations without and with the assistant, keyed by variant."""
        patches = drawn["ground"]["patches"].items()
        patched = {"patches": {name: FrictionPatch(**patch) for name, patch in patches}}
        common = experiment.changed(
            self._bases[drawn["vehicle"]],
            seed=drawn["seed"],
            vehicle={"load": drawn["load"]},
            ground=drawn["ground"] | patched,
            maneuver=ManeuverConfiguration(**drawn["maneuver"]),
            velocity_sensor=VelocitySensorConfiguration(**drawn["velocity_sensor"]),
        )
        return {
            variant: experiment.changed(common, brake_assist=drawn["brake_assist"] | switch)
            for variant, switch in _SWITCHES.items()
        }

    def experiment_file(self, seed: int, words: str) -> str:
        """Return the text of an experiment file that repeats the stop of a seed, with two variants.

        The variants are the unassisted and the assisted stop.

        Args:
            seed: seed of the run.
            words: description of the run.
        """
        variants = {}
        for name, one in self.configurations(draw(seed)).items():
            variants[name] = to_mapping(one)
            del variants[name]["description"]
        document = {"description": f"Robustness run {seed}: {words}", "variants": variants}
        return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)


def draw(seed: int) -> Tree:
    """Draw a random run; return the values in which it differs from ``straight_line``.

    Args:
        seed: seed of the run; the same seed gives the same run.
    """
    random = np.random.default_rng([seed])
    vehicle = str(random.choice(list(VEHICLES)))
    largest_load, largest_speed, extent_x, extent_y = VEHICLES[vehicle]
    mass = _number(random, 0.0, largest_load, 0)
    maneuver = _maneuver(random, largest_speed)
    return {
        "seed": seed,
        "vehicle": vehicle,
        "load": {
            "mass": mass,
            "x": _number(random, -extent_x, extent_x),
            "y": _number(random, -extent_y, extent_y),
            "height": _number(random, 0.1, 0.8),
            "yaw_inertia": round(_number(random, 0.02, 0.1) * mass, 1),
        },
        "ground": {
            "friction": _number(random, 0.3, 1.1),
            "patches": _patches(random, maneuver["direction_deg"]),
        },
        "maneuver": maneuver,
        "velocity_sensor": _sensor(random, maneuver["brake_time"]),
        "brake_assist": dict(_TOLERANT) if random.random() < 0.5 else {},
    }


def _number(random: np.random.Generator, low: float, high: float, digits: int = 3) -> float:
    return round(float(random.uniform(low, high)), digits)


def _maneuver(random: np.random.Generator, largest_speed: float) -> Tree:
    turning = random.random() < 0.5
    return {
        "speed": _number(random, 0.5, largest_speed),
        "direction_deg": _number(random, -180.0, 180.0, 1),
        "yaw_rate_deg": _number(random, -90.0, 90.0, 1) if turning else 0.0,
        "hold_world_direction": bool(random.random() < 0.5),
        "brake_time": 0.2,
        "pedal": _number(random, 0.3, 1.0) if random.random() < 0.5 else 1.0,
        "pedal_ramp_time": _number(random, 0.0, 0.3, 2),
    }


def _patches(random: np.random.Generator, direction_deg: float) -> Tree:
    """Return up to three random patches, within 12 m ahead and 2 m beside the line of motion."""
    patches = {}
    for index in range(int(random.integers(0, 4))):
        along, across = random.uniform(0.0, 12.0), random.uniform(-2.0, 2.0)
        angle = math.radians(direction_deg)
        patches[f"patch_{index}"] = {
            "x": round(float(along * math.cos(angle) - across * math.sin(angle)), 3),
            "y": round(float(along * math.sin(angle) + across * math.cos(angle)), 3),
            "length": _number(random, 0.5, 6.0),
            "width": _number(random, 0.5, 3.0),
            "heading_deg": _number(random, -180.0, 180.0, 1),
            "friction": _number(random, 0.05, 1.1),
        }
    return patches


def _sensor(random: np.random.Generator, brake_time: float) -> Tree:
    """Draw noise, offsets and a fault of the velocity sensor around the start of braking [s]."""
    noisy, failing = random.random() < 0.5, random.random() < 0.3
    noise = _number(random, 0.0, 0.15) if noisy else 0.0
    sensor: Tree = {
        "sample_time": float(random.choice([0.01, 0.02, 0.04])),
        "linear_noise": noise,
        "yaw_rate_noise": noise,
        "offset_x": _number(random, -0.02, 0.02) if noisy else 0.0,
        "offset_y": _number(random, -0.02, 0.02) if noisy else 0.0,
        "yaw_rate_offset": _number(random, -0.05, 0.05) if noisy else 0.0,
    }
    kind = str(random.choice(FAILURES[1:]))
    start, duration = _number(random, -0.2, 2.0, 2), _number(random, 0.02, 2.0, 2)
    if failing:
        sensor |= {
            "failure": kind,
            "failure_time": round(brake_time + start, 2),
            "failure_duration": duration,
        }
    return sensor


class Allowed(NamedTuple):
    """Limits on the results of an assisted stop.

    Attributes:
        orientation: limit on the orientation change minus that of the unassisted stop [deg].
        distance: limit on the ratio of the stopping distance to that of the unassisted stop [1]. A
            value of 2 permits the release of half of the wheels.
        energy: limit on the rise of the energy during braking, relative to the energy at the start
            of braking [1].
        shortest: stopping distance that replaces any shorter one in comparisons [m].
    """

    orientation: float = 5.0
    distance: float = 2.0
    energy: float = 1e-3
    shortest: float = 0.2


ALLOWED = Allowed()
"""Limits that apply to every run."""

CAUSES = ("failure", "noise", "patches", "rotation", "direction", "law")
"""Causes of a violated limit: a sensor fault; noise, offset or low rate of the sensor; patches of
other friction; rotation at the start of braking; motion that is not straight ahead; and, if none
of these is the cause, the control law itself."""

LIMITS = ("energy", "orientation", "distance", "rest")
"""Names of the limits; `Outcome` has a field of the same name for the cause of each violation."""


class Outcome(NamedTuple):
    """Results of the unassisted and the assisted stop of a run.

    Attributes:
        seed: seed of the run.
        vehicle: name of the vehicle's file.
        orientation_unassisted: change of orientation without the assistant [deg].
        orientation_assisted: change of orientation with the assistant [deg].
        distance_unassisted: stopping distance without the assistant [m].
        distance_assisted: stopping distance with the assistant [m].
        energy_rise_unassisted: result of `energy_rise` without the assistant [1].
        energy_rise_assisted: result of `energy_rise` with the assistant [1].
        stopped_unassisted: whether the vehicle came to rest without the assistant, 0 or 1.
        stopped_assisted: whether the vehicle came to rest with the assistant, 0 or 1.
        tipping: whether the vehicle would have tipped over in either stop, 0 or 1; the planar model
            reports tipping but does not simulate it.
        rejected_share: share of the braking time in which all brakes are on because inputs are
            rejected [1].
        energy: cause of a violated energy limit, one of `CAUSES`; empty without a violation.
        orientation: cause of a violated orientation limit; empty without a violation.
        distance: cause of a violated distance limit; empty without a violation.
        rest: cause if the vehicle comes to rest without the assistant but not with it; otherwise
            empty.
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
    """Run the stop of a seed, unassisted and assisted; find the causes of violated limits."""
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
    """Run a drawn stop without and with the assistant; return results with empty causes."""
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
    """Return a copy of a drawn run from which one disturbance is removed.

    `cause` is an entry of `CAUSES` and selects the disturbance.
    """
    if cause == "failure":
        kept = {k: v for k, v in drawn["velocity_sensor"].items() if not k.startswith("failure")}
        return drawn | {"velocity_sensor": kept}
    if cause == "noise":
        return drawn | {"velocity_sensor": {}}
    if cause == "patches":
        return drawn | {"ground": drawn["ground"] | {"patches": {}}}
    entry = "yaw_rate_deg" if cause == "rotation" else "direction_deg"
    return drawn | {"maneuver": drawn["maneuver"] | {entry: 0.0}}


def energy_rise(run: FastRun, configuration: experiment.ExperimentConfiguration) -> float:
    """Return the largest rise of the energy from any stamp to a later stamp [1].

    The energy is the kinetic and elastic energy on flat ground, divided by its value when the brake
    pedal opens the clutches of the motor drives. From then on, it must not rise, because brakes can
    only remove energy.
    """
    free = run.pedal >= configuration.vehicle.drive.clutch_threshold
    energy = run.energy[free]
    rise = np.max(energy - np.minimum.accumulate(energy))
    return float(rise / energy[0])


def violations(result: Outcome) -> tuple[str, ...]:
    """Return the names of the limits (`LIMITS`) that a run violates."""
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
