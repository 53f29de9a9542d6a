"""Numbers next to closed forms: rows of rollers (Figure 2), rolling resistance, motor (App. A)."""

import math

import numpy as np

from omni_core.geometry import PlatformGeometry, cross
from omni_core.quantities import GRAVITY, FloatArray
from omni_runs.experiment import changed
from omni_runs.metrics import Metric
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.placing import rolling_radius
from omni_sim.vehicle.vehicle import Vehicle
from omni_studies.wheels.kinds import stop_metrics, stopped, with_load_in_the_middle
from omni_studies.wheels.trials import ROLLERS, WheelTrial, advance, pulled, start, with_wheels

_APART = 0.04  # distance between the rows [m]
_SMALL = 0.04  # radius of the small rollers [m]; that of the others is 0.045 m
_ROLLERS = 12  # number of rollers per wheel
# A motor that accelerates the vehicle at 1 m/s^2 from rest, and idles at 3 m/s.
_STALL, _IDLING = 65.0, 15.0  # [N m], [rad/s]
_LONG = 20.0  # six time constants of the acceleration to the idling speed [s]
_CURRENT_TIME = 0.05  # time constant of the current loop [s]
# Rollers that slow a vehicle which moves sideways at 3 m/s by a fifth within half a second.
_GROWTH, _SIDEWAYS, _COASTING = 0.01, 3.0, 0.5  # [s^2/m^2], [m/s], [s]


def metrics(mecanum: VehicleConfiguration, omni: VehicleConfiguration) -> dict[str, Metric]:
    """Return the numbers of two rows on two vehicles, and the others on the first of them.

    Args:
        mecanum: vehicle on Mecanum wheels.
        omni: vehicle on omni-wheels.
    """
    lever = row_levers(_with_rollers(omni, rows_apart=_APART))
    return {
        **_stops(mecanum) | _motor(mecanum) | _coasting(mecanum),
        "row_lever.largest": Metric(1e3 * float(np.max(np.abs(lever))), "mm"),
        "row_lever.mean": Metric(1e3 * abs(float(np.mean(lever))), "mm"),
    }


def _with_rollers(
    vehicle: VehicleConfiguration, rows_apart: float = 0.0, small_radius: float = 0.0
) -> VehicleConfiguration:
    rows = {"rows_apart": rows_apart, "small_radius": small_radius}
    return changed(with_wheels(vehicle, ROLLERS, _ROLLERS), rollers=rows)


def row_levers(vehicle: VehicleConfiguration) -> FloatArray:
    """Return the lever of a rolling wheel's force about its center in each step of a turn [m]."""
    geometry, levers = PlatformGeometry.from_wheels(vehicle.wheels), []
    for machine in pulled(vehicle, 0, math.tau):
        rollers, arm = machine.state.rollers, geometry.position[0] - machine.masses.center
        x, y, moment = rollers.push[0, :3] if rollers is not None else (math.nan,) * 3
        force = np.array([x, y])
        levers.append((moment - cross(arm, force)) / (geometry.rolling[0] @ force))
    return np.array(levers, np.float64)


def _stops(vehicle: VehicleConfiguration) -> dict[str, Metric]:
    """Return rotation and distance of unassisted stops with the rollers of Figure 2."""
    found: dict[str, Metric] = {}
    for case, apart, small in (
        ("one_row", 0.0, 0.0),
        ("two_rows", _APART, 0.0),
        ("two_sizes", 0.0, _SMALL),
    ):
        # The wheels begin on their odd rollers, and lock after a fraction of a turn.
        trial = stopped(_with_rollers(vehicle, apart, small), math.tau / _ROLLERS)
        found |= stop_metrics("rows_", case, trial)
    return found


def _coasting(vehicle: VehicleConfiguration) -> dict[str, Metric]:
    """Return the final speed of a vehicle that rollers slow sideways, and that in closed form.

    Each roller of a Mecanum wheel rolls at ``sqrt(2) v`` and resists with ``f_2 (sqrt(2) v)^2 F_z``
    along it, so ``dv/dt = -k v^2`` with ``k = 2 sqrt(2) f_2 m g / (m + N I / r^2)``.
    """
    trial = WheelTrial("coast", twist=(0.0, _SIDEWAYS, 0.0), pedal=1.0, released=True)
    middle = with_load_in_the_middle(vehicle)
    machine = start(changed(middle, passive_losses={"speed_growth": _GROWTH}), trial)
    mass, radius = machine.masses.mass, float(np.mean(rolling_radius(machine.state)))
    inertia = mass + len(vehicle.wheels) * vehicle.wheel_inertia / radius**2
    rate = math.sqrt(8.0) * _GROWTH * mass * GRAVITY / inertia
    expected = _SIDEWAYS / (1.0 + rate * _SIDEWAYS * _COASTING)
    advance(machine, trial, _COASTING)
    return {
        "coasting_speed.simulated": Metric(float(machine.twist[1]), "m/s"),
        "coasting_speed.closed_form": Metric(expected, "m/s"),
    }


def _motor(vehicle: VehicleConfiguration) -> dict[str, Metric]:
    """Return how the speed at the largest voltage and the torque of a current loop follow theory.

    Each wheel of the empty vehicle accelerates its share of the mass, ``J = m r^2 / N + I``. The
    back EMF gives ``J w' = T_0 (1 - w / w_0)``, and the current loop ``lag T' = T_0 - T``.
    """
    empty = changed(vehicle, load={"mass": 0.0})
    voltage = {"stall_torque": _STALL, "no_load_speed": _IDLING}
    current = {"max_torque": _STALL, "current_time": _CURRENT_TIME}
    speed, _ = _driven(changed(empty, drive=voltage), _LONG)
    _, torque = _driven(changed(empty, drive=current), 5.0 * _CURRENT_TIME)
    machine = Vehicle(empty)
    radius = float(np.mean(rolling_radius(machine.state)))
    inertia = empty.masses.mass * radius**2 / len(empty.wheels) + empty.wheel_inertia
    time = machine.physics_step * np.arange(1, len(speed) + 1)
    expected = -_IDLING * np.expm1(-time * _STALL / (inertia * _IDLING))
    followed = -_STALL * np.expm1(-time[: len(torque)] / _CURRENT_TIME)
    return {
        f"motor_error.{case}": Metric(float(np.max(np.abs(error))), "1")
        for case, error in {
            "back_emf": (speed - expected) / _IDLING,
            "current_loop": (torque - followed) / _STALL,
        }.items()
    }


def _driven(vehicle: VehicleConfiguration, duration: float) -> tuple[FloatArray, FloatArray]:
    """Return the mean speed [rad/s] and torque [N m] of the wheels when driven ahead from rest."""
    trial = WheelTrial("drive", command=(10.0, 0.0, 0.0))
    machine, rows = start(vehicle, trial), []
    for _ in range(round(duration / machine.physics_step)):
        advance(machine, trial, machine.physics_step)
        rows.append((np.mean(machine.wheels["speed"]), np.mean(machine.wheels["motor"])))
    speed, torque = np.array(rows).T
    return speed, torque
