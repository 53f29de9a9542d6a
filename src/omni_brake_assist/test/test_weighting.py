"""The weightings compared with Figure 28."""

from __future__ import annotations

import math

import numpy as np
import pytest

from omni_brake_assist.configuration import WEIGHTINGS
from omni_brake_assist.weighting import weighting_function

ANGLES = np.linspace(0.0, math.pi / 2, 91)


@pytest.mark.parametrize("k", [1, 3, 7])
def test_enhanced_runs_from_one_to_zero_without_a_turning_point(k: int) -> None:
    psi = weighting_function("enhanced", k)(ANGLES)
    assert psi[0] == 1.0
    assert psi[-1] == pytest.approx(0.0, abs=1e-12)
    assert np.all(np.diff(psi) <= 0.0)
    assert np.all(psi >= 0.0)


def test_enhanced_at_45_degrees_is_the_cosine_mirrored_at_the_chord() -> None:
    # Eq. (58): the chord between the extremes is 1/2 at 45 deg, the cosine 1/sqrt(2).
    mirrored = 0.5 - (1.0 / math.sqrt(2.0) - 0.5)
    psi = weighting_function("enhanced", 1)(np.array([math.pi / 4]))[0]
    assert psi == pytest.approx(mirrored, rel=1e-12)
    seventh = weighting_function("enhanced", 7)(np.array([math.pi / 4]))[0]
    assert seventh == pytest.approx(mirrored**7)


def test_larger_k_is_steeper_and_all_stay_below_the_cosine() -> None:
    between = ANGLES[1:-1]
    first, seventh = (weighting_function("enhanced", k)(between) for k in (1, 7))
    assert np.all(seventh < first)
    assert np.all(first < weighting_function("cosine", 1)(between))
    assert np.all(weighting_function("zero", 1)(between) == 0.0)


def test_cosine_punishes_least_where_the_enhanced_punishes_most() -> None:
    # The reason for the enhanced function: its slope at zero is steep, the cosine's is flat.
    step = np.array([0.0, 1e-4])
    assert np.diff(weighting_function("cosine", 1)(step))[0] > -1e-7
    slope = np.diff(weighting_function("enhanced", 1)(step))[0]
    assert slope == pytest.approx(-4 / math.pi * 1e-4, rel=1e-3)


@pytest.mark.parametrize("k", [0, 2, 8, -1, -7])
def test_k_that_is_not_odd_and_positive_is_refused(k: int) -> None:
    with pytest.raises(ValueError, match=f"^{k} is not an odd positive"):
        weighting_function("enhanced", k)


def test_every_name_has_its_function_and_no_other() -> None:
    values = [weighting_function(name, 1)(np.array([math.pi / 4]))[0] for name in WEIGHTINGS]
    np.testing.assert_allclose(values, [0.0, math.sqrt(0.5), 1.0 - math.sqrt(0.5)], rtol=1e-12)
    with pytest.raises(ValueError, match="'sine' is not one of zero, cosine, enhanced"):
        weighting_function("sine", 1)
