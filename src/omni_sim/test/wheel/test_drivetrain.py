"""Brake, clutch and spin of a wheel."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from omni_sim.tire.interface.configuration import TMeasyConfiguration
from omni_sim.tire.models.tmeasy import curve_of
from omni_sim.wheel.drivetrain import Drive, Hub, Spin, WheelStep, wheel_step
from omni_sim.wheel.single import Patch, TireConstants

TABLE_1 = TMeasyConfiguration()
INERTIA, LEVER, C, D, DT = 0.8, -0.14, 2.0e5, 5000.0, 0.0005


def step(
    omega: float,
    *,
    load: float = 3000.0,
    brake: float = 0.0,
    drive: Drive = Drive(0.0, 0.0, 0.0, 0.0),  # noqa: B008
    deflection: float = 0.0,
    hub_velocity: float = 0.0,
    sliding: bool = False,
) -> WheelStep:
    result: WheelStep = wheel_step(
        TireConstants(C, D, DT),
        curve_of(TABLE_1, load),
        Patch(deflection, abs(0.2 * omega) + 1e-6, sliding),
        Hub(LEVER, hub_velocity, 0.0),
        Spin(omega, INERTIA, brake),
        drive,
    )
    return result


def test_brake_slows_an_unloaded_wheel_by_torque_over_inertia_and_stops_it_exactly() -> None:
    omega, brake = -10.0, 100.0
    for i in range(1, 159):
        _, _, omega, torque, _, _ = step(omega, load=0.0, brake=brake)
        assert omega == pytest.approx(-10.0 + i * DT * brake / INERTIA)
        assert torque == brake
    # 10 rad/s / (100 N m / 0.8 kg m^2) = 0.08 s = 160 steps
    for _ in range(4):
        _, _, omega, torque, _, _ = step(omega, load=0.0, brake=brake)
    assert omega == 0.0
    assert torque == 0.0


def test_brake_holds_the_wheel_at_exactly_zero_against_the_tire() -> None:
    deflection, slides = 0.0, False
    for _ in range(400):
        force, deflection, omega, torque, _, slides = step(
            0.0, brake=500.0, hub_velocity=0.01, deflection=deflection, sliding=slides
        )
        assert omega == 0.0
        # The brake torque balances the torque of the tire on the wheel.
        assert torque == pytest.approx(LEVER * force)
    assert abs(force) > 300.0


def test_tire_turns_a_wheel_whose_brake_is_too_weak() -> None:
    deflection, slides, omega = 0.0, False, 0.0
    for _ in range(2000):
        force, deflection, omega, torque, _, slides = step(
            omega, brake=100.0, hub_velocity=2.0, deflection=deflection, sliding=slides
        )
    assert omega < -5.0  # rolling perfectly would be 2 / -0.14
    assert torque == 100.0  # against the rotation
    assert LEVER * force == pytest.approx(100.0, rel=1e-3)


def test_free_wheel_ends_up_rolling_perfectly() -> None:
    deflection, slides, omega = 0.0, False, 0.0
    for _ in range(4000):
        force, deflection, omega, _, _, slides = step(
            omega, hub_velocity=2.0, deflection=deflection, sliding=slides
        )
    assert omega == pytest.approx(2.0 / LEVER, rel=1e-6)
    assert force == pytest.approx(0.0, abs=1e-3)


@given(
    st.floats(-60.0, 60.0),
    st.floats(1.0, 3000.0),
    st.floats(-12.0, 12.0),
    st.floats(-0.02, 0.02),
    st.floats(0.0, 6000.0),
    st.booleans(),
)
def test_brake_never_drives_a_wheel(
    omega: float, brake: float, hub: float, deflection: float, load: float, slides: bool
) -> None:
    force, _, after, torque, _, _ = step(
        omega, brake=brake, hub_velocity=hub, deflection=deflection, load=load, sliding=slides
    )
    assert abs(torque) <= brake * (1.0 + 1e-12)
    assert torque * after <= 0.0
    # The wheel's equation of motion holds in every state of the brake.
    assert INERTIA * (after - omega) / DT == pytest.approx(
        torque - LEVER * force, rel=1e-9, abs=1e-6
    )


def test_clutch_follows_its_command_within_its_torque() -> None:
    def driven(omega: float) -> float:
        return step(omega, load=0.0, drive=Drive(500.0, 20.0, -80.0, 80.0)).speed

    omega = 0.0
    for i in range(1, 301):
        omega = driven(omega)
        assert omega == pytest.approx(i * DT * 80.0 / INERTIA)
    for _ in range(400):
        omega = driven(omega)
    assert omega == pytest.approx(20.0, abs=1e-6)
