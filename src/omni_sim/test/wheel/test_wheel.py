"""First-order tire dynamics (4) on the slip of the contact patch (20), sticking and sliding."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omni_sim.tire.interface.configuration import TireConfiguration, TMeasyConfiguration
from omni_sim.tire.interface.model import contact_friction
from omni_sim.tire.models.tmeasy import curve_of, force_at
from omni_sim.tire.tire import Tire
from omni_sim.wheel.single import Patch, TireConstants, tire_force

TABLE_1 = TMeasyConfiguration()
TIRE = Tire(TireConfiguration(tmeasy=TABLE_1))
CURVE = curve_of(TABLE_1, 3000.0)
SLOPE, PEAK, SLIDE = CURVE[0], CURVE[2], CURVE[4]
C, D, DT = 2.0e5, 5000.0, 0.0005
LOCKED = 1e-6  # V of a standing wheel [m/s]


@given(
    st.floats(0.0, 2e4), st.floats(-7.0, 2.0), st.floats(1.0, 5.0), st.booleans(), st.floats(0, 6e3)
)
def test_patch_speed_solves_the_balance_of_forces(
    demand: float, exponent: float, gain: float, sliding: bool, load: float
) -> None:
    speed = 10.0**exponent
    curve = curve_of(TABLE_1, load)
    force, w, _ = contact_friction(demand, D, gain, speed, curve, sliding)
    assert 0.0 <= force <= curve[2]
    assert w >= 0.0
    assert D * w + gain * force == pytest.approx(demand, rel=1e-9, abs=1e-9)
    # The characteristic is steep near standstill: compare where the slip is well conditioned.
    if speed > 1e-2:
        assert force == pytest.approx(force_at(curve, w / speed)[0], rel=1e-6, abs=1e-6)


def test_standing_patch_sticks_up_to_the_peak_and_slides_down_to_the_sliding_force() -> None:
    sliding = False
    grew, fell = [], []
    demands = np.linspace(0.0, 4000.0, 4001)
    for demand in demands:
        force, w, sliding = contact_friction(demand, D, 1.0, LOCKED, CURVE, sliding)
        grew.append((force, w, sliding))
    for demand in demands[::-1]:
        force, w, sliding = contact_friction(demand, D, 1.0, LOCKED, CURVE, sliding)
        fell.append((force, w, sliding))
    for demand, (force, w, slides) in zip(demands, grew, strict=True):
        if demand <= PEAK - 1.0:
            assert not slides
            assert force == pytest.approx(demand, abs=1e-2)
            assert w < 1e-6
        elif demand >= PEAK + 1.0:
            assert slides
            assert force == SLIDE
    for demand, (_, _, slides) in zip(demands[::-1], fell, strict=True):
        if demand >= SLIDE + 1.0:
            assert slides
        elif demand <= SLIDE - 1.0:
            assert not slides


def test_rolling_patch_has_one_state_for_one_demand() -> None:
    for demand in np.linspace(0.0, 2e4, 500):
        stuck = contact_friction(demand, D, 1.0, 5.0, CURVE, False)
        slid = contact_friction(demand, D, 1.0, 5.0, CURVE, True)
        assert stuck == pytest.approx(slid, rel=1e-9)


def build_up(
    speed: float, sliding_velocity: float, damping: float, dt: float, n: int
) -> list[float]:
    tire, deflection, slides, forces = TireConstants(C, damping, dt), 0.0, False, []
    for _ in range(n):
        force, deflection, _, slides = tire_force(
            tire, CURVE, Patch(deflection, speed, slides), sliding_velocity, 0.0
        )
        forces.append(force)
    return forces


@pytest.mark.parametrize("speed", [0.5, 2.0, 10.0])
@pytest.mark.parametrize("damping", [0.0, 2500.0])
def test_small_slip_builds_force_up_with_the_time_of_the_linear_system(
    speed: float, damping: float
) -> None:
    # For small slip F = -(dF0 / V) v_p, so that (d + K) e_dot = -c e - K v_s with K = dF0 / V.
    k = SLOPE / speed
    time_constant = (damping + k) / C
    velocity = 1e-5 * speed
    dt = time_constant / 5000.0
    forces = np.array(build_up(speed, velocity, damping, dt, 15000))
    t = dt * np.arange(1, 15001)
    # e = -(K v_s / c) (1 - exp(-t / tau)), F = -K (e_dot + v_s)
    rate = -(k * velocity / C) * np.exp(-t / time_constant) / time_constant
    np.testing.assert_allclose(forces, -k * (rate + velocity), rtol=1e-3)


def test_relaxation_length_is_slope_over_stiffness() -> None:
    for speed in (1.0, 10.0):
        dt = 1e-6 * 10.0 / speed
        forces = np.array(build_up(speed, 1e-5 * speed, 0.0, dt, 100000))
        steady = -SLOPE * 1e-5
        reached = int(np.argmax(forces <= steady * (1.0 - math.exp(-1.0))))
        assert reached * dt * speed == pytest.approx(SLOPE / C, rel=1e-3)


@pytest.mark.parametrize("velocity", [-3.0, 0.02, 8.0])
def test_locked_sliding_wheel_reaches_exactly_the_sliding_force(velocity: float) -> None:
    assert build_up(LOCKED, velocity, D, DT, 4000)[-1] == -math.copysign(SLIDE, velocity)


def test_rolling_wheel_settles_on_the_steady_characteristic() -> None:
    for slip in (0.02, 0.1, 0.149, 0.25, 0.6):
        force = build_up(5.0, 5.0 * slip, D, DT, 20000)[-1]
        assert force == pytest.approx(-float(TIRE.force(slip, 3000.0)), rel=1e-6)


def test_unloaded_tire_makes_no_force_and_relaxes() -> None:
    curve = curve_of(TABLE_1, 0.0)
    deflection, slides = 0.01, True
    for step in range(1, 200):
        force, deflection, _, slides = tire_force(
            TireConstants(C, D, DT), curve, Patch(deflection, 3.0, slides), 4.0, 0.0
        )
        assert force == 0.0
        # Implicit Euler of e_dot = -(c / d) e
        assert deflection == pytest.approx(0.01 * (1.0 + C * DT / D) ** -step, rel=1e-9)


@given(
    st.integers(0, 2**32 - 1),
    st.floats(1e4, 1e7),
    st.floats(0.0, 1e5),
    st.floats(-7.0, 1.5),
    st.floats(1e-4, 1e-2),
)
def test_tire_never_gives_out_more_energy_than_its_deflection_stores(
    seed: int, stiffness: float, damping: float, exponent: float, dt: float
) -> None:
    random, tire = np.random.default_rng(seed), TireConstants(stiffness, damping, dt)
    deflection, slides = 0.0, False
    for velocity in random.normal(0.0, 1.0, 60) * 10.0 ** random.uniform(-4.0, 1.0):
        before = 0.5 * stiffness * deflection**2
        force, deflection, _, slides = tire_force(
            tire, CURVE, Patch(deflection, 10.0**exponent, slides), velocity, 0.0
        )
        given_out = force * velocity * dt
        stored = 0.5 * stiffness * deflection**2 - before
        assert given_out + stored <= 1e-9 * (abs(given_out) + before)
