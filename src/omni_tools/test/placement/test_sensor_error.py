"""A camera that cannot measure is rejected with the cause and suitable advice."""

from __future__ import annotations

import pytest

from omni_core.configuration import WorkError
from omni_tools.line_trials.rig import View, ground
from omni_tools.placement.sensor_error import measure_sensor_error

VIEW = View(256, 0.05, 0.02, 1000.0)


@pytest.mark.parametrize(
    ("kind", "speed", "noise", "option", "reason", "advice"),
    [
        (
            "cork", 1e-5, 0.0, "--noise", "frozen: ",
            "more --noise or a higher --speed, so that the lines change",
        ),
        (
            "cork", 0.1, 100.0, "--ground", "low texture",
            "another --ground, another --type or less --noise",
        ),
        (
            "metal", 7.5, 2.0, "--ground", "low texture",
            "another --ground, another --type, a lower --speed or less --noise",
        ),
    ],
)  # fmt: skip
def test_a_blind_camera_is_refused_with_the_cause(
    kind: str, speed: float, noise: float, option: str, reason: str, advice: str
) -> None:
    with pytest.raises(WorkError) as failed:
        measure_sensor_error(VIEW, ground(kind, 1024), noise, speed, 1, seed=1)
    problem = str(failed.value)
    assert problem.startswith(f"{option}: moving")
    assert f'for reasons such as "{reason}' in problem
    assert problem.endswith(f"; choose {advice}")
