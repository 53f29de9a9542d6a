"""The load of simulated vehicles, which only the test knows, is found within its standard error."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from omni_core.configuration import WorkError
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import GRAVITY, FloatArray
from omni_core.sensors import sensor_matrix
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary
from omni_sim.masses import MassProperties
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.load_estimate.data import DriveData, LoadDataError, joined
from omni_tools.load_estimate.estimate import (
    Cameras,
    LoadEstimate,
    Uncertainty,
    center_of,
    estimate_load,
    load_of,
)
from omni_tools.load_estimate.swerve import highest_speed, largest_rotation, with_load

CONFIG = Path(__file__).parents[4] / "config"
LIBRARY = ExperimentLibrary(CONFIG)
FORKLIFT = LIBRARY.vehicle("mecanum_forklift")
EXACT = Uncertainty(1e-6, 1e-6, 1e-6)
NOISE = 0.001  # of the measured twist [m/s, m/s], and 0.002 rad/s


def loaded(vehicle: VehicleConfiguration, mass: float, x: float, y: float) -> VehicleConfiguration:
    return with_load(vehicle, np.array([mass, x, y]))


def true_moments(vehicle: VehicleConfiguration) -> FloatArray:
    masses = MassProperties.of(vehicle.body, vehicle.load)
    return masses.mass * np.array([1.0, *masses.center])


def rolling(
    vehicle: VehicleConfiguration,
    *,
    radius_error: FloatArray | float = 0.0,
    noise: float = 0.0,
    seed: int = 0,
    direction: float = 0.0,
    seconds: float = 20.0,
) -> DriveData:
    """Return free rolling in closed form, Eqs. (1), (28): no code of the estimate or simulator."""
    generator = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 0.01)
    mass, center = vehicle.masses.mass, vehicle.masses.center
    position = np.array([(one.x, one.y) for one in vehicle.wheels.values()])
    x, y = position.T
    # A rectangle of four wheels: each axle carries its share by the lever rule.
    front, left = 0.5 + center[0] / np.ptp(x), 0.5 + center[1] / np.ptp(y)
    load = mass * GRAVITY * np.where(x > 0, front, 1 - front) * np.where(y > 0, left, 1 - left)
    # The plane that a rigid chassis on equal springs has instead of the product of both shares.
    plane = np.column_stack((np.ones(4), position))
    load = plane @ np.linalg.lstsq(plane, load, rcond=None)[0]
    radius = 0.2 + radius_error - load / vehicle.tire.vertical_stiffness
    twist = np.array([math.cos(direction), math.sin(direction), 0.0]) * 1.5
    speed = PlatformKinematics.of(vehicle.wheels).wheel_speeds(twist, radius)
    measured = twist + generator.normal(0.0, 1.0, (len(time), 3)) * [noise, noise, 2.0 * noise]
    nothing = np.zeros((len(time), 4))
    return DriveData(time, measured, nothing + speed, nothing, np.zeros(len(time)))


def simulated(
    vehicle: str, load: tuple[float, float, float], direction: float = 0.0, *more: str
) -> tuple[DriveData, VehicleConfiguration]:
    """Return a simulated drive with a gentle stop, and the vehicle."""
    mass, x, y = load
    overrides = [
        f"vehicle={vehicle}",
        *(f"vehicle.load.{key}={value}" for key, value in zip("xy", (x, y), strict=True)),
        *(f"vehicle.load.mass={mass}", "vehicle.load.height=0.4", "feedback=velocity_sensor"),
        *("maneuver.speed=2", "maneuver.brake_time=5", "maneuver.pedal=0.06"),
        f"maneuver.direction_deg={direction}",
        *more,
    ]
    configuration = LIBRARY.load("straight_line", "unassisted", overrides)
    history = run_fast_loop(configuration)
    time = np.asarray(1e-9 * history.stamp_ns, dtype=np.float64)
    torque = np.abs(history.brake_torque)
    drive = DriveData(time, history.twist.copy(), history.wheel_speed.copy(), torque, history.pedal)
    return drive, configuration.vehicle


def noisy(drive: DriveData, seed: int, noise: float = NOISE) -> DriveData:
    error = np.random.default_rng(seed).normal(0.0, noise, drive.twist.shape) * [1.0, 1.0, 2.0]
    return drive._replace(twist=drive.twist + error)


def only(drive: DriveData, *, braking: bool) -> DriveData:
    rows = (drive.pedal > 0.0) == braking
    return DriveData(*(column[rows] for column in drive))


def deviation(found: LoadEstimate, vehicle: VehicleConfiguration) -> FloatArray:
    """Return mass and center of gravity minus their true values [kg, m, m]."""
    truth, _ = center_of(true_moments(vehicle), np.eye(3))
    return center_of(found.moments, found.covariance)[0] - truth


@pytest.mark.parametrize("load", [(250.0, 0.65, 0.5), (400.0, -0.3, 0.1), (0.0, 0.0, 0.0)])
def test_rolling_gives_the_load_in_closed_form(load: tuple[float, float, float]) -> None:
    vehicle = loaded(FORKLIFT, *load)
    found = estimate_load(rolling(vehicle), FORKLIFT, EXACT)
    np.testing.assert_allclose(found.moments, true_moments(vehicle), rtol=1e-6, atol=1e-3)


def test_a_drive_of_the_empty_vehicle_cancels_unknown_radii_and_scale() -> None:
    vehicle, radii = loaded(FORKLIFT, 300.0, 0.4, -0.3), np.array([4e-3, -2e-3, 0.0, 1e-3])
    drive, empty = (
        rolling(one, radius_error=radii) for one in (vehicle, loaded(FORKLIFT, 0.0, 0.0, 0.0))
    )
    scaled = [one._replace(twist=1.003 * one.twist) for one in (drive, empty)]
    found = estimate_load(scaled[0], FORKLIFT, EXACT, scaled[1])
    np.testing.assert_allclose(load_of(found, FORKLIFT)[0], (300.0, 0.4, -0.3), rtol=5e-3)
    wrong = estimate_load(scaled[0], FORKLIFT, EXACT)
    assert abs(load_of(wrong, FORKLIFT)[0][0] - 300.0) > 100.0


@pytest.mark.parametrize("vehicle", ["mecanum_forklift", "six_wheel_mecanum"])
@pytest.mark.parametrize("braking", [False, True])
def test_either_motion_gives_the_simulated_load(vehicle: str, braking: bool) -> None:
    """Two directions of braking are needed, because one shows only the distance from its line."""
    load = (200.0, 0.3, -0.25)
    drives = [simulated(vehicle, load, direction) for direction in (0.0, 40.0)]
    truth = drives[0][1]
    data = joined([only(drive, braking=braking) for drive, _ in drives])
    found = estimate_load(data, LIBRARY.vehicle(vehicle), EXACT)
    assert (found.braking > 0.3) == braking
    assert (found.rolling > 3.0) == (not braking)
    error = deviation(found, truth)
    assert abs(error[0]) < (0.02 if braking else 0.002) * truth.masses.mass
    assert np.max(np.abs(error[1:])) < (0.02 if braking else 0.002)


@pytest.mark.parametrize("vehicle", ["steered_forklift", "swerve_robot"])
def test_vehicles_on_conventional_wheels_show_their_load(vehicle: str) -> None:
    """Unknown side forces leave only the mass to braking; a curve of steered wheels is not used."""
    off = ("brake_assist.enabled=false", "brake_assist.fault_detection=false")
    drive, truth = simulated(vehicle, (150.0, 0.2, -0.1), 0.0, *off)
    found = estimate_load(drive, LIBRARY.vehicle(vehicle), Uncertainty(5e-5, 0.01, 0.01))
    assert found.rolling > 3.0
    assert found.braking > 0.3
    error = deviation(found, truth)
    assert abs(error[0]) < 0.002 * truth.masses.mass
    assert np.max(np.abs(error[1:])) < 0.002
    with pytest.raises(WorkError, match="center of gravity"):
        estimate_load(only(drive, braking=True), LIBRARY.vehicle(vehicle), EXACT)
    curve = drive._replace(twist=drive.twist + np.array([0.0, 0.0, 0.2]))
    with pytest.raises(LoadDataError, match="3 s of free rolling"):
        estimate_load(only(curve, braking=False), LIBRARY.vehicle(vehicle), EXACT)


def test_only_stops_in_a_direction_of_rolling_are_forecast() -> None:
    """A load on the right turns a car to the right whether it moves ahead or back, by symmetry."""
    car = loaded(LIBRARY.vehicle("steered_forklift"), 250.0, 0.0, -0.4)
    rotation, direction = largest_rotation(car, 5.0)
    assert direction in (0.0, 180.0)
    assert abs(rotation) > 0.1


def test_one_direction_of_braking_shows_only_the_distance_from_its_line() -> None:
    drive, truth = simulated("mecanum_forklift", (250.0, 0.65, 0.5))
    rolled = only(drive, braking=False)
    loose = Uncertainty(3e-3, 0.1, 0.01)  # the radii are hardly known
    without = estimate_load(rolled, FORKLIFT, loose)
    found = estimate_load(drive, FORKLIFT, loose)
    before, after = (center_of(one.moments, one.covariance)[1] for one in (without, found))
    assert after[0] < 0.1 * before[0]
    assert after[2] < 0.3 * before[2]
    assert np.all(np.abs(deviation(found, truth)) < 3.0 * after)


def test_standard_errors_cover_held_out_loads() -> None:
    """68 % of errors are within one standard error, 95 % within two, for other loads and seeds."""
    assumed, generator = Uncertainty(5e-5, 0.05, 0.05), np.random.default_rng(59)
    empty = loaded(FORKLIFT, 0.0, 0.0, 0.0)
    ratios = []
    for seed in range(200):
        load = generator.uniform((50.0, -0.6, -0.4), (400.0, 0.6, 0.4))
        wear = generator.normal(0.0, assumed.radius, 4)
        radii = generator.normal(0.0, 1e-3, 4)
        softer = 1.0 + generator.normal(0.0, assumed.stiffness)
        real = dataclasses.replace(
            FORKLIFT.tire, vertical_stiffness=softer * FORKLIFT.tire.vertical_stiffness
        )
        vehicle = dataclasses.replace(loaded(FORKLIFT, *load), tire=real)
        calibration = rolling(
            dataclasses.replace(empty, tire=real), radius_error=radii, noise=NOISE, seed=2 * seed
        )
        drive = rolling(vehicle, radius_error=radii + wear, noise=NOISE, seed=2 * seed + 1)
        found = estimate_load(drive, FORKLIFT, assumed, calibration)
        errors = center_of(found.moments, found.covariance)[1]
        ratios.append(deviation(found, vehicle) / errors)
    within = np.abs(np.array(ratios))
    assert np.all(np.abs(np.mean(within < 1.0, axis=0) - 0.683) < 0.12)
    assert np.all(np.mean(within < 2.0, axis=0) > 0.9)


def test_ordinary_lenses_reverse_the_effect_unless_the_cameras_are_known() -> None:
    """At 0.1 m, a camera that sinks measures a speed that grows twice as fast as the radius falls.

    The radius is 0.2 m, so a compression d changes the radius by -d and the measured one by +d.
    """
    vehicle, sensors = loaded(FORKLIFT, 250.0, 0.3, 0.2), LIBRARY.sensors("three_generic")
    drive, empty = rolling(vehicle), rolling(loaded(FORKLIFT, 0.0, 0.0, 0.0))

    def seen(one: DriveData, carrier: VehicleConfiguration) -> DriveData:
        masses, measured = carrier.masses, sensor_matrix(sensors)
        stiffness = 4.0 * carrier.tire.vertical_stiffness
        heave = masses.mass * GRAVITY / stiffness
        pitch = masses.mass * GRAVITY * masses.center / stiffness / np.array([0.65, 0.5]) ** 2
        sunk = np.array([heave + pitch @ (each.x, each.y) for each in sensors.values()])
        read = one.twist @ measured.T / (1.0 - sunk / 0.1)
        return one._replace(twist=read @ np.linalg.pinv(measured).T)

    read = seen(drive, vehicle), seen(empty, loaded(FORKLIFT, 0.0, 0.0, 0.0))
    unaware = load_of(estimate_load(read[0], FORKLIFT, EXACT, read[1]), FORKLIFT)[0]
    assert unaware[0] == pytest.approx(-250.0, rel=0.1)
    aware = estimate_load(read[0], FORKLIFT, EXACT, read[1], Cameras(sensors, 0.1))
    np.testing.assert_allclose(load_of(aware, FORKLIFT)[0], (250.0, 0.3, 0.2), rtol=0.02)


def test_a_worn_wheel_shows() -> None:
    vehicle, worn = loaded(FORKLIFT, 100.0, 0.0, 0.0), np.array([0.0, -2e-3, 0.0, 0.0])
    assumed, empty = Uncertainty(5e-5, 0.05, 0.05), rolling(loaded(FORKLIFT, 0.0, 0.0, 0.0), seed=1)
    whole, flat = (
        estimate_load(rolling(vehicle, radius_error=wear, noise=NOISE), FORKLIFT, assumed, empty)
        for wear in (0.0 * worn, worn)
    )
    assert whole.unevenness < 3.0 < flat.unevenness


def test_too_little_motion_is_refused() -> None:
    with pytest.raises(LoadDataError, match="3 s of free rolling"):
        estimate_load(rolling(FORKLIFT, seconds=2.0), FORKLIFT, EXACT)


def test_the_forecast_is_the_swerve_of_an_unassisted_stop() -> None:
    """A centered load does not turn the vehicle; the other one does, less at lower speed."""
    centered = loaded(FORKLIFT, 250.0, 0.0, 0.0)
    assert abs(largest_rotation(centered, 2.0)[0]) < 0.5
    rotation, _ = largest_rotation(FORKLIFT, 2.0)
    assert abs(rotation) > 1.0
    slower = highest_speed(FORKLIFT, 0.5 * abs(rotation), 2.0)
    assert 0.5 < slower < 2.0
    assert abs(largest_rotation(FORKLIFT, slower)[0]) <= 0.5 * abs(rotation)
