"""Fault-free stops of vehicles that turn: no source and no brake may be reported as faulty."""

from pathlib import Path

import pytest

from omni_brake_assist.conditions import CONDITIONS, AssistState
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import WITHOUT_CAMERAS, ExperimentLibrary

LIBRARY = ExperimentLibrary(Path(__file__).resolve().parents[3] / "config")
SIX_WHEELS = "vehicle=six_wheel_mecanum", "maneuver.speed=2"
DRIVES = "vehicle.brake.kind=velocity", "vehicle.brake.ramp=4"
FALSE = AssistState.CONTRADICTED_FEEDBACK, AssistState.FAILED_BRAKE, AssistState.NO_EFFECT


@pytest.mark.parametrize(
    ("law", "yaw_rate", "imu", "changes"),
    [
        ("sliding_mode", 200, "false", ("maneuver.speed=0.02",)),
        ("allocation", 200, "false", ("maneuver.speed=0.02",)),
        ("sliding_mode", -150, "true", ("maneuver.speed=1", "ground.friction=0.6")),
        ("allocation", -150, "true", (*SIX_WHEELS, "ground.friction=0.3")),
        ("allocation", 80, "true", ("maneuver.speed=4", *DRIVES)),
        ("allocation", -150, "true", (*SIX_WHEELS, *DRIVES)),
    ],
)
def test_a_turning_vehicle_without_faults_is_assisted(
    law: str, yaw_rate: int, imu: str, changes: tuple[str, ...]
) -> None:
    experiment = LIBRARY.load(
        "straight_line",
        "assisted",
        [
            *WITHOUT_CAMERAS,
            f"brake_assist.law={law}",
            f"maneuver.yaw_rate_deg={yaw_rate}",
            f"imu.enabled={imu}",
            *changes,
        ],
    )
    run = run_fast_loop(experiment)
    assert run.stopped
    assert not {CONDITIONS[code].state for code in run.condition} & set(FALSE)
