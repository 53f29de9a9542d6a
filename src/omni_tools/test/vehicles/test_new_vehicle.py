"""A new vehicle stands and locks its wheels; inconsistent values are reported."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import yaml

from omni_core.brakes import ON_OFF, TYPICAL
from omni_core.configuration import ConfigurationError
from omni_core.sensors import LineSensor
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import WITHOUT_CAMERAS, ExperimentConfiguration, ExperimentLibrary
from omni_runs.plausibility import RemarkingLibrary, camera_speed, remarks
from omni_sim.vehicle.plausibility import wheel_facts
from omni_tools.vehicles.estimates import Measured, write_vehicle

CONFIG = Path(__file__).parents[4] / "config"
LIBRARY = ExperimentLibrary(CONFIG)

SMALL = Measured(length=0.58, width=0.38, mass=30.0, wheel_radius=0.05)
VEHICLES = {
    "small": SMALL,
    "forklift": Measured(length=1.6, width=1.2, mass=1000.0, wheel_radius=0.2, load=250.0),
    "cart": Measured(length=0.7, width=0.5, mass=60.0, wheel_radius=0.0762, load=20.0),
    "heavy": Measured(length=4.0, width=2.0, mass=6000.0, wheel_radius=0.25, wheels=8),
    "round": Measured(length=0.5, width=0.5, mass=25.0, wheel_radius=0.06, kind="omni", wheels=3),
    "square": Measured(
        length=0.6, width=0.5, mass=40.0, wheel_radius=0.06, kind="omni", drive_torque=4.0
    ),
}


def load(folder: Path, *overrides: str) -> ExperimentConfiguration:
    return LIBRARY.load(str(folder / "experiment.yaml"), "assisted", overrides)


@pytest.mark.parametrize("name", VEHICLES)
def test_estimates_fit_together(name: str, tmp_path: Path) -> None:
    measured = VEHICLES[name]
    write_vehicle(name, measured, tmp_path)
    experiment = load(tmp_path)
    assert remarks(experiment) == ()
    facts = wheel_facts(experiment.vehicle)
    weight = (measured.mass + measured.load) * 9.81
    assert sum(fact.load for fact in facts.values()) == pytest.approx(weight, rel=1e-3)
    assert 9.81 * experiment.brake_assist.nominal_mass == pytest.approx(weight)
    for fact in facts.values():
        assert fact.brake_force > fact.grip > 0.5 * fact.load
    # The rollers are a part of the wheel.
    rollers, vehicle = experiment.vehicle.rollers, experiment.vehicle
    rim = rollers.count * 2.0 * rollers.inertia / rollers.radius**2 * measured.wheel_radius**2
    assert rim < 0.5 * vehicle.wheel_inertia
    assert rollers.radius < 0.3 * measured.wheel_radius
    # Every wheel is under the chassis.
    for mount in experiment.vehicle.wheels.values():
        assert np.hypot(mount.x, mount.y) < 0.5 * np.hypot(measured.length, measured.width)


@pytest.mark.parametrize("brakes", [kind for kind in TYPICAL if kind != ON_OFF])
@pytest.mark.parametrize("name", ["forklift", "cart"])
def test_the_written_law_stops_such_brakes_sooner_than_the_law_for_fast_valves(
    name: str, brakes: str, tmp_path: Path
) -> None:
    write_vehicle(name, dataclasses.replace(VEHICLES[name], brakes=brakes), tmp_path)
    written, other = (
        run_fast_loop(LIBRARY.load(str(tmp_path), "assisted", (*WITHOUT_CAMERAS, *changes)))
        for changes in ((), ("brake_assist.law=sliding_mode",))
    )
    assert written.stopping_distance < other.stopping_distance
    unassisted = run_fast_loop(LIBRARY.load(str(tmp_path), "unassisted", WITHOUT_CAMERAS))
    assert written.orientation_change < max(0.5 * unassisted.orientation_change, 1.0)


@pytest.mark.parametrize("wheels", [3, 5])
def test_numbers_of_wheels_that_are_no_pairs_are_refused(wheels: int) -> None:
    with pytest.raises(ConfigurationError, match="must be 4, 6"):
        Measured(length=1.0, width=1.0, mass=10.0, wheel_radius=0.1, wheels=wheels)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("vehicle.tire=rill_table_1", "too stiff for this vehicle"),
        ("vehicle.brake.max_torque=2000", "times the friction limit"),
        ("vehicle.brake.max_torque=1", "never lock"),
        ("vehicle.drive.max_torque=1500", "would also spin the wheels"),
        ("vehicle.body.yaw_inertia=330", "check mass, size and inertia"),
        ("vehicle.wheel_inertia=1.0", "solid disc"),
        ("vehicle.load={mass: 60, height: 0.1}", "use a stronger tire"),
        ("vehicle.load={mass: 60, x: 0.2, y: 0.15, height: 0.1}", "wheel rear_right lifts off"),
        ("sensors.front={x: 0.6, y: 0, heading_deg: 90}", "beyond the edge"),
        ("maneuver.speed=45", "less than 60 %"),
        ("maneuver.demands={time: [0, 1], forward: [0, 30], left: [0, 0], turn: [0, 0], "
         "pedal: [0, 0]}", "less than 60 %"),
        ("maneuver.demands={time: [0, 1], forward: [2, 2], left: [0, 0], turn: [0, 10], "
         "pedal: [0, 0]}", "check the units"),
        ("maneuver.yaw_rate_deg=300", "check the units"),
        ("flow_sensors.f={x: 0, y: 0, heading_deg: 1.571}", "looks like radians"),
    ],
)  # fmt: skip
def test_a_value_of_another_vehicle_is_seen(override: str, words: str, tmp_path: Path) -> None:
    write_vehicle("small", SMALL, tmp_path)
    assert any(words in remark for remark in remarks(load(tmp_path, override)))


def test_nothing_is_said_of_the_experiments_that_ship() -> None:
    for name in LIBRARY.names():
        for variant in LIBRARY.variants(name):
            assert remarks(LIBRARY.load(name, variant)) == (), name


def test_two_lines_at_the_camera_speed_share_60_percent() -> None:
    sensor = LineSensor(x=0.0, y=0.0, heading_deg=90.0, length=0.05, width=0.02, line_rate=2500.0)
    # Sideways the footprint moves by 40 % of its width from line to line, along it of its length.
    assert camera_speed(sensor, 0.0) == pytest.approx(0.4 * 0.02 * 2500)
    assert camera_speed(sensor, np.pi / 2) == pytest.approx(0.4 * 0.05 * 2500)


def test_the_speed_of_a_table_counts_and_not_the_default_one(tmp_path: Path) -> None:
    write_vehicle("small", SMALL, tmp_path)
    slow = "{time: [0, 1], forward: [1, 0], left: [0, 1], turn: [1, 0], pedal: [0, 1]}"
    assert not remarks(load(tmp_path, f"maneuver.demands={slow}", "maneuver.speed=45"))


@pytest.mark.parametrize(
    "key",
    [
        *("chassis_length", "tire", "wheel_inertia", "brake.max_torque", "body.yaw_inertia"),
        *("drive", "drive.max_torque", "drive.stiffness"),
    ],
)
def test_a_file_that_leaves_a_value_to_another_vehicle_is_refused(key: str, tmp_path: Path) -> None:
    write_vehicle("small", SMALL, tmp_path)
    path = tmp_path / "vehicle.yaml"
    tree = yaml.safe_load(path.read_text())
    inner, *rest = key.split(".")
    del (tree[inner] if rest else tree)[key.rsplit(".", maxsplit=1)[-1]]
    path.write_text(yaml.safe_dump(tree))
    with pytest.raises(ConfigurationError, match=rf"vehicle\.{key}: is missing in .*new-vehicle"):
        load(tmp_path)


@pytest.mark.parametrize(("name", "near"), [("mass", "mas"), ("yaw_inertia", "yaw_inertie")])
def test_a_misspelled_name_is_reported_rather_than_a_missing_value(
    name: str, near: str, tmp_path: Path
) -> None:
    write_vehicle("small", SMALL, tmp_path)
    path = tmp_path / "vehicle.yaml"
    path.write_text(path.read_text().replace(f"  {name}:", f"  {near}:"))
    with pytest.raises(ConfigurationError, match=f"{near}: is not a known key; .*'{name}'"):
        load(tmp_path)


def test_a_vehicle_within_an_experiment_must_be_complete_too(tmp_path: Path) -> None:
    write_vehicle("small", SMALL, tmp_path)
    path = tmp_path / "experiment.yaml"
    tree = yaml.safe_load(path.read_text())
    tree["vehicle"] = yaml.safe_load((tmp_path / "vehicle.yaml").read_text())
    path.write_text(yaml.safe_dump(tree))
    assert remarks(load(tmp_path)) == ()
    del tree["vehicle"]["brake"]
    path.write_text(yaml.safe_dump(tree))
    with pytest.raises(ConfigurationError, match=r"vehicle\.brake: is missing"):
        load(tmp_path)


def test_a_library_says_once_what_does_not_fit(tmp_path: Path) -> None:
    write_vehicle("small", SMALL, tmp_path)
    said: list[str] = []
    library = RemarkingLibrary(CONFIG, said.append)
    for _ in range(2):
        library.load(str(tmp_path / "experiment.yaml"), "assisted", ["vehicle.wheel_inertia=1"])
    library.vehicle("mecanum_forklift")
    assert len(said) == 1
    assert "solid disc" in said[0]
