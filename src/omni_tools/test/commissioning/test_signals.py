"""Recordings from which no drive can be read are refused with the reason."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from omni_core.configuration import ConfigurationError
from omni_core.quantities import FloatArray
from omni_runs.recorded_run import Stream
from omni_runs.workspace import ExperimentWorkspace
from omni_tools.commissioning import command, signals
from omni_tools.commissioning.signals import Motions, motions_of, signals_of

WHEELS = ("left", "right")
SECOND_NS = 10**9


def streams(
    rows: int,
    stamp_ns: Callable[[int], int] = lambda k: k * SECOND_NS // 100,
    speeds: tuple[float, ...] = (1.0, 2.0),
    position: tuple[float, ...] = (0.5,),
) -> dict[str, Stream]:
    states = SimpleNamespace(name=list(WHEELS), velocity=np.array(speeds))
    pedal = SimpleNamespace(position=np.array(position))
    stamps = np.array([stamp_ns(k) for k in range(rows)], np.int64)
    return {
        "wheel_states": Stream(stamps, (states,) * rows),
        "brake/pedal": Stream(stamps, (pedal,) * rows),
    }


@pytest.mark.parametrize("rows", [1, 2, 20])
def test_too_short_a_drive_is_refused(rows: int) -> None:
    with pytest.raises(ConfigurationError, match="record the run"):
        signals_of(streams(rows), WHEELS)


def test_stamps_of_two_clocks_are_refused() -> None:
    jump = streams(400, lambda k: k * SECOND_NS // 100 + (k > 200) * 10**9 * SECOND_NS)
    with pytest.raises(ConfigurationError, match="no wheel speeds for 1e"):
        signals_of(jump, WHEELS)


@pytest.mark.parametrize("speeds", [(), (np.nan, 2.0), (np.inf, 2.0), (-1e9, 2.0)])
def test_wheels_without_encoders_are_named(speeds: tuple[float, ...]) -> None:
    with pytest.raises(ConfigurationError, match="no speed of left"):
        signals_of(streams(400, speeds=speeds), WHEELS)


@pytest.mark.parametrize("position", [(), (np.nan,), (-np.inf,), (1e308,)])
def test_a_pedal_without_a_value_is_unknown(position: tuple[float, ...]) -> None:
    assert np.all(np.isnan(signals_of(streams(400, position=position), WHEELS).pedal))
    assert np.all(signals_of(streams(400), WHEELS).pedal == 0.5)


@pytest.mark.parametrize("position", [100.0, 1.01, -0.5])
def test_a_pedal_that_is_no_share_is_refused(position: float) -> None:
    with pytest.raises(ConfigurationError, match=f"{position:g}, must be a share from 0 to 1"):
        signals_of(streams(400, position=(position,)), WHEELS)


@pytest.mark.parametrize("position", [(), (np.nan,), (0.0,)])
def test_a_drive_without_a_stop_is_refused(position: tuple[float, ...]) -> None:
    with pytest.raises(ConfigurationError, match="brake/pedal: is 0 or unknown"):
        motions_of(signals_of(streams(400, position=position), WHEELS))


def moved(at_rest: float, pedals: Callable[[int], float]) -> Motions:
    """Return the motions of a drive of 8 s that moves in every other second, and ends in a stop.

    Args:
        at_rest: speed of the left wheel at rest [rad/s].
        pedals: demand in a row, of which a second has 100.
    """
    rest, fast = [(at_rest, 0.0)] * 100, [(10.0, 10.0)] * 100
    period = SECOND_NS // 100
    states = [
        (row * period, SimpleNamespace(name=list(WHEELS), velocity=np.array(one)))
        for row, one in enumerate([*rest, *fast] * 4)
    ]
    demands = [(row * period, SimpleNamespace(position=[pedals(row)])) for row in range(800)]
    drive = {"wheel_states": Stream.of(states), "brake/pedal": Stream.of(demands)}
    return motions_of(signals_of(drive, WHEELS), WHEELS)


def test_wheels_that_turn_at_rest_are_named_with_their_speed() -> None:
    with pytest.raises(ConfigurationError, match=r"turn at rest, too: left 0\.3 rad/s: stop"):
        moved(0.3, lambda row: float(row > 750))


def test_brakes_may_hold_the_vehicle_at_rest() -> None:
    held = moved(0.0, lambda row: float(row > 750 or 10 <= row % 200 < 80))
    assert np.all(held.angle == moved(0.0, lambda row: float(row > 750)).angle)
    with pytest.raises(ConfigurationError, match=r"turn at rest, too: left 10 rad/s"):
        moved(10.0, lambda row: float(row >= 0))


def test_other_joints_are_ignored() -> None:
    both = signals_of(streams(400), WHEELS)
    alone = signals_of(streams(400), ("right",))
    assert np.all(alone.wheel_speed == both.wheel_speed[:, 1:])
    with pytest.raises(ConfigurationError, match="the recording names left, right, the vehicle"):
        signals_of(streams(400), ("front",))


def test_an_imu_in_its_own_axes_is_turned_as_the_folder_of_the_vehicle_states(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = Path(__file__).parents[4] / "config"
    experiment = yaml.safe_load((config / "experiments/straight_line.yaml").read_text())
    experiment["brake_assist"]["imu_rotation_deg"] = [180.0, 0.0, 90.0]
    (tmp_path / "experiment.yaml").write_text(yaml.safe_dump(experiment))
    axes: list[FloatArray | None] = []
    monkeypatch.setattr(signals, "read_signals", lambda *words: axes.append(words[2]))
    workspace = ExperimentWorkspace(config.parent)
    for name in (str(tmp_path), "mecanum_forklift"):
        options = command.Options(recording=tmp_path, vehicle=name)
        command._signals(options, workspace, WHEELS)
    assert axes[1] is None
    (tmp_path / "configuration.yaml").touch()  # as in a simulated run
    command._signals(command.Options(recording=tmp_path, vehicle=str(tmp_path)), workspace, WHEELS)
    assert axes[2] is None
    message = SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0)),
        angular_velocity=SimpleNamespace(x=0.0, y=0.0, z=-0.5),
        linear_acceleration=SimpleNamespace(x=2.0, y=3.0, z=-9.81),
    )
    received = streams(400)
    received["imu"] = Stream(received["wheel_states"].stamp_ns, (message,) * 400)
    read = signals_of(received, WHEELS, axes[0])
    np.testing.assert_allclose(read.imu, [(0.5, 3.0, 2.0)] * len(read.time), atol=1e-12)
    assert read.upwards == pytest.approx(9.81)
