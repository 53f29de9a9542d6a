"""With fixed patterns in the view, stops keep their heading or brake with every wheel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from omni_runs.experiment import ExperimentLibrary
from omni_runs.loop import run_closed_loop

CONFIG = Path(__file__).parents[3] / "config"


def brakes_straight_or_with_every_wheel(*overrides: str) -> bool:
    overrides = ("feedback=optical", *overrides)
    run = run_closed_loop(ExperimentLibrary(CONFIG).load("straight_line", "assisted", overrides))
    turned = float(np.ptp(np.unwrap(run.pose[:, 2])))
    return np.degrees(turned) < 5.0 or set(run.assist_state) <= {"inactive", "low_confidence"}


@pytest.mark.parametrize("fault", ["camera.dirt_spots=30", "camera.stuck_pixels=1"])
def test_what_stands_still_in_the_view_does_not_turn_the_stop(fault: str) -> None:
    assert brakes_straight_or_with_every_wheel("ground=asphalt", fault)


def test_oblique_texture_does_not_rotate_the_vehicle() -> None:
    slow_over_wood = ("ground=wood", "maneuver.heading_deg=30", "maneuver.speed=2")
    assert brakes_straight_or_with_every_wheel("sensors=lis_770i", *slow_over_wood)


@pytest.mark.parametrize(("camera", "kind"), [("left", "cover"), ("front", "light")])
def test_a_camera_that_goes_blind_during_a_stop_puts_all_brakes_on(camera: str, kind: str) -> None:
    onset = 0.8  # s; the driver brakes from 0.5 s on
    fault = f"{{kind: {kind}, camera: {camera}, amplitude: 1.0, time: {onset}}}"
    overrides = ("feedback=optical", "ground=asphalt", f"camera.faults={{blind: {fault}}}")
    run = run_closed_loop(ExperimentLibrary(CONFIG).load("straight_line", "assisted", overrides))
    time = 1e-9 * run.stamp_ns
    assisted = (time > 0.6) & (time <= onset)
    assert (run.enable[assisted] < 1.0).any()
    # The odometry needs the next batch, the assistant its limit on the age of a twist.
    blind = time > onset + 0.12
    assert (run.enable[blind] == 1.0).all()
    speed = np.linalg.norm(run.twist[:, :2], axis=1)
    assert speed[-1] < 0.05
