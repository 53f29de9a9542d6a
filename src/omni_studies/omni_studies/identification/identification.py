"""Identification of the vehicle of Table 2, whose parameters are not given in the dissertation.

A candidate is a vector of the `QUANTITIES`: masses and their positions, distances of the wheels,
brake torque, motion at the start of braking, and friction. Other values, such as the tire of Table
1, are assumed. `measure` runs the five cases of Table 2 with a candidate in the fast loop. The cost
is the sum of the squared deviations from Table 2, in multiples of their tolerances. If it is below
1, all ten numbers are within their tolerance.

The vehicle moves along the world's y axis, which points up in Figure 43. Braking starts with
`base_link` at the origin.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from omni_core import kinematics, quantities
from omni_core.configuration import ConfigurationError
from omni_core.quantities import GRAVITY
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentConfiguration, changed
from omni_sim.ground.configuration import FrictionPatch
from omni_sim.masses import MassConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.loads import load_plane
from omni_studies.identification import table_2


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A parameter of the vehicle that is identified, and its range.

    Attributes:
        name: name of the parameter.
        unit: SI symbol, ``deg``, ``deg/s`` or ``1``.
        low: lower limit, in `unit`.
        high: upper limit, in `unit`.
        step: step for the sensitivity analysis, in `unit`.
        decimals: number of decimals in a configuration file.
    """

    name: str
    unit: str
    low: float
    high: float
    step: float
    decimals: int

    def near(self, value: float) -> tuple[float, float]:
        """Return lower and upper limits around a value, in `unit`.

        The limits are a tenth of the range below and above the value, but within the range.
        """
        reach = 0.1 * (self.high - self.low)
        return max(value - reach, self.low), min(value + reach, self.high)


QUANTITIES = (
    Quantity("body_mass", "kg", 800.0, 1500.0, 10.0, 0),  # body with wheels, at the center
    Quantity("body_inertia", "kg m^2", 150.0, 700.0, 10.0, 0),  # of the body about the vertical
    Quantity("load_mass", "kg", 200.0, 600.0, 10.0, 0),  # load, a point
    Quantity("load_x", "m", 0.3, 0.8, 0.01, 3),  # load, forward of the center
    Quantity("load_y", "m", 0.1, 0.6, 0.01, 3),  # load, left of the center
    Quantity("height", "m", 0.2, 0.6, 0.01, 3),  # centers of gravity above the ground
    Quantity("wheelbase", "m", 1.1, 1.9, 0.01, 3),  # distance of front and rear wheels
    Quantity("track", "m", 0.7, 1.3, 0.01, 3),  # distance of left and right wheels
    Quantity("brake_torque", "N m", 800.0, 2000.0, 10.0, 0),  # maximum torque of a brake
    Quantity("speed", "m/s", 5.8, 7.0, 0.05, 3),  # when braking starts
    Quantity("direction", "deg", -60.0, -30.0, 1.0, 2),  # from forward, when braking starts
    Quantity("yaw_rate", "deg/s", 60.0, 90.0, 1.0, 2),  # when braking starts
    Quantity("friction", "1", 0.5, 0.8, 0.01, 3),  # mu/mu_0 of the ground
    Quantity("patch_friction", "1", 0.25, 0.5, 0.01, 3),  # mu/mu_0 of the patch
    Quantity("patch_x", "m", -1.0, 1.0, 0.05, 2),  # center of the patch, right of the motion
    Quantity("patch_y", "m", 0.0, 6.0, 0.05, 2),  # center of the patch along the motion
    Quantity("patch_length", "m", 3.0, 9.0, 0.05, 2),  # of the patch along the motion
    Quantity("patch_width", "m", 1.0, 3.0, 0.05, 2),  # of the patch across the motion
)
"""Identified parameters with their ranges."""

_PATCH = ("friction", "x", "y", "length", "width")  # quantities whose key has the prefix ``patch_``

Parameters = Mapping[str, float]


def rounded(vector: Sequence[float] | quantities.FloatArray) -> dict[str, float]:
    """Return the values of a candidate, keyed by parameter, rounded as in a configuration file.

    Args:
        vector: values in the order of `QUANTITIES`.
    """
    return {
        quantity.name: round(float(value), quantity.decimals)
        for quantity, value in zip(QUANTITIES, vector, strict=True)
    }


def configure(base: ExperimentConfiguration, parameters: Parameters) -> ExperimentConfiguration:
    """Return an experiment with the vehicle, the ground and the motion of a candidate.

    Args:
        base: a variant of ``turn_while_translate``, from which all other values are taken.
        parameters: values of the parameters, keyed by the names in `QUANTITIES`.

    Raises:
        ConfigurationError: the vehicle would tip over at rest.
    """
    p, wheels = parameters, {}
    for name, mount in base.vehicle.wheels.items():
        x = math.copysign(p["wheelbase"] / 2.0, mount.x)
        y = math.copysign(p["track"] / 2.0, mount.y)
        wheels[name] = changed(mount, x=x, y=y)
    height = p["height"]
    body = MassConfiguration(mass=p["body_mass"], height=height, yaw_inertia=p["body_inertia"])
    load = MassConfiguration(mass=p["load_mass"], x=p["load_x"], y=p["load_y"], height=height)
    vehicle = changed(
        base.vehicle,
        wheels=wheels,
        chassis_length=round(p["wheelbase"] + 0.4, 2),  # plus the wheel diameter
        chassis_width=round(p["track"] + 0.2, 2),
        body=body,
        load=load,
        brake={"max_torque": p["brake_torque"]},
    )
    sizes: dict[str, Any] = {name: p[f"patch_{name}"] for name in _PATCH}
    patch = FrictionPatch(heading_deg=90.0, **sizes)
    before = base.maneuver.brake_time
    direction = round(p["direction"] + p["yaw_rate"] * before, 4)
    maneuver = {
        "y": round(-p["speed"] * before, 4),
        "heading_deg": round(90.0 - direction, 4),
        "direction_deg": direction,
        "speed": p["speed"],
        "yaw_rate_deg": p["yaw_rate"],
    }
    return changed(
        base,
        vehicle=vehicle,
        ground={"friction": p["friction"], "patches": {"ice": patch}},
        maneuver=maneuver,
        brake_assist={"wheels": wheels, "brake": vehicle.brake},
    )


def parameters_of(configuration: ExperimentConfiguration) -> dict[str, float]:
    """Return the parameters with which `configure` creates an experiment, keyed by name."""
    vehicle, maneuver = configuration.vehicle, configuration.maneuver
    ground = configuration.ground
    mount = next(iter(vehicle.wheels.values()))
    patch = next(iter(ground.patches.values()))
    values = {
        "body_mass": vehicle.body.mass,
        "body_inertia": vehicle.body.yaw_inertia,
        "load_mass": vehicle.load.mass,
        "load_x": vehicle.load.x,
        "load_y": vehicle.load.y,
        "height": vehicle.body.height,
        "wheelbase": 2.0 * abs(mount.x),
        "track": 2.0 * abs(mount.y),
        "brake_torque": vehicle.brake.max_torque,
        "speed": maneuver.speed,
        "direction": maneuver.direction_deg - maneuver.yaw_rate_deg * maneuver.brake_time,
        "yaw_rate": maneuver.yaw_rate_deg,
        "friction": ground.friction,
        **{f"patch_{name}": getattr(patch, name) for name in _PATCH},
    }
    return rounded([values[quantity.name] for quantity in QUANTITIES])


def measure(configurations: Mapping[str, ExperimentConfiguration]) -> dict[str, float]:
    """Run the cases of Table 2; return the ten numbers, NaN for a case that does not stop.

    Args:
        configurations: configurations, keyed by case.
    """
    measured = {}
    for case, configuration in configurations.items():
        run = run_fast_loop(configuration)
        change, distance = run.orientation_change, run.stopping_distance
        measured[f"orientation_change.{case}"] = change if run.stopped else math.nan
        measured[f"stopping_distance.{case}"] = distance if run.stopped else math.nan
    return {name: measured[name] for name in table_2.REFERENCES}


_SKIPPED = 100.0  # cost of a case that is skipped
_REFINEMENT = 60  # limit on the number of generations of the second search


def assumption_violation(vehicle: VehicleConfiguration) -> float:
    """Return how far a vehicle violates two conditions [1]; 0 if it meets both.

    The load must be between the wheels, and at rest no wheel may exceed the load range of its tire.
    """
    position = kinematics.PlatformKinematics(vehicle.wheels).geometry.position
    masses = vehicle.masses
    carried = masses.mass * GRAVITY * load_plane(position - masses.center)[:, 0]
    overload = max(float(carried.max()) / vehicle.tire.largest_load - 1.0, 0.0)
    overhang = np.abs([vehicle.load.x, vehicle.load.y]) / np.abs(position).max(axis=0) - 1.0
    return overload + float(np.maximum(overhang, 0.0).sum())


def cost(
    bases: Mapping[str, ExperimentConfiguration],
    parameters: Parameters,
    exponent: int = 2,
    *,
    sound: bool = False,
    abort_above: float = 25.0,
) -> float:
    """Return the sum of the deviations from Table 2, each raised to the power `exponent` [1].

    A deviation is expressed in multiples of its tolerance. After cases with very large deviations,
    the remaining cases are skipped, and each adds a high cost.

    Args:
        bases: variants of ``turn_while_translate``, keyed by case of Table 2.
        parameters: values of the parameters, keyed by the names in `QUANTITIES`.
        exponent: even exponent; a larger one gives more weight to the largest deviation.
        sound: whether a vehicle with an `assumption_violation` costs more than any other, which
            excludes it.
        abort_above: mean cost per case above which the remaining cases are skipped [1].
    """
    total = 0.0
    if sound:
        try:
            violation = assumption_violation(
                configure(next(iter(bases.values())), parameters).vehicle
            )
        except ConfigurationError:
            return math.inf
        if violation > 0.0:
            return _SKIPPED * len(bases) * (1.0 + violation)
    for done, (case, base) in enumerate(bases.items()):
        if total > abort_above * done:
            return total + (len(bases) - done) * _SKIPPED
        try:
            run = run_fast_loop(configure(base, parameters))
        except ConfigurationError:
            return math.inf
        for quantity, value in (
            ("orientation_change", run.orientation_change),
            ("stopping_distance", run.stopping_distance),
        ):
            name = f"{quantity}.{case}"
            deviation = (value - table_2.REFERENCES[name]) / table_2.tolerance(name)
            total += min(deviation**exponent, _SKIPPED / 2.0) if run.stopped else _SKIPPED / 2.0
    return total


def search(
    bases: Mapping[str, ExperimentConfiguration],
    *,
    start: Parameters | None = None,
    seed: int,
    generations: int,
    sound: bool = False,
    on_generation: Callable[[int, float], None] = lambda _generation, _cost: None,
) -> dict[str, float]:
    """Search for the parameters of Table 2 by differential evolution in one process.

    The first search covers the whole range and minimizes the sum of squares. The second search
    covers the surroundings of the first result and minimizes the sum of fourth powers, which
    reduces the largest deviation. The result depends only on the seed and the library versions.

    Args:
        bases: variants of ``turn_while_translate``, keyed by case of Table 2.
        start: candidate near which the second search begins; if given, the first search is omitted.
        seed: seed of all random numbers.
        generations: limit on the number of generations of each search. The first search ends at a
            cost below 1, the second below 0.7^4, where no deviation exceeds 0.7 tolerances; the
            second search has at most `_REFINEMENT` generations.
        sound: whether a vehicle with an `assumption_violation` is excluded.
        on_generation: function called with each generation's number and the lowest cost so far.

    Returns:
        The best candidate found, keyed by the names in `QUANTITIES`.
    """
    from scipy.optimize import OptimizeResult, differential_evolution  # slow import

    def evolve(
        box: Sequence[tuple[float, float]], exponent: int, good_enough: float, longest: int
    ) -> dict[str, float]:
        done = itertools.count(1)

        def after_generation(intermediate_result: OptimizeResult) -> None:
            on_generation(next(done), float(intermediate_result.fun))
            if intermediate_result.fun < good_enough:
                raise StopIteration

        result = differential_evolution(
            lambda vector: min(cost(bases, rounded(vector), exponent, sound=sound), 1e4),
            box,
            rng=seed,
            init="latinhypercube",
            popsize=4,
            maxiter=longest,
            mutation=(0.4, 0.9),
            recombination=0.8,
            tol=0.0,
            polish=False,
            callback=after_generation,
        )
        return rounded(result.x)

    found = start or evolve([(one.low, one.high) for one in QUANTITIES], 2, 1.0, generations)
    near = [quantity.near(found[quantity.name]) for quantity in QUANTITIES]
    return evolve(near, 4, 0.7**4, min(generations, _REFINEMENT))
