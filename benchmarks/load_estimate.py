"""Errors of the load that ``./omni estimate-load`` finds, and what increases them.

The forklift carries random loads and rolls freely for 20 s, or brakes gently in two directions. The
twist has a noise of 0.1 % of the speed. Errors of the radii are wear since the calibration (0.1 mm)
or unknown radii (1 mm); a drive of the empty vehicle calibrates the latter. Lenses at 0.1 m that
are not telecentric sink with the chassis.
"""

import dataclasses
from typing import Any

import numpy as np
import output

from omni_core.quantities import FloatArray
from omni_core.sensors import sensor_matrix
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.load_estimate import braking
from omni_tools.load_estimate.data import DriveData, joined
from omni_tools.load_estimate.estimate import Cameras, Uncertainty, estimate_load
from omni_tools.load_estimate.swerve import with_load

SPEED, NOISE, ROLLING = 2.0, 1e-3, 20.0  # [m/s], [1], [s]
WEAR, UNKNOWN = 1e-4, 1e-3  # standard deviation of the radii [m]
RADIUS = 0.2  # of a wheel of the forklift [m]
LENS = 0.1  # height of the lenses above the ground [m]
SMALLEST, LARGEST = (100.0, -0.6, -0.4), (400.0, 0.6, 0.4)  # mass [kg], forward, left [m]
DIRECTIONS = (0.0, 40.0)  # of the stops [deg]
KNOWN = Uncertainty(1e-6, 1e-3, 1e-3)


class Drives:
    """Drives of the forklift with a load [kg, m, m], as they are measured without errors."""

    def __init__(self, load: FloatArray) -> None:
        base = output.load("straight_line", "unassisted", *output.BLIND)
        self.vehicle = with_load(base.vehicle, load)
        self.rolling, self.stops = (
            [_drive(base, self.vehicle, direction, start) for direction in DIRECTIONS]
            for start in (ROLLING, 0.5)
        )


def _drive(
    base: ExperimentConfiguration, vehicle: VehicleConfiguration, direction: float, start: float
) -> DriveData:
    changes: dict[str, Any] = {
        "speed": SPEED,
        "direction_deg": direction,
        "brake_time": start,
        "pedal": 0.06,
    }
    maneuver = dataclasses.replace(base.maneuver, **changes)
    limit = dataclasses.replace(base.simulation, duration_limit=ROLLING + 20.0)
    history = run_fast_loop(
        dataclasses.replace(base, vehicle=vehicle, maneuver=maneuver, simulation=limit)
    )
    rows = (history.pedal > 0.0) == (start < ROLLING)
    columns = 1e-9 * history.stamp_ns, history.twist, history.wheel_speed
    more = np.abs(history.brake_torque), history.pedal
    return DriveData(*(np.asarray(column, np.float64)[rows] for column in (*columns, *more)))


def measured(
    drive: DriveData, radius_error: FloatArray, generator: np.random.Generator
) -> DriveData:
    """Return a drive on wheels whose radii differ [m], shape (N,), with noise of the twist."""
    noise = generator.normal(0.0, NOISE * SPEED, drive.twist.shape) * [1.0, 1.0, 2.0]
    speed = drive.wheel_speed * (1.0 - radius_error / RADIUS)
    return drive._replace(twist=drive.twist + noise, wheel_speed=speed)


def seen_by(cameras: Cameras, drive: DriveData, vehicle: VehicleConfiguration) -> DriveData:
    """Return a drive whose twist is measured by lenses that sink with the compressed tires."""
    matrix = sensor_matrix(cameras.sensors)
    position = np.array([(one.x, one.y) for one in vehicle.wheels.values()])
    loads = braking.loads_per_moment(vehicle) @ _moments(vehicle)
    plane = np.linalg.lstsq(braking.plane_columns(position), loads, rcond=None)[0]
    points = np.array([(one.x, one.y) for one in cameras.sensors.values()])
    sunk = braking.plane_columns(points) @ plane / vehicle.tire.vertical_stiffness
    read = drive.twist @ matrix.T / (1.0 - sunk / cameras.height)
    return drive._replace(twist=read @ np.linalg.pinv(matrix).T)


def _moments(vehicle: VehicleConfiguration) -> FloatArray:
    return vehicle.masses.mass * np.array([1.0, *vehicle.masses.center])


def errors(loaded: Drives, empty: Drives, generator: np.random.Generator) -> dict[str, FloatArray]:
    """Return mass and center of gravity minus their true values in each case [kg, m, m]."""
    wear, unknown = (generator.normal(0.0, size, 4) for size in (WEAR, UNKNOWN))
    cameras = Cameras(output.load("straight_line", "unassisted").sensors, LENS)
    nothing = np.zeros(4)

    def read(drive: DriveData, radius_error: FloatArray = nothing) -> DriveData:
        return measured(drive, radius_error, generator)

    drive, first = loaded.rolling[0], empty.rolling[0]
    through = [seen_by(cameras, one.rolling[0], one.vehicle) for one in (loaded, empty)]
    radius = Uncertainty(WEAR, 1e-3, 1e-3)
    cases: dict[str, tuple[Any, ...]] = {
        "noise": (read(drive), KNOWN),
        "wear": (read(drive, wear), radius),
        "unknown_radii": (read(drive, unknown), radius),
        "calibrated": (read(drive, unknown), KNOWN, read(first, unknown)),
        "lens": (read(through[0]), KNOWN, read(through[1])),
        "known_lens": (read(through[0]), KNOWN, read(through[1]), cameras),
        "stops": (joined([read(one) for one in loaded.stops]), KNOWN),
    }
    body, truth = empty.vehicle, _moments(loaded.vehicle)
    found = {}
    for case, given in cases.items():
        estimate = estimate_load(given[0], body, *given[1:])
        mass, *first_moments = estimate.moments
        center = np.array(first_moments) / mass - truth[1:] / truth[0]
        found[case] = np.array([mass - truth[0], *center])
    return found


def main() -> None:
    options = output.options(__doc__, loads=40, seed=0)
    generator = np.random.default_rng(options.seed)
    empty = Drives(np.zeros(3))
    rows = [
        errors(Drives(generator.uniform(SMALLEST, LARGEST)), empty, generator)
        for _ in range(options.loads)
    ]
    metrics: output.Metrics = {"loads.all": (options.loads, "1")}
    for case in rows[0]:
        rms = np.sqrt(np.mean([row[case] ** 2 for row in rows], axis=0))
        metrics |= {
            f"mass_error.{case}": (float(rms[0]), "kg"),
            f"forward_error.{case}": (1e3 * float(rms[1]), "mm"),
            f"left_error.{case}": (1e3 * float(rms[2]), "mm"),
        }
    output.publish("load_estimate", metrics, as_json=options.json)


if __name__ == "__main__":
    main()
