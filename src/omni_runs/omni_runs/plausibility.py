"""Plausibility check of the values of an experiment.

No value is rejected. Each remark is a sentence that contains the values and a remedy.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from omni_core.quantities import plain
from omni_core.sensors import OVERLAP, LineSensor, Mount, heading_remarks
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_sim.driver.configuration import ManeuverConfiguration
from omni_sim.driver.scripted import ScriptedDriver
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.plausibility import vehicle_remarks, wheel_facts


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
    return (
        *vehicle_remarks(experiment.vehicle, experiment.ground.friction),
        *_maneuver_remarks(experiment),
        *heading_remarks("sensors", experiment.sensors),
        *heading_remarks("flow_sensors", experiment.flow_sensors),
        *cameras,
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


def _maneuver_remarks(experiment: ExperimentConfiguration) -> Iterator[str]:
    """Yield a sentence about a curve that needs more friction than the ground has."""
    if experiment.maneuver.hold_world_direction:
        return
    facts = wheel_facts(experiment.vehicle, experiment.ground.friction).values()
    limit = sum(fact.grip for fact in facts) / experiment.vehicle.masses.mass
    twists = _twists(experiment.maneuver)
    speed, rate = max(
        ((math.hypot(forward, left), abs(turn)) for forward, left, turn in twists), key=math.prod
    )
    if speed * rate > limit:
        yield (
            f"maneuver: a curve at {plain(speed)} m/s and {plain(rate)} rad/s "
            f"({plain(math.degrees(rate))} deg/s) is an acceleration of {plain(speed * rate)} "
            f"m/s^2, but the friction permits {plain(limit)} m/s^2; check the units"
        )


def _camera_remarks(experiment: ExperimentConfiguration) -> Iterator[str]:
    """Yield sentences about sensors outside the chassis or too slow for the maneuver."""
    vehicle, twists = experiment.vehicle, _twists(experiment.maneuver)
    mounts: dict[str, Mount] = {f"sensors.{name}": s for name, s in experiment.sensors.items()}
    mounts |= {f"flow_sensors.{name}": s for name, s in experiment.flow_sensors.items()}
    for key, sensor in mounts.items():
        from_center = np.abs(np.subtract((sensor.x, sensor.y), vehicle.chassis_center))
        if np.any(2.0 * from_center > vehicle.chassis_size):
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
