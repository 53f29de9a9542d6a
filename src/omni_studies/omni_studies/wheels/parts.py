"""Numbers of two rows of rollers (Figure 2) and of a motor (Appendix A), next to closed forms."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from omni_core.geometry import PlatformGeometry, cross
from omni_core.quantities import GRAVITY, FloatArray
from omni_runs.metrics import Metric
from omni_sim.vehicle.configuration import DriveConfiguration, VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle
from omni_studies.wheels.kinds import stopped
from omni_studies.wheels.trials import ROLLERS, with_wheels

_APART = 0.04  # distance between the rows [m]
_SMALL = 0.04  # radius of the small rollers [m]; that of the others is 0.045 m
_ROLLERS = 12  # number of rollers per wheel
_RESISTANCE = 0.1  # resistance to the rolling vehicle, as a multiple of its weight [1]
# A motor that accelerates the vehicle at 1 m/s^2 from rest, and idles at 3 m/s.
_STALL, _IDLING = 65.0, 15.0  # [N m], [rad/s]
_LONG = 20.0  # six time constants of the acceleration to the idling speed [s]
_CURRENT_TIME = 0.05  # time constant of the current loop [s]


def metrics(mecanum: VehicleConfiguration, omni: VehicleConfiguration) -> dict[str, Metric]:
    """Return the numbers of two rows on two vehicles, and of a motor on the first of them.

    Args:
        mecanum: vehicle on Mecanum wheels.
        omni: vehicle on omni-wheels.
    """
    found = _stops(mecanum) | _motor(mecanum)
    lever = row_levers(_with_rollers(omni, rows_apart=_APART))
    return found | {
        "row_lever.largest": Metric(1e3 * float(np.max(np.abs(lever))), "mm"),
        "row_lever.mean": Metric(1e3 * float(np.mean(lever)), "mm"),
    }


def _with_rollers(vehicle: VehicleConfiguration, **changes: float) -> VehicleConfiguration:
    vehicle = with_wheels(vehicle, ROLLERS, _ROLLERS)
    return dataclasses.replace(vehicle, rollers=dataclasses.replace(vehicle.rollers, **changes))


def row_levers(vehicle: VehicleConfiguration) -> FloatArray:
    """Return the lever of a rolling wheel's force about its center in each step of a turn [m]."""
    geometry, command = PlatformGeometry.from_wheels(vehicle.wheels), np.array([1.0, 0.0, 0.0])
    machine, all_on = Vehicle(vehicle, twist=command), np.ones(len(vehicle.wheels))
    machine.push((-_RESISTANCE * machine.masses.mass * GRAVITY, 0.0))
    machine.advance(2000, 0.0, all_on, command, traced=False)
    arm, levers = geometry.position[0] - machine.masses.center, []
    start = machine.wheels["angle"][0]
    while abs(machine.wheels["angle"][0] - start) < math.tau:
        machine.advance(1, 0.0, all_on, command, traced=False)
        rollers = machine.state.rollers
        x, y, moment = rollers.push[0] if rollers is not None else (math.nan,) * 3
        force = np.array([x, y])
        levers.append((moment - cross(arm, force)) / (geometry.rolling[0] @ force))
    return np.array(levers, np.float64)


def _stops(vehicle: VehicleConfiguration) -> dict[str, Metric]:
    """Return rotation and distance of unassisted stops with the rollers of Figure 2."""
    found: dict[str, Metric] = {}
    for case, changes in {
        "one_row": {},
        "two_rows": {"rows_apart": _APART},
        "two_sizes": {"small_radius": _SMALL},
    }.items():
        path = stopped(_with_rollers(vehicle, **changes)).path
        moved = path[-1] - path[0]
        found[f"rows_rotation.{case}"] = Metric(abs(math.degrees(moved[2])), "deg")
        found[f"rows_distance.{case}"] = Metric(float(np.hypot(*moved[:2])), "m")
    return found


def _motor(vehicle: VehicleConfiguration) -> dict[str, Metric]:
    """Return how an empty vehicle accelerates with a motor, next to the closed form.

    With ``J = m r^2 / N + I`` per wheel, the speed follows ``J w' = T``, ``T_0 (1 - w / w_0)``.
    """
    wheels = len(vehicle.wheels)
    cases: Mapping[str, DriveConfiguration] = {
        "voltage": dataclasses.replace(vehicle.drive, stall_torque=_STALL, no_load_speed=_IDLING),
        "current": dataclasses.replace(
            vehicle.drive, max_torque=_STALL, current_time=_CURRENT_TIME
        ),
    }
    speed, torque = {}, {}
    for case, drive in cases.items():
        machine = Vehicle(dataclasses.replace(vehicle, drive=drive))
        rows = []
        for _ in range(round(_LONG / machine.physics_step) if case == "voltage" else 600):
            machine.advance(1, 0.0, np.ones(wheels), np.array([10.0, 0.0, 0.0]), traced=False)
            rows.append((machine.wheels["speed"][0], machine.wheels["motor"][0]))
        speed[case], torque[case] = np.array(rows).T
    time = machine.physics_step * np.arange(1, len(torque["current"]) + 1)
    lag = np.max(np.abs(torque["current"] / _STALL + np.expm1(-time / _CURRENT_TIME)))
    line = _STALL * (1.0 - speed["voltage"] / _IDLING)
    return {
        "motor_stall_torque.all": Metric(float(torque["voltage"][0]), "N m"),
        "motor_idling_speed.all": Metric(float(speed["voltage"][-1]), "rad/s"),
        "motor_torque_error.back_emf": Metric(
            float(np.max(np.abs(torque["voltage"] - line))) / _STALL, "1"
        ),
        "motor_torque_error.current_loop": Metric(float(lag), "1"),
    }
