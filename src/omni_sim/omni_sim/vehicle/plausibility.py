"""Plausibility check of the values of a vehicle.

No value is rejected. Each remark is a sentence that contains the values and a remedy. The ranges
contain robots of 0.5 kg as well as forklifts of 5 t, so a value outside is usually given in a wrong
unit, or is the default value of a vehicle of another size.
"""

import dataclasses
from collections.abc import Iterator, Mapping

import numpy as np

from omni_core.geometry import PlatformGeometry
from omni_core.quantities import GRAVITY, plain
from omni_sim.tire.tire import Tire
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.loads import load_plane
from omni_sim.vehicle.rollers import roller_remarks

# Plausible ranges of ratios [1]. load: wheel load to the largest load of the tire. brake and drive:
# torque to the torque at the friction limit. yaw_inertia: yaw inertia to that of a plate as large
# as the chassis. wheel_inertia: inertia of a wheel to its carried mass times its squared radius.
# height: height of the center of gravity to the longer side of the chassis. outside: distance of a
# wheel from the chassis' center to half of the chassis, along either side.
_PLAUSIBLE = {
    "load": (0.05, 1.1),
    "brake": (1.0, 6.0),
    "drive": (0.0, 12.0),
    "yaw_inertia": (0.2, 4.0),
    "wheel_inertia": (0.0, 0.5),
    "height": (0.0, 2.0),
    "outside": (0.0, 2.0),
}
_AREA_DENSITY = 2.0, 1.0e4  # mass to the area of the chassis [kg/m^2]; a steel block has 7800 per m


@dataclasses.dataclass(frozen=True)
class WheelFacts:
    """Load of a wheel at rest, and limits on the force of the wheel.

    Attributes:
        load: load at rest [N].
        grip: friction capacity [N].
        brake_force: force of the brake at the contact with the ground [N].
    """

    load: float
    grip: float
    brake_force: float


def wheel_facts(vehicle: VehicleConfiguration, friction: float = 1.0) -> dict[str, WheelFacts]:
    """Return load, friction capacity and brake force of the wheels at rest, keyed by wheel.

    Args:
        vehicle: vehicle with any number of wheels; the loads are computed for a rigid chassis.
        friction: friction factor of the ground [1].
    """
    masses = vehicle.masses
    geometry = PlatformGeometry.from_wheels(vehicle.wheels)
    loads = load_plane(geometry.position - masses.center)[:, 0] * masses.mass * GRAVITY
    grips = friction * vehicle.by_wheel("friction")
    forces = vehicle.brake.max_torque * vehicle.by_wheel("brake") / geometry.radius
    tire, facts = Tire(vehicle.tire), {}
    for name, *values in zip(geometry.names, loads, grips, forces, strict=True):
        load, grip, force = map(float, values)
        peak = float(tire.curve(load, grip).peak_force) if load > 0.0 else 0.0
        facts[name] = WheelFacts(load, peak, force)
    return facts


def brakes_over_grip(facts: Mapping[str, WheelFacts]) -> float:
    """Return the ratio of the force of all brakes to the friction capacity of all wheels [1]."""
    grip = sum(fact.grip for fact in facts.values())
    return sum(fact.brake_force for fact in facts.values()) / max(grip, 1e-9)


def vehicle_remarks(vehicle: VehicleConfiguration, friction: float = 1.0) -> tuple[str, ...]:
    """Return sentences about implausible values of a vehicle, the most important one first.

    A value may be in a wrong unit, or it is a default, which belongs to a forklift of 1 t.

    Args:
        vehicle: vehicle to check.
        friction: friction factor of the ground [1].
    """
    facts = wheel_facts(vehicle, friction)
    return (
        *(f"vehicle.{remark}" for remark in roller_remarks(vehicle.wheels)),
        *_size_remarks(vehicle),
        *_load_remarks(facts),
        *_inertia_remarks(vehicle),
        *_tire_remarks(vehicle, facts),
        *_brake_remarks(vehicle, facts),
        *_drive_remarks(vehicle, facts if friction == 1.0 else wheel_facts(vehicle)),
    )


def _size_remarks(vehicle: VehicleConfiguration) -> Iterator[str]:
    """Yield sentences about lengths and masses in another unit than m and kg."""
    sides, masses = vehicle.chassis_size, vehicle.masses
    chassis = f"the chassis of {sides[0]:g} x {sides[1]:g} m"
    density = masses.mass / float(np.prod(sides))
    lightest, most = _AREA_DENSITY
    if not lightest < density < most:
        yield (
            f"vehicle.body.mass: {plain(masses.mass)} kg with the load on {chassis} are "
            f"{plain(density)} kg/m^2; check mass (kg) and size (m)"
        )
    if masses.height > _PLAUSIBLE["height"][1] * max(sides):
        yield (
            f"vehicle.body.height: the center of gravity is {plain(masses.height)} m above the "
            f"ground, but {chassis} is smaller; check height and size (m)"
        )
    for name, mount in vehicle.wheels.items():
        from_center = np.subtract((mount.x, mount.y), vehicle.chassis_center)
        if np.any(2.0 * np.abs(from_center) > _PLAUSIBLE["outside"][1] * sides):
            yield (
                f"vehicle.wheels.{name}: its position ({mount.x:g}, {mount.y:g}) m is far outside "
                f"{chassis}; check position, size and chassis_x, chassis_y (m)"
            )
            return


def _load_remarks(facts: Mapping[str, WheelFacts]) -> Iterator[str]:
    lifted = min(facts, key=lambda name: facts[name].load)
    if facts[lifted].load < 0.0:
        yield (
            f"vehicle.load: wheel {lifted} lifts off the ground at rest (load "
            f"{plain(facts[lifted].load)} N); reduce mass or offset of the load"
        )


def _tire_remarks(vehicle: VehicleConfiguration, facts: Mapping[str, WheelFacts]) -> Iterator[str]:
    largest = vehicle.tire.largest_load
    heaviest = max(facts, key=lambda name: facts[name].load)
    load = facts[heaviest].load
    lightest, most = _PLAUSIBLE["load"]
    if load > most * largest:
        yield (
            f"vehicle.tire: wheel {heaviest} carries {plain(load)} N, but its tire is valid up to "
            f"{plain(largest)} N; use a stronger tire, or more wheels"
        )
    elif load < lightest * largest:
        yield (
            f"vehicle.tire: no wheel carries more than {plain(load)} N, but the tire is for loads "
            f"up to {plain(largest)} N, so it is too stiff for this vehicle; use the tire that "
            "./omni new-vehicle scales to the load, or fit one with ./omni fit-tire"
        )


def _brake_remarks(vehicle: VehicleConfiguration, facts: Mapping[str, WheelFacts]) -> Iterator[str]:
    ratio = brakes_over_grip(facts)
    needed = vehicle.brake.max_torque / max(ratio, 1e-9)
    weakest, strongest = _PLAUSIBLE["brake"]
    if 0.0 < ratio < weakest:
        yield (
            f"vehicle.brake.max_torque: {plain(vehicle.brake.max_torque)} N m give "
            f"{100 * ratio:.0f} % of the friction limit, so the wheels never lock and the vehicle "
            f"hardly swerves; {plain(needed)} N m lock the wheels"
        )
    elif ratio > strongest:
        yield (
            f"vehicle.brake.max_torque: {plain(vehicle.brake.max_torque)} N m give {ratio:.0f} "
            f"times the friction limit; about {plain(2 * needed)} N m would also lock the wheels"
        )


def _drive_remarks(vehicle: VehicleConfiguration, facts: Mapping[str, WheelFacts]) -> Iterator[str]:
    grips = [facts[name].grip * mount.radius for name, mount in vehicle.wheels.items()]
    needed = sum(grips) / len(grips)
    torque = vehicle.drive.max_torque
    if torque > _PLAUSIBLE["drive"][1] * needed:
        yield (
            f"vehicle.drive.max_torque: {plain(torque)} N m give {torque / max(needed, 1e-9):.0f} "
            f"times the friction limit; about {plain(2 * needed)} N m would also spin the wheels"
        )


def _inertia_remarks(vehicle: VehicleConfiguration) -> Iterator[str]:
    masses = vehicle.masses
    plate = masses.mass * (vehicle.chassis_length**2 + vehicle.chassis_width**2) / 12.0
    ratio = masses.yaw_inertia / plate
    low, high = _PLAUSIBLE["yaw_inertia"]
    if not low < ratio < high:
        yield (
            f"vehicle.body.yaw_inertia: {plain(masses.yaw_inertia)} kg m^2 with the load, but a "
            f"plate of {vehicle.chassis_length:g} x {vehicle.chassis_width:g} m and this mass has "
            f"{plain(plate)} kg m^2; check mass, size and inertia"
        )
    carried = masses.mass / len(vehicle.wheels)
    for name, mount in vehicle.wheels.items():
        moved = vehicle.wheel_inertia / mount.radius**2
        if moved > _PLAUSIBLE["wheel_inertia"][1] * carried:
            yield (
                f"vehicle.wheel_inertia: {plain(vehicle.wheel_inertia)} kg m^2 correspond to "
                f"a mass of {plain(moved)} kg at the rim of wheel {name}, which carries only "
                f"{plain(carried)} kg; a solid disc has half of its mass times its radius squared"
            )
            return
