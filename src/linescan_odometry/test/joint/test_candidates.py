"""Line spacings of the correlations, and ambiguous candidates."""

import numpy as np
import pytest

from linescan_odometry.joint import candidates


@pytest.mark.parametrize("lines", [2, 9, 25, 26, 27, 51])
def test_line_spacings_are_at_most_a_third_of_the_lines(lines: int) -> None:
    distances = candidates.spacings(lines)
    assert distances[0] == 1
    assert np.all(np.diff(distances) >= 0)
    assert distances[-1] == max(1, lines // 3)


@pytest.mark.parametrize(
    ("rival", "evidence", "ambiguous"),
    [(30.0, 49.0, False), (30.0, 51.0, True), (30.0, 120.0, True), (5.0, 99.0, False)],
)
def test_a_choice_is_ambiguous_if_a_distant_rival_has_half_of_its_evidence(
    rival: float, evidence: float, ambiguous: bool
) -> None:
    found, nats = np.array([rival, 0.0]), np.array([evidence, 100.0])
    assert candidates.ambiguous(found, nats, 1) == ambiguous
    assert candidates.APART > 5.0
