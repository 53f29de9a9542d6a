"""Plausibility check of the values of an experiment.

No value is rejected. Each remark is a sentence that contains the values and a remedy.
"""

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from omni_loop.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_platform.geometry import PlatformGeometry
from omni_platform.sensors import OVERLAP, LineSensor, Mount
from omni_sim.driver.scripted import ManeuverConfiguration, ScriptedDriver
from omni_sim.tire.tire import Tire
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.loads import GRAVITY, load_plane
from omni_tools.vehicles.rollers import roller_remarks

# Plausible ranges of ratios [1]. load: wheel load to the largest load of the tire. brake and drive:
# torque to the torque at the friction limit. yaw_inertia: yaw inertia to that of a plate as large
# as the chassis. wheel_inertia: inertia of a wheel to its carried mass times its squared radius.
_PLAUSIBLE = {
    "load": (0.05, 1.1),
    "brake": (1.0, 6.0),
    "drive": (0.0, 12.0),
    "yaw_inertia": (0.2, 4.0),
    "wheel_inertia": (0.0, 0.5),
}


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


def plain(value: float) -> str:
    """Return a number as text with three significant digits; large ones without an exponent."""
    words = f"{value:.3g}"
    return f"{float(words):.0f}" if "e+" in words else words


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


def camera_speed(sensor: LineSensor, direction: float) -> float:
    """Return the speed [m/s] at which consecutive lines of a camera overlap by 60 %.

    Args:
        sensor: the camera.
        direction: direction of the motion in the body frame [rad].
    """
    angle = direction - math.radians(sensor.heading_deg)
    steps = (abs(math.cos(angle)) / sensor.length, abs(math.sin(angle)) / sensor.width)
    return (1.0 - OVERLAP) * sensor.line_rate / max(*steps, 1e-12)


def remarks(experiment: ExperimentConfiguration) -> tuple[str, ...]:
    """Return remarks on implausible values of an experiment, the most important one first."""
    cameras = _camera_remarks(experiment) if experiment.feedback == "optical" else ()
    return (*vehicle_remarks(experiment.vehicle, experiment.ground.friction), *cameras)


def vehicle_remarks(vehicle: VehicleConfiguration, friction: float = 1.0) -> tuple[str, ...]:
    """Return remarks on implausible values of a vehicle.

    Args:
        vehicle: vehicle to check.
        friction: friction factor of the ground [1].
    """
    facts = wheel_facts(vehicle, friction)
    return (
        *(f"vehicle.{remark}" for remark in roller_remarks(vehicle.wheels)),
        *_load_remarks(facts),
        *_tire_remarks(vehicle, facts),
        *_brake_remarks(vehicle, facts),
        *_drive_remarks(vehicle),
        *_inertia_remarks(vehicle),
    )


class RemarkingLibrary(ExperimentLibrary):
    """Experiment library that reports each implausible value once."""

    def __init__(self, folder: Path, report: Callable[[str], None]) -> None:
        super().__init__(folder)
        self._report = report
        self._reported: set[str] = set()

    def load(
        self, experiment: str, variant: str | None = None, overrides: Iterable[str] = ()
    ) -> ExperimentConfiguration:
        """Compose an experiment as `ExperimentLibrary` does, and report its implausible values."""
        loaded = super().load(experiment, variant, overrides)
        self._remark(remarks(loaded))
        return loaded

    def vehicle(self, name: str) -> VehicleConfiguration:
        """Read a vehicle as `ExperimentLibrary` does, and report its implausible values."""
        loaded = super().vehicle(name)
        self._remark(vehicle_remarks(loaded))
        return loaded

    def _remark(self, remarks: Iterable[str]) -> None:
        for remark in remarks:
            if remark not in self._reported:
                self._reported.add(remark)
                self._report(remark)


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
    if ratio < weakest:
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


def _drive_remarks(vehicle: VehicleConfiguration) -> Iterator[str]:
    facts = wheel_facts(vehicle)
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


def _camera_remarks(experiment: ExperimentConfiguration) -> Iterator[str]:
    """Yield sentences about sensors outside the chassis or too slow for the maneuver."""
    vehicle, twists = experiment.vehicle, _twists(experiment.maneuver)
    mounts: dict[str, Mount] = {f"sensors.{name}": s for name, s in experiment.sensors.items()}
    mounts |= {f"flow_sensors.{name}": s for name, s in experiment.flow_sensors.items()}
    for key, sensor in mounts.items():
        if abs(sensor.x) > vehicle.chassis_length / 2 or abs(sensor.y) > vehicle.chassis_width / 2:
            yield (
                f"{key}: its position ({sensor.x:g}, {sensor.y:g}) m is beyond the edge of the "
                f"chassis of {vehicle.chassis_length:g} x {vehicle.chassis_width:g} m; "
                "./omni design-sensors finds positions under the chassis"
            )
    ratio, speed, name = max(
        (
            (math.hypot(x, y) / camera_speed(one, math.atan2(y, x)), math.hypot(x, y), name)
            for name, one in experiment.sensors.items()
            for x, y in (_velocity(one, twist) for twist in twists)
        ),
        default=(0.0, 0.0, ""),
    )
    if ratio > 1.0:
        yield (
            f"sensors.{name}: in its direction of motion, consecutive lines overlap by less than "
            f"60 % above {plain(speed / ratio)} m/s, but the camera moves at up to "
            f"{plain(speed)} m/s; use a wider view or a higher line rate, or reduce the speed to "
            f"{90.0 / ratio:.0f} %"
        )
    for name, flow in experiment.flow_sensors.items():
        speed = max(math.hypot(*_velocity(flow, twist)) for twist in twists)
        if speed > flow.maximum_speed > 0.0:
            yield (
                f"flow_sensors.{name}: it moves at up to {plain(speed)} m/s, but measures only up "
                f"to {plain(flow.maximum_speed)} m/s; mount it higher, or reduce the speed"
            )


def _velocity(sensor: Mount, twist: tuple[float, float, float]) -> tuple[float, float]:
    """Return the velocity of a sensor over the ground, in the body frame [m/s]."""
    return twist[0] - twist[2] * sensor.y, twist[1] + twist[2] * sensor.x


def _twists(maneuver: ManeuverConfiguration) -> list[tuple[float, float, float]]:
    """Return the twists demanded by a driver [m/s, m/s, rad/s]."""
    table = maneuver.demands
    if table.time:
        return list(zip(table.forward, table.left, table.turn, strict=True))
    forward, left, turn = ScriptedDriver(maneuver).start_twist.tolist()
    return [(forward, left, turn)]
