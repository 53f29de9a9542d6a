"""Stops in which the brakes, not the friction of the ground, limit the forces of the wheels."""

from pathlib import Path

import pytest

from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary

LIBRARY = ExperimentLibrary(Path(__file__).resolve().parents[3] / "config")
THREE_WHEELS = "vehicle=three_wheel_robot", "maneuver.speed=1.5", "maneuver.direction_deg=30"


@pytest.mark.parametrize("kind", ["on_off", "proportional"])
@pytest.mark.parametrize("dead_time", [0.0, 0.05])
@pytest.mark.parametrize("vehicle", [(), THREE_WHEELS])
def test_light_braking_keeps_the_heading_and_is_as_short_as_all_brakes(
    kind: str, dead_time: float, vehicle: tuple[str, ...]
) -> None:
    changes = (
        "feedback=velocity_sensor",
        "simulation.render_lines=false",
        "brake_assist.law=allocation",
        f"vehicle.brake.kind={kind}",
        f"vehicle.brake.dead_time={dead_time}",
        "maneuver.pedal=0.08",
        *vehicle,
    )
    runs = {
        enabled: run_fast_loop(
            LIBRARY.load("straight_line", "assisted", [*changes, f"brake_assist.enabled={enabled}"])
        )
        for enabled in ("true", "false")
    }
    assisted, unassisted = runs.values()
    assert assisted.stopped
    assert assisted.orientation_change < 4.0
    assert assisted.stopping_distance < 1.25 * unassisted.stopping_distance
