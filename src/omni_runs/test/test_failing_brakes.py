"""Stops with a failing brake compared with the same stops without the assistant."""

import dataclasses
from pathlib import Path

import pytest

from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary
from omni_runs.history import FastRun
from omni_sim.vehicle.configuration import WheelCondition

LIBRARY = ExperimentLibrary(Path(__file__).parents[3] / "config")
BLIND = ("feedback=velocity_sensor", "simulation.render_lines=false", "encoders.resolution=4096")
FORWARD: tuple[str, ...] = ()
SLANTED = ("maneuver.direction_deg=30", "maneuver.speed=8")
ASIDE = ("maneuver.direction_deg=90", "maneuver.speed=6")
DIAGONAL = ("maneuver.direction_deg=-135", "maneuver.speed=6")
SIX = ("vehicle=six_wheel_mecanum", "maneuver.speed=6")
MECANUM = ("rear_left", "front_left", "front_right", "rear_right")


def stops(changes: tuple[str, ...], wheel: str, **fails: float) -> tuple[FastRun, FastRun]:
    """Return the unassisted and the assisted stop with a failing brake."""
    base = LIBRARY.load("straight_line", "assisted", [*BLIND, *changes])
    vehicle = dataclasses.replace(base.vehicle, conditions={wheel: WheelCondition(**fails)})
    unassisted, assisted = (
        run_fast_loop(
            dataclasses.replace(
                base,
                vehicle=vehicle,
                brake_assist=dataclasses.replace(base.brake_assist, enabled=enabled),
            )
        )
        for enabled in (False, True)
    )
    return unassisted, assisted


@pytest.mark.safety(
    "a brake does not follow its command",
    "a brake without torque from the start of the stop on, in the closed loop: any of four wheels, "
    "some of six, four directions, 6 to 10 m/s",
    "the stop is at most 20 % longer than unassisted, with the same rotation",
    within="the whole stop",
)
@pytest.mark.parametrize(
    ("changes", "wheel"),
    [(changes, wheel) for changes in (FORWARD, SLANTED, ASIDE, DIAGONAL) for wheel in MECANUM]
    + [(SIX, wheel) for wheel in ("front_left", "middle_right", "rear_right")],
)
def test_a_stop_with_a_failed_brake_is_not_worse_than_unassisted(
    changes: tuple[str, ...], wheel: str
) -> None:
    unassisted, assisted = stops(changes, wheel, brake=0.0)
    assert assisted.stopped
    assert assisted.stopping_distance <= 1.2 * unassisted.stopping_distance
    assert assisted.orientation_change <= 1.2 * unassisted.orientation_change + 5.0


SHARES = ("brake_assist.law=allocation", "vehicle.brake.kind=proportional")


@pytest.mark.safety(
    "a brake does not follow its command",
    "a brake without torque, a stuck valve or a stuck brake from the start of the stop on, with "
    "the law `allocation`",
    "brake monitor, or the law: at most 1.5 times the unassisted distance and 20 deg more rotation",
    within="the whole stop",
)
@pytest.mark.parametrize("fails", [{"brake": 0.0}, {"open_valve": 1.0}, {"stuck_brake": 0.5}])
@pytest.mark.parametrize(
    ("changes", "wheel"),
    [
        (FORWARD, "front_right"),
        (SLANTED, "rear_right"),
        (ASIDE, "front_left"),
        (SIX, "front_right"),
    ],
)
def test_allocation_with_a_failing_brake_is_close_to_unassisted(
    changes: tuple[str, ...], wheel: str, fails: dict[str, float]
) -> None:
    unassisted, assisted = stops((*changes, *SHARES), wheel, **fails)
    assert assisted.stopped
    assert assisted.stopping_distance <= 1.5 * unassisted.stopping_distance
    assert assisted.orientation_change <= unassisted.orientation_change + 20.0


@pytest.mark.parametrize("wheel", MECANUM)
def test_a_brake_with_a_quarter_of_its_torque_is_not_treated_as_failed(wheel: str) -> None:
    _, assisted = stops(FORWARD, wheel, brake=0.25)
    assert assisted.orientation_change < 10.0


@pytest.mark.safety(
    "a brake does not follow its command",
    "a valve that cannot release, a brake that is stuck, from the start of the stop on",
    "the law brakes with the other wheels: at most 1.5 times the unassisted distance and 15 deg "
    "more rotation",
    within="the whole stop",
)
@pytest.mark.parametrize("changes", [FORWARD, SLANTED, ASIDE, DIAGONAL])
@pytest.mark.parametrize("fails", [{"open_valve": 1.0}, {"stuck_brake": 0.5}])
@pytest.mark.parametrize("wheel", ["rear_left", "front_right"])
def test_a_brake_that_cannot_release_hardly_lengthens_the_stop(
    changes: tuple[str, ...], fails: dict[str, float], wheel: str
) -> None:
    unassisted, assisted = stops(changes, wheel, **fails)
    assert assisted.stopped
    assert assisted.stopping_distance <= 1.5 * unassisted.stopping_distance
    assert assisted.orientation_change <= unassisted.orientation_change + 15.0
