"""Whether the values of an experiment fit together: what a person would see at one glance.

Nothing is refused: each remark is a sentence with the values and a remedy.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

from omni_analysis.loop.experiment import ExperimentConfiguration
from omni_platform.geometry import PlatformGeometry
from omni_platform.sensors import LineSensor
from omni_sim.tire.tire import Tire
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.loads import GRAVITY, MassProperties, load_plane

_OVERLOAD = 1.1  # of the largest load; beyond it the model holds the force
_IDLE_TIRE = 0.05  # of the largest load, below which a tire is for much heavier vehicles
_WEAK_BRAKE, _STRONG_BRAKE = 1.0, 6.0  # torque over what the ground can take
_NARROW, _WIDE = 0.2, 4.0  # yaw inertia over that of a plate of the chassis' size
_HEAVY_WHEEL = 0.5  # inertia over radius squared, in shares of the mass that a wheel carries
_OVERLAP = 0.6  # of two consecutive lines, which the dissertation asks for


@dataclasses.dataclass(frozen=True)
class WheelFacts:
    """What a wheel stands and brakes with.

    Attributes:
        load: at rest [N].
        grip: largest force across the load on dry ground [N].
        brake_force: of the brake at the ground [N].
    """

    load: float
    grip: float
    brake_force: float


def wheel_facts(vehicle: VehicleConfiguration, friction: float = 1.0) -> dict[str, WheelFacts]:
    """Return load, grip and brake of each wheel of a standing vehicle.

    Args:
        vehicle: its wheels may be more than three: the loads are those of a rigid chassis.
        friction: of the ground, as a factor [1].
    """
    masses = MassProperties.of(vehicle.body, vehicle.load)
    geometry = PlatformGeometry.from_wheels(vehicle.wheels)
    shares = load_plane(geometry.position - masses.centre)[:, 0]
    tire = Tire(vehicle.tire)
    facts = {}
    for row, name in enumerate(geometry.names):
        load = float(shares[row]) * masses.mass * GRAVITY
        grip = float(tire.curve(load, friction).peak_force) if load > 0.0 else 0.0
        facts[name] = WheelFacts(load, grip, vehicle.brake.max_torque / float(geometry.radius[row]))
    return facts


def camera_speed(sensor: LineSensor, direction: float) -> float:
    """Return the fastest motion in a direction with 60 % overlap of consecutive lines [m/s].

    Args:
        sensor: the camera.
        direction: of the motion in the body frame [rad].
    """
    angle = direction - math.radians(sensor.heading_deg)
    steps = (abs(math.cos(angle)) / sensor.length, abs(math.sin(angle)) / sensor.width)
    return (1.0 - _OVERLAP) * sensor.line_rate / max(*steps, 1e-12)


def remarks(experiment: ExperimentConfiguration) -> tuple[str, ...]:
    """Return what does not fit together, most dangerous for the result first."""
    vehicle = experiment.vehicle
    return (
        *_tire_remarks(vehicle, experiment.ground.friction),
        *_brake_remarks(vehicle, experiment.ground.friction),
        *_inertia_remarks(vehicle),
        *(_camera_remarks(experiment) if experiment.feedback == "optical" else ()),
    )


def _tire_remarks(vehicle: VehicleConfiguration, friction: float) -> Iterator[str]:
    largest = vehicle.tire.largest_load
    facts = wheel_facts(vehicle, friction)
    heaviest = max(facts, key=lambda name: facts[name].load)
    load = facts[heaviest].load
    if load > _OVERLOAD * largest:
        yield (
            f"vehicle.tire: wheel {heaviest} stands with {load:.3g} N on a tire for at most "
            f"{largest:.3g} N; take a stronger tire, or more wheels"
        )
    elif load < _IDLE_TIRE * largest:
        yield (
            f"vehicle.tire: the tire is for up to {largest:.3g} N and no wheel carries more than "
            f"{load:.3g} N, so that its stiffness is that of a far heavier vehicle; take the tire "
            "that ./omni new-vehicle scales to the load, or fit one with ./omni fit-tire"
        )


def _brake_remarks(vehicle: VehicleConfiguration, friction: float) -> Iterator[str]:
    facts = wheel_facts(vehicle, friction)
    grip = sum(fact.grip for fact in facts.values())
    ratio = sum(fact.brake_force for fact in facts.values()) / max(grip, 1e-9)
    needed = vehicle.brake.max_torque / max(ratio, 1e-9)
    if ratio < _WEAK_BRAKE:
        yield (
            f"vehicle.brake.max_torque: {vehicle.brake.max_torque:.3g} N m reach {100 * ratio:.0f} "
            f"% of the grip, so that the wheels never lock and hardly swerve; locking takes "
            f"{needed:.3g} N m"
        )
    elif ratio > _STRONG_BRAKE:
        yield (
            f"vehicle.brake.max_torque: {vehicle.brake.max_torque:.3g} N m are {ratio:.0f} times "
            f"what the ground can take; about {2 * needed:.3g} N m would lock the wheels as well"
        )


def _inertia_remarks(vehicle: VehicleConfiguration) -> Iterator[str]:
    masses = MassProperties.of(vehicle.body, vehicle.load)
    plate = masses.mass * (vehicle.chassis_length**2 + vehicle.chassis_width**2) / 12.0
    ratio = masses.yaw_inertia / plate
    if not _NARROW < ratio < _WIDE:
        yield (
            f"vehicle.body.yaw_inertia: {masses.yaw_inertia:.3g} kg m^2 with the load, where a "
            f"plate of {vehicle.chassis_length:g} x {vehicle.chassis_width:g} m and this mass has "
            f"{plate:.3g} kg m^2; check mass, size and inertia"
        )
    carried = masses.mass / len(vehicle.wheels)
    for name, mount in vehicle.wheels.items():
        moved = vehicle.wheel_inertia / mount.radius**2
        if moved > _HEAVY_WHEEL * carried:
            yield (
                f"vehicle.wheel_inertia: {vehicle.wheel_inertia:.3g} kg m^2 act at the rim of "
                f"wheel {name} as {moved:.3g} kg, beside {carried:.3g} kg that it carries; a solid "
                "disc has half of its mass times its radius squared"
            )
            return


def _camera_remarks(experiment: ExperimentConfiguration) -> Iterator[str]:
    vehicle, maneuver = experiment.vehicle, experiment.maneuver
    for name, sensor in experiment.sensors.items():
        if abs(sensor.x) > vehicle.chassis_length / 2 or abs(sensor.y) > vehicle.chassis_width / 2:
            yield (
                f"sensors.{name}: at ({sensor.x:g}, {sensor.y:g}) m it is beyond the edge of the "
                f"chassis of {vehicle.chassis_length:g} x {vehicle.chassis_width:g} m; "
                "./omni design-sensors finds places under it"
            )
    direction = math.radians(maneuver.direction_deg)
    limits = {name: camera_speed(one, direction) for name, one in experiment.sensors.items()}
    slowest = min(limits, key=lambda name: limits[name])
    if maneuver.speed > limits[slowest]:
        yield (
            f"sensors.{slowest}: consecutive lines share less than 60 % above "
            f"{limits[slowest]:.3g} m/s in the direction of motion, and the maneuver begins at "
            f"{maneuver.speed:g} m/s; take a wider view or more lines per second, or set "
            f"maneuver.speed={0.9 * limits[slowest]:.2g}"
        )
