"""Line spacings of the correlations."""

import numpy as np
import pytest

from linescan_odometry.joint import candidates


@pytest.mark.parametrize("lines", [2, 9, 25, 26, 27, 51])
def test_line_spacings_are_at_most_a_third_of_the_lines(lines: int) -> None:
    distances = candidates.spacings(lines)
    assert distances[0] == 1
    assert np.all(np.diff(distances) >= 0)
    assert distances[-1] == max(1, lines // 3)
