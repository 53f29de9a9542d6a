"""The filter bank with motions in closed form."""

import math

import numpy as np
import pytest

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.filter_bank import state as bank
from omni_brake_assist.filter_bank.bank import estimate
from omni_brake_assist.filter_bank.filters import speeds_of
from omni_core.geometry import PlatformGeometry, WheelMount
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import FloatArray
from omni_core.signals import MISSING, VALID, TwistSample

RELEASED = "brakes released when they should act"
ISOLATED = "fault isolation: the reading contradicts "
PERIOD_NS = 10_000_000
STEP = 0.01  # [s]
PEDAL, START, BRAKE, TURN = 50, 8.0, 4.0, 0.4  # step; [m/s], [m/s^2], [rad/s^2]


class Drive:
    """A vehicle that brakes along the x axis of the world while it begins to turn.

    All sensors are fault-free unless `fault` changes a reading from a step on. The first wheel
    rolls freely while braking.
    """

    def __init__(
        self,
        wheels: dict[str, WheelMount],
        place: tuple[float, float] = (0.0, 0.0),
        delay: float = 0.0,
        period_ns: int = PERIOD_NS,
    ) -> None:
        configuration = BrakeAssistConfiguration(
            wheels=wheels,
            imu_x=place[0],
            imu_y=place[1],
            feedback_delay=delay,
            control_period=period_ns * 1e-9,
        )
        self.period_ns, self.pedal = period_ns, PEDAL * PERIOD_NS // period_ns
        self.unsaid = delay * 1e9 / period_ns  # steps by which stamps are later than the motion
        self.constants: bank.BankConstants = bank.bank_constants(
            configuration, PlatformGeometry.from_wheels(wheels)
        )
        self.kinematics, self.place = PlatformKinematics(wheels), place
        self.memory = bank.bank_memory(self.constants)
        self.heading = 0.0  # of the body at the start [rad]
        self.imu_lost = 1000  # step from which on no IMU reading is received
        self.variance = 1e-6  # of each component of the twist [square of its unit]
        self.answers: list[FloatArray] = []
        self.chosen: list[int] = []

    def truth(self, step: float) -> tuple[FloatArray, float, float]:
        """Return the body twist, the yaw and the deceleration at a step."""
        time = max(step - self.pedal, 0.0) * self.period_ns / 1e9
        speed, yaw = START - BRAKE * time, self.heading + 0.5 * TURN * time**2
        rate = TURN * time
        twist = np.array([speed * math.cos(yaw), -speed * math.sin(yaw), rate])
        return twist, yaw, BRAKE if step > self.pedal else 0.0

    def inertial(self, step: int) -> FloatArray:
        """Return the yaw rate and the mean specific force of the period at the IMU."""
        velocity = []
        for k in (max(step - 1, 0), step):
            twist, yaw, _ = self.truth(k)
            u_x = twist[0] - twist[2] * self.place[1]
            u_y = twist[1] + twist[2] * self.place[0]
            c, s = math.cos(yaw), math.sin(yaw)
            velocity.append(np.array([c * u_x - s * u_y, s * u_x + c * u_y]))
        force = (velocity[1] - velocity[0]) * 1e9 / self.period_ns
        _, yaw, _ = self.truth(step - 0.5)
        c, s = math.cos(yaw), math.sin(yaw)
        rate = self.truth(step)[0][2]
        return np.array([rate, c * force[0] + s * force[1], c * force[1] - s * force[0]])

    def run(
        self,
        steps: int,
        fault: str = "",
        onset: int = 80,
        size: float = 0.0,
        late: int = 0,
        until: int = 1000,
        hold: int = 1,
    ) -> None:
        """Run all steps; the twist is `late` steps old, and each is used for `hold` steps."""
        count = len(self.memory.rim)
        for step in range(steps):
            braking, faulty = step >= self.pedal, onset <= step < until
            taken = max(step - late, 0) // hold * hold
            twist, _, _ = self.truth(onset if faulty and fault == "stuck" else taken - self.unsaid)
            inertial = self.inertial(step) if step < self.imu_lost else np.full(3, np.nan)
            speeds = self.kinematics.wheel_speeds(self.truth(step)[0])
            if faulty and fault == "twist":
                twist = twist + np.array([0.0, size, 0.0])
            if faulty and fault == "gyro and encoders":
                inertial[0] = self.inertial(onset)[0]
                speeds = self.kinematics.wheel_speeds(self.truth(onset)[0])
            if faulty and fault == "rate":
                twist = twist + np.array([0.0, 0.0, size])
            if faulty and fault == "sine":  # with a period of half a second
                swing = math.sin(4.0 * math.pi * STEP * (step - onset))
                twist = twist + np.array([0.0, 0.0, size * swing])
            if faulty and fault == "gyro":
                inertial[0] += size
            if faulty and fault == "vibration":
                inertial[0] += size * (-1.0) ** step
            if faulty and fault == "noise":
                twist = twist + np.array([size * (-1.0) ** step, 0.0, 0.0])
            if faulty and fault == "force":
                inertial[2] += size
            if faulty and (fault == "wheel" or (fault == "silence" and step >= onset + 20)):
                speeds[0] += size
            received = not (faulty and fault in ("silence", "locked", "pulses"))
            enable = np.ones(count)
            if braking and fault != "gyro and encoders":
                enable[0] = float(fault == "pulses" and step % 2)
                speeds[0 if fault in ("locked", "pulses") else 1 :] = 0.0
            if faulty and fault == "ice":
                speeds[0] = min(speeds[0], size * (step - onset))
            now_ns, answer = step * self.period_ns, np.full(3, np.nan)
            readings = bank.Readings(1.0 if braking else 0.0, enable, inertial, speeds)
            measured = TwistSample(
                taken * self.period_ns,
                twist,
                self.variance * np.eye(3),
                VALID if received else MISSING,
            )
            found = estimate(self.constants, self.memory, now_ns, readings, measured, answer)
            self.chosen.append(found)
            self.answers.append(answer)

    def time_until(self, out: int, onset: int = 80) -> float:
        """Return the time from the onset of a fault to the isolation of its source [s]."""
        return (self.chosen.index(out, onset) + 1 - onset) * self.period_ns / 1e9

    @property
    def error(self) -> FloatArray:
        """Error of the last estimate."""
        return self.answers[-1] - self.truth(len(self.answers) - 1)[0]


@pytest.fixture(params=[(0.0, 0.0), (0.5, -0.3)])
def drive(mecanum: dict[str, WheelMount], request: pytest.FixtureRequest) -> Drive:
    return Drive(mecanum, request.param)


def test_the_speeds_of_a_filter_are_those_of_the_wheels(drive: Drive) -> None:
    v_x, v_y, rate = 0.4, -0.3, 2.0
    state = np.zeros(bank.STATES)
    state[bank.U_X], state[bank.U_Y] = v_x - rate * drive.place[1], v_y + rate * drive.place[0]
    state[bank.RATE] = rate
    x, y = drive.kinematics.geometry.position.T
    wheels = math.sqrt(np.mean((v_x - rate * y) ** 2 + (v_y + rate * x) ** 2))
    assert speeds_of(drive.constants, state) == pytest.approx((math.hypot(v_x, v_y), wheels))


@pytest.mark.parametrize("heading", [0.0, 1.6, 3.1])
def test_fault_free_sensors_are_all_used(drive: Drive, heading: float) -> None:
    drive.heading = heading
    drive.run(200)
    assert set(drive.chosen) == {bank.ALL}
    assert drive.error == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("period_ns", [2_500_000, 5_000_000, 20_000_000])
@pytest.mark.parametrize(
    ("fault", "size", "out"), [("twist", 1.0, bank.NO_VELOCITY), ("force", 5.0, bank.NO_FORCE)]
)
def test_the_time_until_isolation_does_not_depend_on_the_control_period(
    mecanum: dict[str, WheelMount], fault: str, size: float, out: int, period_ns: int
) -> None:
    times = []
    for period in (PERIOD_NS, period_ns):
        drive, onset = Drive(mecanum, period_ns=period), 80 * PERIOD_NS // period
        drive.run(200 * PERIOD_NS // period, fault, onset, size)
        times.append(drive.time_until(out, onset))
    assert times[1] == pytest.approx(times[0], abs=0.02)


@pytest.mark.parametrize("delay", [0.05, 0.1, 0.2])
def test_readings_at_1_khz_reach_back_to_a_late_twist(
    mecanum: dict[str, WheelMount], delay: float
) -> None:
    drive = Drive(mecanum, delay=delay, period_ns=1_000_000)
    drive.imu_lost = 2000
    drive.run(1500, onset=2000, hold=20)  # twists at 50 Hz
    errors = np.abs([answer - drive.truth(k)[0] for k, answer in enumerate(drive.answers)])
    assert set(drive.chosen[600:]) == {bank.ALL}
    assert np.max(errors[600:]) < 0.02


@pytest.mark.safety(
    RELEASED, "the twist is permanently lost", "dead reckoning with IMU and wheels", within=0.0
)
def test_the_motion_is_known_for_a_second_without_the_twist(drive: Drive) -> None:
    drive.run(180, "silence")
    assert bank.NO_ESTIMATE not in drive.chosen
    assert drive.error == pytest.approx(0.0, abs=0.01)


@pytest.mark.safety(
    RELEASED, "no twist is ever received", "dead reckoning with IMU and wheels", within=0.0
)
def test_the_motion_is_known_without_any_twist(drive: Drive) -> None:
    drive.run(150, "silence", onset=0)
    assert set(drive.chosen[2:]) == {bank.ALL}
    assert drive.error == pytest.approx(0.0, abs=0.05)


def test_without_any_twist_a_wheel_need_not_roll_one_step_after_its_release(drive: Drive) -> None:
    drive.run(PEDAL + 60, "pulses", onset=0)
    assert bank.NO_ESTIMATE not in drive.chosen[2:]


def test_without_a_twist_the_estimate_stays_valid_during_a_long_drive(drive: Drive) -> None:
    twist, wheels, answer = drive.truth(0)[0], drive.memory.rim.size, np.zeros(3)
    speeds, period_ns = drive.kinematics.wheel_speeds(twist), 5 * PERIOD_NS
    readings = bank.Readings(0.0, np.ones(wheels), np.zeros(3), speeds)
    for step in range(60 * 60 * 20):  # an hour
        missing = TwistSample(0, np.full(3, np.nan), np.zeros((3, 3)), MISSING)
        now_ns = step * period_ns
        chosen = estimate(drive.constants, drive.memory, now_ns, readings, missing, answer)
    assert chosen == bank.ALL
    np.testing.assert_allclose(answer, twist, atol=0.01)


@pytest.mark.safety(
    "brakes act late",
    "the twist is 50 ms late",
    "the twist is compared with the state at its stamp; the result is propagated to the present",
    within=0.0,
)
def test_a_late_twist_is_compensated(drive: Drive) -> None:
    drive.run(180, late=5)  # 50 ms, in which 0.2 m/s are lost
    assert drive.error == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(
    ("fault", "size", "out"),
    [
        pytest.param(
            "twist", 0.5, bank.NO_VELOCITY,
            marks=pytest.mark.safety(
                RELEASED, "the velocity of the twist is wrong by 0.5 m/s",
                ISOLATED + "accelerometer and wheels", within=0.1,
            ),
        ),
        pytest.param(
            "rate", 0.3, bank.NO_RATE,
            marks=pytest.mark.safety(
                RELEASED, "the yaw rate of the twist is wrong by 0.3 rad/s",
                ISOLATED + "the gyro and the change of the velocity", within=0.1,
            ),
        ),
        ("rate", -0.5, bank.NO_RATE),
        ("vibration", 3.0, bank.NO_GYRO),  # an error with a mean of 0
        ("vibration", 1.0, bank.NO_GYRO),
        ("noise", 1.0, bank.NO_VELOCITY),
        pytest.param(
            "gyro", 0.3, bank.NO_GYRO,
            marks=pytest.mark.safety(
                RELEASED, "the gyro is wrong by 0.3 rad/s",
                ISOLATED + "the yaw rate of the twist and the change of its velocity",
                within=0.1,
            ),
        ),
        ("gyro", -0.5, bank.NO_GYRO),
        pytest.param(
            "force", 4.0, bank.NO_FORCE,
            marks=pytest.mark.safety(
                RELEASED, "the accelerometer is wrong by 4 m/s^2",
                ISOLATED + "twist and wheels", within=0.2,
            ),
        ),
    ],
)  # fmt: skip
def test_a_faulty_source_is_isolated(
    drive: Drive, fault: str, size: float, out: int, within: float
) -> None:
    drive.run(160, fault, size=size)
    assert drive.chosen[-1] == out
    assert drive.time_until(out) <= within
    assert drive.error == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("size", [0.3, -0.3])
def test_a_faulty_yaw_rate_of_the_twist_does_not_isolate_the_gyro(
    drive: Drive, size: float
) -> None:
    drive.run(150, "rate", 60, size)

    assert bank.NO_GYRO not in drive.chosen
    assert drive.time_until(bank.NO_RATE, 60) <= 0.02


def test_readings_that_repeat_do_not_isolate_the_velocity_of_the_twist(drive: Drive) -> None:
    """Encoders and gyro are stuck at readings that agree with each other."""
    drive.run(150, "gyro and encoders", 80)
    assert not set(drive.chosen) & {*bank.DEAD_RECKONING, bank.NO_ESTIMATE}
    assert drive.error[:2] == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("size", [0.2, -0.3])
def test_an_oscillating_error_of_the_yaw_rate_does_not_isolate_the_gyro_for_long(
    drive: Drive, size: float
) -> None:
    drive.run(150, "sine", 60, size)
    assert drive.chosen[-1] == bank.NO_RATE
    assert drive.error == pytest.approx(0.0, abs=0.01)


@pytest.mark.safety(
    RELEASED,
    "the twist is stuck, also if the sensor is read only every 40 ms",
    "fault isolation: braking does not change the twist",
    within=0.2,
)
@pytest.mark.parametrize("hold", [1, 4])
def test_a_twist_that_braking_does_not_change_is_isolated(
    drive: Drive, hold: int, within: float
) -> None:
    drive.run(115, "stuck", hold=hold)
    assert drive.chosen[-1] == bank.NO_TWIST
    assert set(drive.chosen[80 + round(within / STEP) :]) <= set(bank.DEAD_RECKONING)
    assert drive.error == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(("fault", "size"), [("twist", 3.0), ("gyro", 0.5), ("force", 6.0)])
def test_a_source_that_recovers_has_left_nothing_behind(
    drive: Drive, fault: str, size: float
) -> None:
    """Filters that used a faulty source are initialized from filters that did not use it."""
    drive.run(190, fault, onset=70, size=size, until=110)
    assert drive.chosen[-1] == bank.ALL
    errors = [a - drive.truth(i)[0] for i, a in enumerate(drive.answers) if i >= 130]
    assert np.max(np.abs(errors)) < 0.01


@pytest.mark.safety(
    RELEASED, "one faulty encoder, with an IMU",
    "gate: a wheel speed that contradicts the filters is rejected", within=0.0,
)  # fmt: skip
@pytest.mark.parametrize("onset", [0, 80])
@pytest.mark.parametrize("size", [20.0, -80.0])
def test_a_faulty_wheel_does_not_change_the_estimate(drive: Drive, onset: int, size: float) -> None:
    drive.run(160, "wheel", onset, size)
    assert set(bank.TWIST_FAULTS).isdisjoint(drive.chosen)
    assert drive.error == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("variance", np.linspace(2e-4, 1e-3, 17))
def test_a_twist_is_used_directly_if_it_is_more_accurate_at_base_link(
    mecanum: dict[str, WheelMount], variance: float
) -> None:
    """The filters have the variance at the IMU, which is 1.4 m from base_link here."""
    drive = Drive(mecanum, (1.0, -1.0))
    drive.variance = variance
    drive.run(100)
    at_base = np.array([[1.0, 0.0, -1.0], [0.0, 1.0, -1.0], [0.0, 0.0, 1.0]])
    estimated = np.diag(at_base @ drive.memory.covariance[bank.ALL, :3, :3] @ at_base.T)
    direct = drive.answers[-1] == drive.truth(99)[0]
    assert direct.tolist() == (variance < estimated).tolist()


@pytest.mark.parametrize("late", [0, 1, 5])
def test_a_known_age_of_the_twist_is_no_dispute(drive: Drive, late: int) -> None:
    drive.run(180, late=late)
    assert set(drive.chosen) == {bank.ALL}


@pytest.mark.parametrize("delay", [0.005, 0.05, 0.2])
def test_a_configured_delay_leaves_the_estimate_of_now(
    mecanum: dict[str, WheelMount], delay: float
) -> None:
    """The delay is half a step or more; until the first twist, the wheels measure the motion."""
    drive = Drive(mecanum, (0.5, -0.3), delay)
    drive.run(180)
    assert set(drive.chosen) == {bank.ALL}
    assert drive.error == pytest.approx(0.0, abs=0.01)


def test_a_faulty_gyro_is_isolated_beside_a_late_twist(
    mecanum: dict[str, WheelMount],
) -> None:
    drive = Drive(mecanum, delay=0.05)
    drive.run(160, "gyro", size=0.3)
    assert drive.chosen[-1] == bank.NO_GYRO
    assert drive.error == pytest.approx(0.0, abs=0.03)


def test_a_small_fault_of_the_accelerometer_does_not_bias_the_estimate(drive: Drive) -> None:
    """The fault is too small for isolation; the twist is used without the accelerometer."""
    drive.run(180, "force", size=0.8)
    assert drive.error == pytest.approx(0.0, abs=0.01)


def test_one_wheel_alone_isolates_nothing(drive: Drive) -> None:
    """The only rolling wheel has a faulty encoder; twist and IMU remain in use."""
    drive.run(180, "wheel", size=3.0)
    assert set(bank.TWIST_FAULTS).isdisjoint(drive.chosen)
    assert drive.error == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("size", [10.0, -10.0])
def test_without_an_imu_a_faulty_encoder_is_not_distinguished_from_a_faulty_twist(
    drive: Drive, size: float
) -> None:
    """The only rolling wheel contradicts the twist, so that the motion is unknown."""
    drive.imu_lost = 0
    drive.run(90, "wheel", onset=60, size=size)
    assert drive.time_until(bank.NO_ESTIMATE, onset=60) <= 0.1
    assert set(drive.chosen[70:]) == {bank.NO_ESTIMATE}


@pytest.mark.safety(
    RELEASED,
    "the IMU is lost after the velocity of the twist has been isolated",
    "fault isolation: no other source measures the motion, so all brakes act until the pedal is "
    "released",
    within=0.05,
)
@pytest.mark.parametrize("size", [0.3, 0.5, 1.0, -0.7])
def test_an_isolated_twist_is_not_fused_again_without_another_source(
    drive: Drive, size: float, within: float
) -> None:
    drive.imu_lost = 90
    drive.run(200, "twist", size=size)
    assert drive.chosen[drive.imu_lost - 1] == bank.NO_VELOCITY
    assert set(drive.chosen[drive.imu_lost + round(within / STEP) :]) == {bank.NO_ESTIMATE}


def test_a_release_of_the_pedal_resets_isolation(drive: Drive) -> None:
    drive.run(120, "twist", size=1.0)
    assert drive.chosen[-1] == bank.NO_VELOCITY
    inertial, speeds = np.zeros(3), np.zeros(4)
    answer = np.empty(3)
    estimate(
        drive.constants,
        drive.memory,
        120 * PERIOD_NS,
        bank.Readings(0.0, np.ones(4), inertial, speeds),
        TwistSample(0, np.zeros(3), np.zeros((3, 3)), MISSING),
        answer,
    )
    assert drive.memory.record[0]["best"] == bank.ALL


def test_a_wheel_that_spins_up_slowly_on_ice_does_not_mislead(
    mecanum: dict[str, WheelMount],
) -> None:
    drive = Drive(mecanum)
    radius = mecanum["front_left"].radius
    drive.run(170, "ice", onset=80, size=0.08 / radius)  # 8 m/s^2 at the rim
    for step in range(80, 170):
        truth = drive.truth(step)[0]
        assert np.hypot(*(drive.answers[step][:2] - truth[:2])) < 0.01
        assert np.hypot(*(drive.memory.state[bank.NO_TWIST, :2] - drive.truth(169)[0][:2])) < 0.1


def drive_and_brake(
    drive: Drive, twist: FloatArray, driven: FloatArray, braked: FloatArray, lag: int
) -> set[int]:
    """Return the hypotheses selected in a stop without an IMU, in which all wheels lock.

    Args:
        drive: the vehicle.
        twist: fault-free twist [m/s, m/s, rad/s].
        driven: twist at which the wheels roll until the pedal is pressed.
        braked: enables from then on, shape (N,).
        lag: number of steps for which the wheels stay locked.
    """
    found, answer, missing = set(), np.empty(3), np.full(3, np.nan)
    for step in range(PEDAL + lag):
        braking = step >= PEDAL
        enable = braked if step > PEDAL else np.ones(4)
        speeds = drive.kinematics.wheel_speeds(np.zeros(3) if step > PEDAL else driven)
        readings = bank.Readings(1.0 if braking else 0.0, enable, missing, speeds)
        now_ns = step * PERIOD_NS
        taken = TwistSample(now_ns, twist, 1e-6 * np.eye(3))
        found.add(estimate(drive.constants, drive.memory, now_ns, readings, taken, answer))
    return found


@pytest.mark.parametrize("released", [1, 2, 3])
def test_wheels_that_stay_locked_after_a_release_are_no_fault(
    mecanum: dict[str, WheelMount], released: int
) -> None:
    """The brakes release 0.18 s later than the configuration states."""
    drive, twist = Drive(mecanum), np.array([3.0, 0.0, 0.0])
    enable = np.where(np.arange(4) < released, 0.0, 1.0)
    assert drive_and_brake(drive, twist, twist, enable, 18) == {bank.ALL}
    assert np.max(drive.memory.faulty[bank.ALL]) < bank.FAULTY


def test_driven_wheels_that_slip_in_a_turn_are_no_fault(mecanum: dict[str, WheelMount]) -> None:
    """The vehicle has a sideslip of 7 deg, but its driven wheels turn as without sideslip."""
    twist, driven = np.array([8.0, -1.0, 0.5]), np.array([8.0, 0.0, 0.5])
    assert drive_and_brake(Drive(mecanum), twist, driven, np.ones(4), 20) == {bank.ALL}


@pytest.mark.safety(
    "the stop is longer or rotates more",
    "a fault that twist and IMU share",
    "fault isolation: the wheels contradict the estimate, and all brakes are on",
    within=0.25,
)
def test_wheels_contradict_a_fault_that_twist_and_imu_share(
    mecanum: dict[str, WheelMount], within: float
) -> None:
    """The vehicle moves at 8 m/s while twist and accelerometer report that it stops with 1 g."""
    drive = Drive(mecanum)
    constants, memory, answer = drive.constants, drive.memory, np.empty(3)
    errors = []
    for k in range(-PEDAL, round(0.5 / STEP)):
        time = max(k * STEP, 0.0)
        speeds = START * constants.n_x / constants.roll
        speeds[1:] *= 0.9 if k >= 0 else 1.0
        speeds *= 1.0 + 1e-6 * k  # real readings do not repeat
        stamp = (k + PEDAL) * PERIOD_NS
        force = np.array([0.0, -9.81 if k > 0 else 0.0, 0.0])
        readings = bank.Readings(float(k >= 0), np.array([0.0, 1.0, 1.0, 1.0]), force, speeds)
        twist = TwistSample(stamp, np.array([START - 9.81 * time, 0.0, 0.0]), 1e-6 * np.eye(3))
        found = estimate(constants, memory, stamp, readings, twist, answer)
        if time > within:
            errors.append(0.0 if found == bank.NO_ESTIMATE else abs(answer[0] - START))
    assert max(errors) < 0.01
