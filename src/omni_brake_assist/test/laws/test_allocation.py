"""Law `allocation`: solver, wheel model and decisions."""

import math

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.laws import allocation
from omni_brake_assist.laws.allocation_state import Constants, Memory
from omni_brake_assist.laws.box_least_squares import box_least_squares, new_box
from omni_brake_assist.laws.braking_qp import SIDE, allocate
from omni_brake_assist.laws.law import ASSIST, NO_HELP, Motion
from omni_brake_assist.laws.observers import observe_body, observe_friction
from omni_brake_assist.laws.slip_control import Rim, advance, command_for, control_slip
from omni_brake_assist.laws.wheel_model import (
    BrakedWheel,
    NominalBrake,
    advance_rim,
    command_at,
    lagged,
)
from omni_core.brakes import ON_OFF, PROPORTIONAL, BrakeConfiguration
from omni_core.geometry import PlatformGeometry, WheelMount
from omni_core.quantities import FloatArray

Wheels = dict[str, WheelMount]


@pytest.mark.parametrize("wheels", range(3, 9))
def test_bounded_least_squares_are_those_of_scipy(wheels: int) -> None:
    random = np.random.default_rng(wheels)
    for _ in range(60):
        box = new_box(3, wheels)
        box.rows[:], box.goals[:] = random.normal(size=(3, wheels)), random.normal(size=3) * 3.0
        box.weights[:] = 10.0 ** random.uniform(-1.0, 2.0, 3)
        box.damping[:] = 10.0 ** random.uniform(-4.0, 0.0, wheels)
        box.linear[:] = random.normal(size=wheels) * random.integers(0, 2, wheels)
        box.upper[:] = random.uniform(0.0, 1.0, wheels) * random.integers(0, 2, wheels)
        box.upper[0] = 1.0
        box.solution[:] = random.uniform(0.0, 1.0, wheels)
        box_least_squares(box)
        start, weights, damping, upper = box.solution, box.weights, box.damping, box.upper
        all_rows = np.vstack((np.sqrt(weights)[:, None] * box.rows, np.diag(np.sqrt(damping))))
        goal = np.concatenate((np.sqrt(weights) * box.goals, -box.linear / np.sqrt(damping)))
        bounds = np.zeros(wheels) - 1e-12, upper + 1e-12
        other = lsq_linear(all_rows, goal, bounds, tol=1e-12).x
        assert np.all((start >= 0.0) & (start <= upper))
        cost, least = (float(np.sum((all_rows @ x - goal) ** 2)) for x in (start, other))
        assert cost <= least + 1e-6


def test_a_brake_with_lag_delivers_its_impulse() -> None:
    brake = NominalBrake(dead_time=0.0, time_constant=0.05, pressure_step=0.0)
    wheel = BrakedWheel(capacity=0.0, peak_slip=0.15, mass=25.0, hub=1e-6)  # without friction
    rim = Rim(speed=1000.0, brake=0.0, force=0.0)
    for _ in range(200):
        rim = advance(brake, wheel, rim, 600.0, 0.01, 0.01)
    assert rim.brake == pytest.approx(600.0)
    assert 25.0 * (1000.0 - rim.speed) == pytest.approx(600.0 * (2.0 - 0.05), rel=1e-6)


@pytest.mark.parametrize("time_constant", [0.0, 0.05])
def test_a_command_found_for_a_force_yields_this_force(time_constant: float) -> None:
    brake = NominalBrake(dead_time=0.0, time_constant=time_constant, pressure_step=0.0)
    command = command_for(brake, 200.0, 600.0, 0.01)
    assert lagged(brake, 200.0, command, 0.01) == pytest.approx(600.0)


def test_a_braked_wheel_settles_where_friction_balances_the_brake() -> None:
    wheel = BrakedWheel(capacity=4000.0, peak_slip=0.15, mass=25.0, hub=7.07)
    speed, force = 7.07, 0.0
    for _ in range(100):
        speed, force = advance_rim(wheel, speed, 2000.0, 0.01)
    assert force == pytest.approx(2000.0, rel=1e-3)
    assert 0.0 < speed < 7.07
    for _ in range(20):
        speed, force = advance_rim(wheel, speed, 10000.0, 0.01)
    assert speed == 0.0
    assert force == 4000.0


def _law(
    wheels: Wheels, kind: str = PROPORTIONAL, dead_time: float = 0.0, period: float = 0.01
) -> tuple[Constants, Memory]:
    configuration = BrakeAssistConfiguration(
        wheels=wheels,
        law="allocation",
        wheel_inertia=0.5,
        brake=BrakeConfiguration(kind=kind, max_torque=1500.0, dead_time=dead_time),
        control_period=period,
    )
    geometry = PlatformGeometry.from_wheels(wheels)
    constants = allocation.make_constants(configuration, geometry)
    return constants, allocation.new_memory(constants)


def _motion(v_x: float, spin: float, wheels: int, *, first: bool, pedal: float = 1.0) -> Motion:
    speeds = np.full(wheels, spin)
    return Motion(first, 0.0 if first else 0.01, v_x, 0.0, 0.0, 0.0, 1.0, pedal, speeds)


@pytest.mark.parametrize("period", [0.001, 0.005, 0.02])
def test_a_command_acts_after_the_dead_time_at_any_control_period(
    mecanum: Wheels, period: float
) -> None:
    law, memory = _law(mecanum, dead_time=0.9, period=period)
    steps = round(0.9 / period)
    for step in range(steps + 1):
        memory.sent[step % law.commands] = float(step == 0)
    assert command_at(memory.sent, steps, 0.9 / period, 0) == pytest.approx(1.0)


@pytest.mark.parametrize(("unknown", "answer"), [(2, ASSIST), (3, NO_HELP), (4, NO_HELP)])
def test_with_too_few_wheel_speeds_all_brakes_are_on(
    mecanum: Wheels, unknown: int, answer: int
) -> None:
    law, memory = _law(mecanum)
    motion = _motion(5.0, 25.0, 4, first=True)
    motion.wheel_speed[:unknown] = math.nan
    assert allocation.step(law, memory, motion, np.zeros(4), np.zeros(4)) == answer


def test_brakes_that_are_all_alike_act_alike(mecanum: Wheels) -> None:
    law, memory = _law(mecanum)
    error, enable = np.zeros(4), np.zeros(4)
    rolling = 5.0 / 0.2
    for step in range(5):
        motion = _motion(5.0, rolling, 4, first=step == 0)
        assert allocation.step(law, memory, motion, error, enable) == ASSIST
        assert np.ptp(enable) < 1e-6
        assert 0.0 < enable[0] <= 1.0
    assert np.all(error < 0.0)  # wheels that roll are below their slip


@pytest.mark.parametrize("nominal", [0.0, 0.04])
def test_the_dead_time_of_brakes_without_effect_is_estimated_up_to_150_ms(
    mecanum: Wheels, nominal: float
) -> None:
    law, memory = _law(mecanum)
    law = law._replace(brake=law.brake._replace(dead_time=nominal))
    for step in range(40):
        motion = _motion(5.0, 25.0, 4, first=step == 0)
        allocation.step(law, memory, motion, np.zeros(4), np.zeros(4))
    assert memory.body["responded"]
    assert memory.body["dead_time"] == pytest.approx([0.15], abs=0.0101)


def test_a_wheel_that_locks_is_let_go(mecanum: Wheels) -> None:
    law, memory = _law(mecanum)
    error, enable = np.zeros(4), np.zeros(4)
    for step in range(6):
        speeds = np.full(4, 22.0)
        speeds[2] = 25.0 - 4.0 * step
        motion = Motion(step == 0, 0.01 * (step > 0), 5.0, 0.0, 0.0, 0.0, 1.0, 1.0, speeds)
        allocation.step(law, memory, motion, error, enable)
    assert enable[2] < 0.5 * min(enable[0], enable[3])  # wheel 1 balances the yaw moment
    assert error[2] > 0.0


@pytest.mark.parametrize("turn", [0.0, -2.0])
@pytest.mark.parametrize("pushed", [False, True])
def test_disturbances_are_the_accelerations_that_friction_does_not_explain(
    mecanum: Wheels, turn: float, pushed: bool
) -> None:
    law, memory = _law(mecanum)
    body, wheel, dt, mass = memory.body[0], memory.wheel, 0.01, 800.0
    wheel["sign"], wheel["measured"] = (1.0, -1.0, 1.0, 1.0), (900.0, 400.0, 0.0, 1700.0)
    f_x, f_y, moment = -(wheel["sign"] * wheel["measured"]) @ law.active
    v_x, v_y, yaw_rate, across = 5.0, -2.0, 0.6, (-0.6, 0.8)
    # The push reflects the acceleration, so the acceleration keeps its magnitude.
    push = -2.0 * (f_x * across[0] + f_y * across[1]) / mass * pushed
    a_x, a_y = f_x / mass + push * across[0], f_y / mass + push * across[1]
    turned = moment / (mass * law.gyration**2) + turn
    # The axes of the body rotate, so its velocity also changes without acceleration.
    change = np.array((a_x + yaw_rate * v_y, a_y - yaw_rate * v_x, turned)) * dt
    body["dt"], body["heading"], body["twist"] = dt, 0.2, (v_x, v_y, yaw_rate) - change
    body["mass"] = mass
    observe_body(law, memory, Motion(False, dt, v_x, v_y, yaw_rate, *across, 1.0, np.zeros(4)))
    share = 1.0 - math.exp(-dt / (2.0 * law.observer_time))
    assert body["mass"] == pytest.approx(mass)
    assert body["yaw_disturbance"] == pytest.approx(share * turn, abs=1e-9)
    assert body["lateral_disturbance"] == pytest.approx(share * push, abs=1e-9)
    assert body["heading"] == pytest.approx(0.2 + (yaw_rate - 0.5 * change[2]) * dt)


@pytest.mark.parametrize("mass", [300.0, 3000.0])
def test_the_mass_estimate_approaches_force_over_acceleration(mecanum: Wheels, mass: float) -> None:
    law, memory = _law(mecanum)
    body, wheel, dt = memory.body[0], memory.wheel, 0.01
    wheel["sign"], wheel["measured"] = 1.0, 1000.0
    slowing = math.hypot(*(wheel["measured"] @ law.active)[:2]) / mass
    body["mass"], body["dt"], body["twist"][0] = law.mass, dt, 5.0
    for step in range(500):
        body["responded"] = step >= 100
        v_x = body["twist"][0] - slowing * dt
        observe_body(law, memory, Motion(False, dt, v_x, 0.0, 0.0, 0.0, 1.0, 1.0, np.zeros(4)))
        body["twist"][0] = v_x
        assert step >= 100 or body["mass"] == law.mass  # before the response, it is constant
    assert body["mass"] == pytest.approx(mass, rel=0.05)


def test_a_coarse_brake_remains_on_by_at_least_one_step(mecanum: Wheels) -> None:
    law, memory = _law(mecanum)
    law = law._replace(brake=law.brake._replace(pressure_step=0.1))
    enable, motion = np.zeros(4), _motion(1.0, 0.0, 4, first=True)
    allocation.step(law, memory, motion, np.zeros(4), enable)
    memory.qp.solution[:4] = 0.3, 0.4, 0.3, 0.3
    memory.wheel["force"] = memory.wheel["capacity"]
    control_slip(law, memory, motion, enable)
    assert enable == pytest.approx([0.0, 0.1, 0.0, 0.0])


@pytest.mark.parametrize(
    ("share", "spin", "released"), [(0.4, 0.0, True), (0.6, 0.0, False), (0.4, 4.9, False)]
)
def test_a_locked_wheel_is_released_if_less_than_half_of_its_capacity_is_demanded(
    mecanum: Wheels, share: float, spin: float, released: bool
) -> None:
    law, memory = _law(mecanum)
    enable, motion = np.zeros(4), _motion(1.0, spin, 4, first=True)
    allocation.step(law, memory, motion, np.zeros(4), enable)
    memory.qp.solution[0] = share
    memory.wheel["force"] = (share if spin > 0.0 else 1.0) * memory.wheel["capacity"]
    control_slip(law, memory, motion, enable)
    assert (enable[0] < 0.01) == released


@pytest.mark.parametrize("drift", [0.0, 0.5, -0.3])
@pytest.mark.parametrize("direction", [0.0, 0.5, 2.0])
def test_only_the_velocity_across_the_line_demands_a_lateral_force(
    mecanum: Wheels, direction: float, drift: float
) -> None:
    law, memory = _law(mecanum)
    allocation.step(law, memory, _motion(5.0, 25.0, 4, first=True), np.zeros(4), np.zeros(4))
    memory.body["mass"], memory.body["lateral_disturbance"] = 800.0, 0.0
    c, s = math.cos(direction), math.sin(direction)
    v_x, v_y = 5.0 * c - drift * s, 5.0 * s + drift * c
    allocate(law, memory, Motion(False, 0.01, v_x, v_y, 0.0, -s, c, 1.0, np.zeros(4)))
    allowed = law.max_rotation * math.hypot(5.0, drift)
    per = 800.0 / memory.wheel["capacity"].sum()
    time = max(4.0 * law.observer_time, law.return_share * math.hypot(5.0, drift) * per)
    excess = math.copysign(max(abs(drift) - allowed, 0.0), drift)
    assert memory.qp.goals[SIDE] == pytest.approx(-excess / (2.0 * time) * per, abs=1e-12)


@pytest.mark.parametrize(
    ("demanded", "usable", "grows"),
    [(1.0, 3000.0, True), (0.9, 3000.0, False), (1.0, 2000.0, False)],
)
def test_a_capacity_that_is_fully_demanded_grows_slowly(
    mecanum: Wheels, demanded: float, usable: float, grows: bool
) -> None:
    law, memory = _law(mecanum)
    memory.body["dt"], memory.qp.solution[:4], wheel = 0.01, demanded, memory.wheel
    wheel["known"], wheel["hub"], wheel["speed"], wheel["last_speed"] = True, 5.0, 5.0, 5.0
    wheel["brake"] = wheel["force"] = 1000.0
    wheel["capacity"], wheel["usable"] = 3000.0, usable  # less if the pedal is partly down
    observe_friction(law, memory)
    share = 0.01 / (16.0 * law.observer_time) * grows
    assert wheel["capacity"] == pytest.approx(3000.0 * (1.0 + share))


def test_at_the_target_slip_the_brake_holds_the_friction_capacity(mecanum: Wheels) -> None:
    law, memory = _law(mecanum)
    enable, motion = np.zeros(4), _motion(5.0, 20.0, 4, first=True)
    allocation.step(law, memory, motion, np.zeros(4), enable)
    memory.qp.solution[:4] = 1.0
    memory.wheel["capacity"] = memory.wheel["force"] = memory.wheel["brake"] = 2000.0
    for slower in (0.0, 0.1):
        memory.wheel["speed"] = memory.wheel["hub"] / (1.0 + law.target_slip) - slower
        control_slip(law, memory, motion, enable)
        # The rim returns to the target within half of the observer's time constant.
        need = 2000.0 - law.wheel_mass * slower / (0.5 * law.observer_time)
        assert enable == pytest.approx(need / law.most)


def test_of_locked_wheels_all_but_one_are_released(mecanum: Wheels) -> None:
    law, memory = _law(mecanum)
    error, enable = np.zeros(4), np.zeros(4)
    for step in range(2):
        motion = _motion(10.0, 0.0, 4, first=step == 0)
        assert allocation.step(law, memory, motion, error, enable) == ASSIST
    assert np.count_nonzero(enable) == 1  # the assistant allows none to roll unbraked
    assert np.max(enable) < 0.01


def test_valves_of_wheels_that_slide_in_any_case_are_shut(mecanum: Wheels) -> None:
    law, memory = _law(mecanum, kind=ON_OFF)
    law = law._replace(brake=law.brake._replace(time_constant=0.1))
    error, enable = np.zeros(4), np.zeros(4)
    allocation.step(law, memory, _motion(10.0, 0.0, 4, first=True), error, enable)
    memory.wheel["brake"] = 10.0 * memory.wheel["capacity"]  # decreases by 1/e in 0.1 s
    allocation.step(law, memory, _motion(10.0, 0.0, 4, first=False), error, enable)
    assert np.count_nonzero(enable) == 1  # the assistant allows none to roll unbraked


def _cost(memory: Memory, pattern: int) -> float:
    """Return the cost in the QP of the forces that are predicted for a pattern of four valves."""
    qp, is_open = memory.qp, [bool((pattern >> i) & 1) for i in range(4)]
    excess = np.abs(
        qp.rows[:, :4] @ np.where(is_open, memory.forces[1], memory.forces[0]) - qp.goals
    )
    square = np.minimum(excess, np.array([np.inf, qp.linear[4], qp.linear[6]]) / qp.weights)
    return float(qp.weights @ (square * (2.0 * excess - square)))


def test_valves_take_the_pattern_with_the_lowest_cost(mecanum: Wheels) -> None:
    law, memory = _law(mecanum, kind=ON_OFF)
    random = np.random.default_rng(7)
    error, enable = np.zeros(4), np.zeros(4)
    compared = 0
    for step in range(60):
        dt, yaw_rate = 0.01 * (step > 0), float(random.uniform(-1.0, 1.0))
        speeds = random.uniform(0.0, 40.0, 4)
        motion = Motion(step == 0, dt, 8.0, 0.0, yaw_rate, 0.0, 1.0, 1.0, speeds)
        assert allocation.step(law, memory, motion, error, enable) == ASSIST
        costs = [_cost(memory, pattern) for pattern in range(16)]
        if np.argmin(costs) > 0:  # otherwise no open valve would be best, which is not allowed
            assert costs[int(enable @ [1, 2, 4, 8])] == pytest.approx(min(costs))
            compared += 1
    assert compared > 20


@pytest.mark.parametrize("kind", [PROPORTIONAL, ON_OFF])
def test_a_standing_wheel_is_locked(mecanum: Wheels, kind: str) -> None:
    law, memory = _law(mecanum, kind=kind)
    error, enable = np.zeros(4), np.zeros(4)
    speed = 3.0 * math.sqrt(0.5)
    across = math.sqrt(0.5)
    speeds = np.array([speed, speed, speed, speed])
    motion = Motion(True, 0.0, speed, speed, 0.0, -across, across, 1.0, speeds)
    allocation.step(law, memory, motion, error, enable)
    active = PlatformGeometry.from_wheels(mecanum).active
    standing = np.abs(active @ [across, across]) < 1e-6
    assert np.count_nonzero(standing) == 2
    assert np.all(enable[standing] == 1.0)


@pytest.mark.parametrize("drift", [-1e-3, 0.0, 1e-3])
def test_a_wheel_about_which_the_vehicle_rotates_opposes_the_translation(
    mecanum: Wheels, drift: float
) -> None:
    law, memory = _law(mecanum)
    geometry = PlatformGeometry.from_wheels(mecanum)
    along = geometry.active @ [3.0, 2.5]
    wheel = int(np.argmin(np.abs(along)))
    yaw_rate = (drift - float(along[wheel])) / float(geometry.lever[wheel])
    motion = Motion(True, 0.0, 3.0, 2.5, yaw_rate, 0.0, 1.0, 1.0, np.zeros(4))
    allocation.step(law, memory, motion, np.zeros(4), np.zeros(4))
    assert memory.wheel["hub"][wheel] < 2e-3
    assert memory.wheel["sign"][wheel] == np.sign(along[wheel])
    assert not memory.wheel["fixed"][wheel]


@pytest.mark.parametrize("kind", [PROPORTIONAL, ON_OFF])
def test_any_motion_gets_shares_between_0_and_1(mecanum: Wheels, kind: str) -> None:
    law, memory = _law(mecanum, kind=kind)
    random = np.random.default_rng(5)
    error, enable = np.zeros(4), np.zeros(4)
    for step in range(3000):
        scale = 10.0 ** random.uniform(-6.0, 3.0)
        v_x, v_y, yaw_rate = (random.normal(size=3) * scale).tolist()
        speeds = random.normal(size=4) * 10.0 ** random.uniform(-6.0, 4.0)
        angle = random.uniform(-math.pi, math.pi)
        motion = Motion(
            step == 0 or random.uniform() < 0.02,
            float(random.choice([1e-6, 0.01, 0.25])),
            v_x,
            v_y,
            yaw_rate,
            math.cos(angle),
            math.sin(angle),
            float(random.uniform(0.0, 1.0)),
            speeds,
        )
        allocation.step(law, memory, motion, error, enable)
        assert np.all((enable >= 0.0) & (enable <= 1.0))
        assert np.all(np.isfinite(error))


def test_the_force_of_a_wheel_without_a_speed_is_at_most_its_capacity(mecanum: Wheels) -> None:
    law, memory = _law(mecanum)
    error, enable = np.zeros(4), np.zeros(4)
    for step in range(8):
        motion = _motion(5.0, 25.0, 4, first=step == 0)
        motion.wheel_speed[0] = math.nan
        allocation.step(law, memory, motion, error, enable)
        memory.body["responded"] = True
        memory.sent[:, 0] = 3.0 * memory.wheel["capacity"][0] / law.most[0]
    wheel = memory.wheel[0]
    assert 0.0 < wheel["force"] <= wheel["capacity"]
    assert 0.0 < wheel["measured"] <= wheel["capacity"]


def _stop_with_zeros(wheels: Wheels, zeros: tuple[int, ...]) -> tuple[Memory, FloatArray]:
    """Return memory and enables after 0.4 s of a stop in which some encoders read 0."""
    law, memory = _law(wheels)
    enable = np.zeros(4)
    for step in range(40):
        motion = _motion(8.0 - 0.06 * step, 5.0 * (8.0 - 0.06 * step), 4, first=step == 0)
        motion.wheel_speed[list(zeros)] = 0.0
        allocation.step(law, memory, motion, np.zeros(4), enable)
    return memory, enable


def test_a_wheel_that_reads_0_although_it_cannot_be_locked_is_braked_as_if_it_rolled(
    mecanum: Wheels,
) -> None:
    memory, enable = _stop_with_zeros(mecanum, (0,))
    assert memory.wheel["known"].tolist() == [False, True, True, True]
    assert enable[0] > 0.5 * enable[1:].min()


def test_at_most_one_wheel_that_reads_0_counts_as_rolling(mecanum: Wheels) -> None:
    memory, _ = _stop_with_zeros(mecanum, (0, 2))
    assert np.sum(~memory.wheel["known"]) == 1


def test_a_wheel_that_read_0_is_known_again_as_soon_as_it_turns(mecanum: Wheels) -> None:
    memory, enable = _stop_with_zeros(mecanum, (0,))
    law, _ = _law(mecanum)
    allocation.step(law, memory, _motion(5.6, 20.0, 4, first=False), np.zeros(4), enable)
    assert memory.wheel["known"].all()


def test_a_wheel_whose_encoder_was_wrong_has_the_capacity_of_the_other_wheels(
    mecanum: Wheels,
) -> None:
    law, memory = _law(mecanum)
    error, enable = np.zeros(4), np.zeros(4)
    for step in range(40):
        motion = _motion(8.0 - 0.08 * step, 36.0, 4, first=step == 0)
        motion.wheel_speed[0] = 5.0 if step < 30 else math.nan  # isolated in step 30
        allocation.step(law, memory, motion, error, enable)
    capacity = memory.wheel["capacity"]
    assert capacity[0] == pytest.approx(capacity[1:].max(), rel=0.01)
