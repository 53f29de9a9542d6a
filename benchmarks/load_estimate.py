"""Errors of the load that ``./omni estimate-load`` finds, and what increases them.

The forklift carries random loads and rolls freely for 20 s, or brakes gently in two directions. The
twist has a noise of 0.1 % of the speed. Errors of the radii are wear since the calibration (0.1 mm)
or unknown radii (1 mm); a drive of the empty vehicle calibrates the latter. Lenses at 0.1 m that
are not telecentric sink with the chassis.
"""

from typing import Any

import numpy as np
import output

from omni_core.quantities import FloatArray
from omni_core.sensors import sensor_matrix
from omni_runs.compiled import run_fast_loop
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.load_estimate.braking import first_moments, load_matrix
from omni_tools.load_estimate.data import DriveData, joined
from omni_tools.load_estimate.estimate import Cameras, Uncertainty, center_of, estimate_load

SPEED, NOISE, ROLLING = 2.0, 1e-3, 20.0  # [m/s], [1], [s]
WEAR, UNKNOWN = 1e-4, 1e-3  # standard deviation of the radii [m]
RADIUS = 0.2  # of a wheel of the forklift [m]
LENS = 0.1  # height of the lenses above the ground [m]
SMALLEST, LARGEST = (100.0, -0.6, -0.4), (400.0, 0.6, 0.4)  # mass [kg], forward, left [m]
DIRECTIONS = (0.0, 40.0)  # of the stops [deg]
KNOWN = Uncertainty(1e-6, 1e-3, 1e-3)


def driven(
    load: FloatArray, direction: float, start: float
) -> tuple[VehicleConfiguration, DriveData]:
    """Return the forklift with a load [kg, m, m], and a drive as it is measured without errors.

    The drive is the free rolling of `ROLLING` if the brakes are put on after it (`start` [s]);
    otherwise, it is the stop. Its direction is given in degrees.
    """
    configuration = output.load(
        *("straight_line", "unassisted", *output.BLIND, "maneuver.pedal=0.06"),
        *(f"maneuver.speed={SPEED}", f"maneuver.direction_deg={direction}"),
        *(f"maneuver.brake_time={start}", f"simulation.duration_limit={ROLLING + 20.0}"),
        *map("vehicle.load.{}={}".format, ("mass", "x", "y"), load),
    )
    history = run_fast_loop(configuration)
    rows = (history.pedal > 0.0) == (start < ROLLING)
    columns = 1e-9 * history.stamp_ns, history.twist, history.wheel_speed
    more = np.abs(history.brake_torque), history.pedal
    drive = DriveData(*(np.asarray(column, np.float64)[rows] for column in (*columns, *more)))
    return configuration.vehicle, drive


def measured(
    drive: DriveData, radius_error: FloatArray, generator: np.random.Generator
) -> DriveData:
    """Return a drive on wheels whose radii differ [m], shape (N,), with noise of the twist."""
    noise = generator.normal(0.0, NOISE * SPEED, drive.twist.shape) * [1.0, 1.0, 2.0]
    speed = drive.wheel_speed * (1.0 - radius_error / RADIUS)
    return drive._replace(twist=drive.twist + noise, wheel_speed=speed)


def seen_by(cameras: Cameras, vehicle: VehicleConfiguration, drive: DriveData) -> DriveData:
    """Return a drive whose twist is measured by lenses that sink with the compressed tires."""
    matrix = sensor_matrix(cameras.sensors)
    points = np.array([(one.x, one.y) for one in cameras.sensors.values()])
    loads = load_matrix(vehicle, points) @ true_moments(vehicle)
    sunk = loads / vehicle.tire.vertical_stiffness
    read = drive.twist @ matrix.T / (1.0 - sunk / cameras.height)
    return drive._replace(twist=read @ np.linalg.pinv(matrix).T)


def true_moments(vehicle: VehicleConfiguration) -> FloatArray:
    """Return mass and first moments of a vehicle with its load [kg, kg m, kg m]."""
    return first_moments(vehicle.body) + first_moments(vehicle.load)


def errors(load: FloatArray, generator: np.random.Generator) -> dict[str, FloatArray]:
    """Return mass and center of gravity minus their true values in each case [kg, m, m]."""
    wear, unknown = (generator.normal(0.0, size, 4) for size in (WEAR, UNKNOWN))
    cameras = Cameras(output.load("straight_line", "unassisted").sensors, LENS)
    nothing = np.zeros(4)

    def read(drive: DriveData, radius_error: FloatArray = nothing) -> DriveData:
        return measured(drive, radius_error, generator)

    (vehicle, drive), (body, first) = (driven(one, 0.0, ROLLING) for one in (load, np.zeros(3)))
    through, before = seen_by(cameras, vehicle, drive), seen_by(cameras, body, first)
    radius = Uncertainty(WEAR, 1e-3, 1e-3)
    cases: dict[str, tuple[Any, ...]] = {
        "noise": (read(drive), KNOWN),
        "wear": (read(drive, wear), radius),
        "unknown_radii": (read(drive, unknown), radius),
        "calibrated": (read(drive, unknown), KNOWN, read(first, unknown)),
        "lens": (read(through), KNOWN, read(before)),
        "known_lens": (read(through), KNOWN, read(before), cameras),
        "stops": (joined([read(driven(load, one, 0.5)[1]) for one in DIRECTIONS]), KNOWN),
    }
    truth, _ = center_of(true_moments(vehicle), np.eye(3))
    found = {}
    for case, (given, *assumed) in cases.items():
        estimate = estimate_load(given, body, *assumed)
        found[case] = center_of(estimate.moments, estimate.covariance)[0] - truth
    return found


def main() -> None:
    options = output.options(__doc__, loads=40, seed=0)
    generator = np.random.default_rng(options.seed)
    rows = [errors(generator.uniform(SMALLEST, LARGEST), generator) for _ in range(options.loads)]
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
