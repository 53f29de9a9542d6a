"""A vehicle that drove has a path that its speeds and friction allow; a placed one has not."""

from __future__ import annotations

import pytest

from omni_tools.drive.placement import was_placed

REST = (0.0, 0.0, 0.0)
STEP = 10_000_000  # [ns]


@pytest.mark.parametrize("speed", [0.0, 5.0, 50.0])
def test_a_steady_drive_is_no_placement(speed: float) -> None:
    moved = (0.01 * speed, 0.0, 0.0)
    assert not was_placed((0, REST, (speed, 0.0, 0.0)), (STEP, moved, (speed, 0.0, 0.0)))


def test_a_start_between_two_distant_stamps_is_no_placement() -> None:
    """Half a second of acceleration at 9 m/s^2 and half a second of braking give 2.25 m."""
    assert not was_placed((0, REST, REST), (10**9, (2.25, 0.0, 0.0), REST))


@pytest.mark.parametrize("speed", [0.0, 5.0])
def test_a_return_to_the_start_is_a_placement(speed: float) -> None:
    assert was_placed((0, (3.0, 0.4, 1.0), (speed, 0.0, 0.0)), (STEP, REST, REST))
