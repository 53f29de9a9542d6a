"""Experiments are composed from named parts, variants and overrides, in that order."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from omni_core.configuration import ConfigurationError, from_mapping, to_mapping
from omni_recording.safe_yaml import LARGEST_YAML
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary, short_name
from omni_runs.yaml_files import parse_override

CONFIG = Path(__file__).resolve().parents[3] / "config"


@pytest.fixture(scope="module")
def library() -> ExperimentLibrary:
    return ExperimentLibrary(CONFIG)


def load(library: ExperimentLibrary, *overrides: str) -> ExperimentConfiguration:
    return library.load("straight_line", "assisted", overrides)


def test_every_experiment_of_the_project_loads(library: ExperimentLibrary) -> None:
    assert "straight_line" in library.names()
    for experiment in library.names():
        for variant in library.variants(experiment):
            library.load(experiment, variant)


def _keys(values: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    for name, value in values.items():
        yield f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from _keys(value, f"{prefix}{name}.")


def test_no_value_of_any_experiment_may_be_null(library: ExperimentLibrary) -> None:
    keys = {
        key: (experiment, variant)
        for experiment in library.names()
        for variant in library.variants(experiment)
        for key in _keys(to_mapping(library.load(experiment, variant)))
    }
    assert "maneuver.demands.forward" in keys
    for key, names in keys.items():
        with pytest.raises(ConfigurationError) as caught:
            library.load(*names, [f"{key}=null"])
        assert caught.value.key == key


@pytest.mark.parametrize("key", ["sensors", "vehicle.wheels"])
def test_a_vehicle_without_any_sensors_or_wheels_is_refused(
    library: ExperimentLibrary, key: str
) -> None:
    with pytest.raises(ConfigurationError, match=f"{key}: .* needed|at least one"):
        load(library, f"{key}={{}}")


def test_an_empty_mapping_removes_all_named_entries(library: ExperimentLibrary) -> None:
    assert library.load("ice_patch", "assisted").ground.patches
    assert not library.load("ice_patch", "assisted", ["ground.patches={}"]).ground.patches
    odometry = library.load("ice_patch", "assisted", ["odometry.sideslip={}"])
    assert odometry.odometry.sensors == odometry.sensors
    alone = library.load("ice_patch", "assisted", ["ground={patches: {}, texture: {kind: stone}}"])
    assert (alone.ground.patches, alone.ground.texture.kind) == ({}, "stone")


def test_a_missing_folder_of_the_configuration_is_named(tmp_path: Path) -> None:
    elsewhere = ExperimentLibrary(tmp_path / "config")
    with pytest.raises(ConfigurationError, match=r"folder .*config/experiments does not exist"):
        elsewhere.load("straight_line")


@pytest.mark.parametrize("vehicle", ["mecanum_forklift", "three_wheel_robot"])
@pytest.mark.parametrize("ground", ["cork", "asphalt", "stone"])
def test_parts_are_chosen_by_name(library: ExperimentLibrary, vehicle: str, ground: str) -> None:
    chosen = load(library, f"vehicle={vehicle}", f"ground={ground}")
    assert chosen.ground.texture.kind == ground
    wheels = yaml.safe_load((CONFIG / f"vehicles/{vehicle}.yaml").read_text())["wheels"]
    assert set(chosen.vehicle.wheels) == set(wheels)
    assert chosen.brake_assist.wheels == chosen.vehicle.wheels


def test_a_part_that_is_replaced_leaves_nothing_behind(library: ExperimentLibrary) -> None:
    chosen = library.load("ice_patch", "assisted", ["ground=cork"])
    assert not chosen.ground.patches


@pytest.mark.parametrize("tire", ["vehicle.tire=linear", "vehicle.tire.stiffness=9e4"])
def test_values_of_a_part_hold_wherever_the_part_is_named(
    library: ExperimentLibrary, tire: str
) -> None:
    overrides = ["vehicle=three_wheel_robot", "vehicle.load.mass=77.0", tire]
    first = load(library, *overrides)
    assert first.vehicle.load.mass == 77.0 != load(library, overrides[0]).vehicle.load.mass
    for order in itertools.permutations(overrides):
        assert load(library, *order) == first


def test_a_variant_keeps_its_values_of_a_part_that_is_replaced(
    library: ExperimentLibrary,
) -> None:
    chosen = library.load("straight_line", "allocation", ["vehicle=six_wheel_mecanum"])
    assert len(chosen.vehicle.wheels) == 6
    assert chosen.vehicle.brake.kind == "proportional"


def test_an_override_changes_one_value_and_no_other(library: ExperimentLibrary) -> None:
    before, after = to_mapping(load(library)), to_mapping(load(library, "vehicle.load.mass=400"))
    assert before["vehicle"]["load"].pop("mass") != after["vehicle"]["load"].pop("mass") == 400.0
    assert before == after


def test_later_overrides_win(library: ExperimentLibrary) -> None:
    assert load(library, "seed=2", "seed=3").seed == 3


def test_variants_differ_as_their_file_says(library: ExperimentLibrary) -> None:
    assert load(library).brake_assist.enabled
    assert not library.load("straight_line", "unassisted").brake_assist.enabled


def test_the_nodes_may_be_configured_differently_from_the_truth(library: ExperimentLibrary) -> None:
    chosen = load(library, "odometry.sensors.left.y=0.52")
    assert chosen.sensors["left"].y == 0.5
    assert chosen.odometry.sensors["left"].y == 0.52
    assert chosen.odometry.sensors["right"] == chosen.sensors["right"]


@pytest.mark.parametrize("value", ["[1, 2]", "3", "null", "true", "some"])
@pytest.mark.parametrize(
    "part",
    [
        *("vehicle", "vehicle.tire", "vehicle.wheels", "vehicle.wheels.front_left", "vehicle.load"),
        *("ground", "ground.texture", "sensors", "sensors.left", "camera", "maneuver"),
        *("velocity_sensor", "simulation", "odometry", "odometry.sensors", "odometry.sensors.left"),
        *("brake_assist", "brake_assist.wheels"),
    ],
)
def test_a_part_that_is_no_mapping_is_refused_by_name(
    library: ExperimentLibrary, part: str, value: str
) -> None:
    with pytest.raises(ConfigurationError) as refused:
        load(library, f"{part}={value}")
    assert refused.value.key == part


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("brake_assist.wheels.fifth={x: 1, y: 1, roller_angle_deg: 45}", "brake_assist.wheels"),
        ("odometry.sensors.rear={x: 1, y: 1, heading_deg: 0}", "odometry.sensors"),
    ],
)
def test_the_nodes_know_who_is_there(library: ExperimentLibrary, override: str, key: str) -> None:
    with pytest.raises(ConfigurationError) as refused:
        load(library, override)
    assert refused.value.key == key


@pytest.mark.parametrize("key", ["imu.x", "brake_assist.imu_y", "vehicle.wheels.rear_left.x"])
def test_a_place_far_away_is_refused_before_the_start(library: ExperimentLibrary, key: str) -> None:
    with pytest.raises(ConfigurationError, match="at most 100 m") as refused:
        load(library, f"{key}=1e308")
    assert refused.value.key == key


@pytest.mark.parametrize(
    ("overrides", "age"),
    [
        ((), 0.005),
        (("simulation.control_period=0.02",), 0.01),
        (("brake_assist.feedback_delay=0.0",), 0.0),
        (("feedback=velocity_sensor",), 0.0),
    ],
)
def test_the_assistant_knows_how_old_the_mean_over_a_batch_is(
    library: ExperimentLibrary, overrides: tuple[str, ...], age: float
) -> None:
    """The age is half the duration of the batch by default, and 0 for a velocity sensor."""
    loaded = library.load("small_stop", "assisted", overrides)
    assert loaded.brake_assist.feedback_delay == pytest.approx(age)


def test_numbers_of_a_file_may_have_an_exponent(library: ExperimentLibrary, tmp_path: Path) -> None:
    text = (CONFIG / "experiments/straight_line.yaml").read_text()
    path = tmp_path / "fast.yaml"
    path.write_text(text.replace("speed: 10.0", "speed: 1e1"))
    assert library.load(str(path), "assisted") == load(library)


def test_the_effective_configuration_loads_again(library: ExperimentLibrary) -> None:
    chosen = load(library, "camera.noise=2.5")
    text = yaml.safe_dump(to_mapping(chosen))
    assert from_mapping(ExperimentConfiguration, yaml.safe_load(text)) == chosen


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a.b=1", {"a": {"b": 1}}),
        ("a=1e-3", {"a": 1e-3}),
        ("a=1e3", {"a": 1e3}),
        ("a=-.5E+2", {"a": -50.0}),
        ("a=[1e3, {b: 2e-3}]", {"a": [1e3, {"b": 2e-3}]}),
        ('a="400"', {"a": "400"}),
        ("a='1e3'", {"a": "1e3"}),
        ("a=on_time", {"a": "on_time"}),
        ("a=1e3kg", {"a": "1e3kg"}),
        ("a=[1.0, 2.0]", {"a": [1.0, 2.0]}),
        ("a={b: 2}", {"a": {"b": 2}}),
        ("a=x=y", {"a": "x=y"}),
        ("a=[3:1:2, 3:1.5, 010, 0.10]", {"a": ["3:1:2", "3:1.5", "010", 0.1]}),
    ],
)
def test_overrides_are_yaml(text: str, value: object) -> None:
    assert parse_override(text) == value


@pytest.mark.parametrize(
    "text",
    [
        *("", "a", "=1", "a..b=1", ".=1", "a=[", "a={", "a=2020-13-01", "a=0x_", "a=&a {b: *a}"),
        *('a=!!int ""', 'a=!!float ""', "a=!!bool maybe", "a=!!timestamp x", "a=!!set [a]"),
    ],
)
def test_a_malformed_override_is_refused(text: str) -> None:
    with pytest.raises(ConfigurationError):
        parse_override(text)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("[1, 2]", "must contain a mapping"),
        ("vehicle: [", "is not valid YAML"),
        ("vehicle:\n\ttire: linear", "in line 2, column 1; YAML permits no tabs"),
        ("vehicle: mecanum_forklift", "at least one named variant"),
        ("variants: {assisted: {maneuver: {'': 3}}}", "maneuver.'': is not a known key"),
        ("wheels: {front: {x: 1.0}}", "describes a vehicle; give it as --vehicle"),
        ("vehicle: mecanum_forklift\nvariants: {assisted: 3}", "variants.assisted: 3 is not a"),
        ("seed: 1\nvariants: {assisted: {}}\nseed: 2", "the key 'seed' is given twice in line 3"),
        (
            "seed: !!bool maybe",
            "does not fit its tag .*:bool in line 1, column 7",
        ),
        ("variants: &a {assisted: *a}", "a value contains itself in line 1, column 25"),
        # Each line doubles the last: 2^60 values.
        (
            "a0: &a0 {x: 1}\n"
            + "".join(f"a{k}: &a{k} {{x: *a{k - 1}, y: *a{k - 1}}}\n" for k in range(1, 61)),
            f"more than {LARGEST_YAML} values, with those that aliases repeat",
        ),
        pytest.param(
            f"a: 1 #{'-' * LARGEST_YAML}", f"more than the limit of {LARGEST_YAML}", id="large"
        ),
    ],
)
def test_a_broken_file_is_refused(
    library: ExperimentLibrary, tmp_path: Path, content: str, words: str
) -> None:
    path = tmp_path / "broken.yaml"
    path.write_text(content)
    with pytest.raises(ConfigurationError, match=words):
        library.load(str(path), "assisted")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("brake_assist.law=nowhere:Law", "cannot import 'nowhere'"),
        ("brake_assist.law=os:Law", "os has no class 'Law'"),
        ("brake_assist.law=io:StringIO", "'io:StringIO' has no method 'step'"),
        ("feedback=nowhere:Odometry", "cannot import 'nowhere'"),
    ],
)
def test_a_part_from_outside_that_is_none_is_refused_before_anything_starts(
    library: ExperimentLibrary, change: str, words: str
) -> None:
    configuration = library.load("straight_line", "assisted", [change])
    with pytest.raises(ConfigurationError, match=words):
        configuration.check_drivable()


def test_a_file_that_is_not_there_is_named(library: ExperimentLibrary, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"cannot read .*nothing\.yaml"):
        library.load(str(tmp_path / "nothing.yaml"), "assisted")


def test_a_pipe_is_refused(library: ExperimentLibrary, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    with pytest.raises(ConfigurationError, match="Not a regular file"):
        library.load(str(tmp_path / "pipe.yaml"), "assisted")


@pytest.mark.parametrize("part", ["vehicle", "ground", "sensors"])
@pytest.mark.parametrize("name", [300 * "x", 300 * "x" + ".yaml"])
def test_a_name_that_is_too_long_is_refused(
    library: ExperimentLibrary, part: str, name: str
) -> None:
    with pytest.raises(ConfigurationError, match=part):
        library.load("straight_line", "assisted", [f"{part}={name}"])


def test_a_link_to_itself_is_refused(
    library: ExperimentLibrary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("vehicle.yaml").symlink_to("vehicle.yaml")
    assert short_name("vehicle.yaml") == tmp_path.name
    with pytest.raises(ConfigurationError, match=r"cannot read vehicle\.yaml"):
        library.vehicle("vehicle.yaml")


def test_an_experiment_elsewhere_uses_the_parts_of_the_library(
    library: ExperimentLibrary, tmp_path: Path
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "vehicle: three_wheel_robot\nground: asphalt\nsensors: three_generic\n"
        "variants: {only: {brake_assist: {weighting: cosine}}}\n"
    )
    assert library.variants(str(path)) == ["only"]
    assert library.load(str(path), "only").brake_assist.weighting == "cosine"


def test_a_simulated_vehicle_has_no_axle_that_grips() -> None:
    axle = ["odometry.kinematics.constraint=unsteered_axle", "odometry.kinematics.axle_x=-0.6"]
    library = ExperimentLibrary(CONFIG)
    alone = library.load("straight_line", "assisted", ["sensors=ackermann", *axle])
    with pytest.raises(ConfigurationError, match="wheels with rollers slip sideways"):
        alone.check_drivable()
    # Three cameras suffice, and detect when the axle skids; recordings may be replayed.
    library.load("straight_line", "assisted", axle).check_drivable()
    library.load(
        "straight_line",
        "assisted",
        ["sensors=ackermann", "feedback=velocity_sensor", *axle],
    ).check_drivable()


@pytest.mark.parametrize("name", ["/tmp/x", "../..", "5", "''", "null", "a b", "a" * 65])
def test_a_variant_that_is_no_name_for_a_folder_is_refused(name: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(f"vehicle: mecanum_forklift\nvariants:\n  ? {name}\n  :\n")
    with pytest.raises(ConfigurationError, match="variants"):
        ExperimentLibrary(tmp_path).variants(str(file))


def test_deep_nesting_is_one_sentence() -> None:
    for text in ("seed=" + "[" * 5000, "a." * 5000 + "b=1"):
        with pytest.raises(ConfigurationError) as raised:
            parse_override(text)
        assert len(str(raised.value)) < 400


def test_a_variant_that_is_there_for_its_law_is_left_out_with_another_law() -> None:
    library = ExperimentLibrary(CONFIG)
    assert "allocation" in library.variants("straight_line")
    with_law = library.variants("straight_line", ["brake_assist.law=my_law:MyLaw"])
    assert with_law == ["unassisted", "assisted"]


def test_the_folder_of_a_vehicle_stands_for_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "my_robot"
    folder.mkdir()
    for name in ("vehicles/mecanum_forklift", "experiments/small_stop"):
        text = (CONFIG / f"{name}.yaml").read_text()
        target = "vehicle.yaml" if name.startswith("vehicles") else "experiment.yaml"
        (folder / target).write_text(
            text.replace("vehicle: mecanum_forklift", "vehicle: vehicle.yaml")
        )
    library = ExperimentLibrary(CONFIG)
    by_file = library.load("my_robot/experiment.yaml", "assisted")
    assert library.variants("my_robot") == ["assisted"]
    assert library.load("my_robot", "assisted") == by_file
    assert library.vehicle("my_robot") == by_file.vehicle
    assert (
        library.load("straight_line", "assisted", ["vehicle=my_robot"]).vehicle == by_file.vehicle
    )


@pytest.mark.parametrize(
    "path",
    [
        "my_robot",
        "my_robot.yaml",
        "my_robot/vehicle.yaml",
        "my_robot/experiment.yaml",
        "a/my_robot/",
    ],
)
def test_results_have_the_name_of_the_file_or_of_its_folder(path: str) -> None:
    assert short_name(path) == "my_robot"
