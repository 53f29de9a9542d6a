"""A driver's demands from a table or a recording, and their effect in the loop."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from made_histories import first_difference

from omni_core.configuration import ConfigurationError
from omni_runs.compiled import run_fast_loop
from omni_runs.demands import read_demands
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_runs.loop import run_closed_loop
from omni_runs.recorded_run import read_run
from omni_runs.stops import stops_of
from omni_sim.driver.scripted import ScriptedDriver

WORKSPACE = Path(__file__).resolve().parents[3]
SAMPLE = WORKSPACE / "bags" / "small_stop" / "assisted"
FAST = ("feedback=velocity_sensor", "simulation.render_lines=false")
HEAD = "time,forward,left,turn,pedal\n"
# Away from rest, a stop, away to the left, another stop.
TWO_STOPS = HEAD + (
    "0,0,0,0,0\n2,3,0,0,0\n2.01,3,0,0,1\n4.0,0,0,0,1\n4.01,0,0,0,0\n6,0,2,0,0\n6.01,0,2,0,1\n8,0,0,0,1\n"
)


def _load(*overrides: str) -> ExperimentConfiguration:
    library = ExperimentLibrary(WORKSPACE / "config")
    return library.load("small_stop", "assisted", [*FAST, *overrides])


@pytest.fixture
def two_stops(tmp_path: Path) -> ExperimentConfiguration:
    file = tmp_path / "demands.csv"
    file.write_text(TWO_STOPS)
    return _load(f"maneuver.demands={file}")


def test_between_rows_demands_are_on_a_line_and_rest_follows_the_last(
    two_stops: ExperimentConfiguration,
) -> None:
    driver = ScriptedDriver(two_stops.maneuver)
    assert driver.demand(1_000_000_000, 0.3)[1].tolist() == [1.5, 0.0, 0.0]
    assert driver.demand(2_005_000_000, 0.0)[0] == pytest.approx(0.5)
    assert driver.demand(9_000_000_000, 0.0)[1].tolist() == [0.0, 0.0, 0.0]
    assert driver.demand(9_000_000_000, 0.0)[0] == 1.0
    assert driver.start_twist.tolist() == [0.0, 0.0, 0.0]


def test_a_table_with_two_stops_runs_to_the_second_and_both_loops_agree(
    two_stops: ExperimentConfiguration,
) -> None:
    run = run_fast_loop(two_stops)
    assert first_difference(run, run_closed_loop(two_stops)) is None
    first, second = stops_of(run)
    assert first.brake_start is not None
    assert second.brake_start is not None
    assert first.twist[first.brake_start, 0] == pytest.approx(3.0, abs=0.1)
    assert second.twist[second.brake_start, 1] == pytest.approx(2.0, abs=0.1)
    assert run.time[-1] >= 8.0


def test_a_recording_is_driven_again() -> None:
    recorded = read_run(SAMPLE)
    configuration = _load(f"maneuver.demands={SAMPLE}")
    again = run_fast_loop(configuration)
    start, start_again = recorded.brake_start, again.brake_start
    assert start is not None
    assert start_again == pytest.approx(start, abs=1)
    assert again.twist[0] == pytest.approx(recorded.twist[0], abs=1e-6)
    # The recording of the sample contains the lines of its cameras.
    distance = math.dist(recorded.pose[start, :2], recorded.pose[-1, :2])
    assert again.stopping_distance == pytest.approx(distance, rel=0.1)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time,forward\n0,1\n", "no column 'left' and no column 'turn'"),
        (HEAD, "no row"),
        (HEAD + "0,1,0,0,x\n", "line 2: the pedal 'x' is not a number"),
        (HEAD + "0,1,0,0,0\n0,1,0,0,0\n", "time: must increase"),
        (HEAD + "0,1,0,0,2\n", r"pedal\[0\]: 2 is out of range"),
        (HEAD + "0,nan,0,0,1\n", "line 2: the forward 'nan' is not finite"),
        (HEAD + "0,1,0,0,0\n90,1,0,0,1\n", "duration_limit: 30 s is before"),
    ],
)
def test_a_table_that_is_none_is_refused(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "demands.csv"
    file.write_text(text)
    with pytest.raises(ConfigurationError, match=words):
        _load(f"maneuver.demands={file}")


@pytest.mark.parametrize("name", ["nowhere.csv", "nowhere"])
def test_what_is_not_there_is_refused_by_name(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigurationError, match=name):
        read_demands(tmp_path / name, "maneuver.demands")


def test_the_table_reaches_the_simulator_as_parameters(two_stops: ExperimentConfiguration) -> None:
    from omni_ros.flat_parameters import flatten
    from omni_sim.configuration import SimulatorConfiguration

    flat = flatten(two_stops, part=SimulatorConfiguration)
    assert np.array_equal(flat["maneuver.demands.time"], two_stops.maneuver.demands.time)
