"""The second opinion on motions that are known in closed form."""

import math

import numpy as np
import pytest

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.observer import (
    ALL,
    NO_FORCE,
    NO_GYRO,
    NO_TWIST,
    NOBODY,
    Brakes,
    ObserverConstants,
    PassedTwist,
    Sensed,
    observe,
    observer_constants,
    observer_memory,
)
from omni_platform.geometry import PlatformGeometry, WheelMount
from omni_platform.kinematics import PlatformKinematics
from omni_platform.quantities import FloatArray

PERIOD_NS = 10_000_000
PEDAL, START, BRAKE, TURN = 50, 8.0, 4.0, 0.4  # step; [m/s], [m/s^2], [rad/s^2]


class Drive:
    """A vehicle that brakes along the x axis of the world while it begins to turn.

    Everybody tells the truth unless `lie` changes what is told from a step on; the first wheel
    rolls free while braking.
    """

    def __init__(
        self, wheels: dict[str, WheelMount], place: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        configuration = BrakeAssistConfiguration(wheels=wheels, imu_x=place[0], imu_y=place[1])
        self.constants: ObserverConstants = observer_constants(
            configuration, PlatformGeometry.from_wheels(wheels)
        )
        self.kinematics, self.place = PlatformKinematics(wheels), place
        self.memory = observer_memory(len(wheels))
        self.answers: list[FloatArray] = []
        self.chosen: list[int] = []

    def truth(self, step: float) -> tuple[FloatArray, float, float]:
        """Return the body twist, the yaw and the deceleration."""
        time = max(step - PEDAL, 0.0) * PERIOD_NS / 1e9
        speed, yaw = START - BRAKE * time, 0.5 * TURN * time**2
        rate = TURN * time
        twist = np.array([speed * math.cos(yaw), -speed * math.sin(yaw), rate])
        return twist, yaw, BRAKE if step > PEDAL else 0.0

    def inertial(self, step: int) -> FloatArray:
        """Return the yaw rate and the mean specific force of the period at the mounting."""
        velocity = []
        for k in (max(step - 1, 0), step):
            twist, yaw, _ = self.truth(k)
            u_x = twist[0] - twist[2] * self.place[1]
            u_y = twist[1] + twist[2] * self.place[0]
            c, s = math.cos(yaw), math.sin(yaw)
            velocity.append(np.array([c * u_x - s * u_y, s * u_x + c * u_y]))
        force = (velocity[1] - velocity[0]) * 1e9 / PERIOD_NS
        _, yaw, _ = self.truth(step - 0.5)
        c, s = math.cos(yaw), math.sin(yaw)
        rate = self.truth(step)[0][2]
        return np.array([rate, c * force[0] + s * force[1], c * force[1] - s * force[0]])

    def run(
        self, steps: int, lie: str = "", onset: int = 80, size: float = 0.0, late: int = 0
    ) -> None:
        """Run; `late` is the age of the twist in steps."""
        count = len(self.memory.rim)
        for step in range(steps):
            braking, told = step >= PEDAL, step >= onset
            twist, _, _ = self.truth(max(step - late, 0))
            inertial = self.inertial(step)
            speeds = self.kinematics.wheel_speeds(self.truth(step)[0])
            if told and lie == "twist":
                twist = twist + np.array([0.0, size, 0.0])
            if told and lie == "rate":
                twist = twist + np.array([0.0, 0.0, size])
            if told and lie == "gyro":
                inertial[0] += size
            if told and lie == "force":
                inertial[2] += size
            if told and lie == "wheel":
                speeds[0] += size
            heard = not (told and lie == "silence")
            enable = np.ones(count)
            if braking:
                enable[0] = 0.0
                speeds[1:] = 0.0
            if told and lie == "ice":
                speeds[0] = min(speeds[0], size * (step - onset))
            answer = np.full(3, np.nan)
            self.chosen.append(
                observe(
                    self.constants,
                    self.memory,
                    step * PERIOD_NS,
                    Brakes(braking, enable),
                    PassedTwist(heard, max(step - late, 0) * PERIOD_NS, twist, np.full(3, 1e-6)),
                    Sensed(inertial, speeds),
                    answer,
                )
            )
            self.answers.append(answer)

    @property
    def error(self) -> FloatArray:
        """What the last answer is wrong by."""
        return self.answers[-1] - self.truth(len(self.answers) - 1)[0]


@pytest.fixture(params=[(0.0, 0.0), (0.5, -0.3)])
def drive(mecanum: dict[str, WheelMount], request: pytest.FixtureRequest) -> Drive:
    return Drive(mecanum, request.param)


def test_honest_sensors_are_all_believed(drive: Drive) -> None:
    drive.run(200)
    assert set(drive.chosen) == {ALL}
    assert drive.error == pytest.approx(0.0, abs=0.02)


def test_the_motion_is_known_for_a_second_without_the_twist(drive: Drive) -> None:
    drive.run(180, "silence")
    assert NOBODY not in drive.chosen
    assert drive.error == pytest.approx(0.0, abs=0.05)


def test_a_late_twist_is_made_up_for(drive: Drive) -> None:
    drive.run(180, late=5)  # 50 ms, in which 0.2 m/s are lost
    assert drive.error == pytest.approx(0.0, abs=0.03)


@pytest.mark.parametrize(
    ("lie", "size", "out"),
    [
        ("twist", 1.0, NO_TWIST),
        ("rate", 0.3, NO_TWIST),
        ("rate", -0.5, NO_TWIST),
        ("gyro", 0.3, NO_GYRO),
        ("gyro", -0.5, NO_GYRO),
        ("force", 4.0, NO_FORCE),
    ],
)
def test_one_that_lies_is_left_out(drive: Drive, lie: str, size: float, out: int) -> None:
    drive.run(160, lie, size=size)
    assert drive.chosen[-1] == out
    assert drive.error == pytest.approx(0.0, abs=0.1)


def test_a_wheel_that_lies_moves_nobody(drive: Drive) -> None:
    drive.run(160, "wheel", size=20.0)
    assert drive.error == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("late", [0, 1, 5])
def test_a_known_age_of_the_twist_is_no_dispute(drive: Drive, late: int) -> None:
    drive.run(180, late=late)
    assert set(drive.chosen) == {ALL}


def test_an_accelerometer_that_lies_a_little_does_not_pull_the_answer_aside(drive: Drive) -> None:
    """Too little for a dispute: the twist is taken as it is while nobody explains it."""
    drive.run(180, "force", size=0.8)
    assert drive.error == pytest.approx(0.0, abs=0.05)


def test_one_wheel_alone_proves_nothing(drive: Drive) -> None:
    """The only wheel that rolls says what it wants: twist and IMU go on being heard."""
    drive.run(180, "wheel", size=3.0)
    assert NO_TWIST not in drive.chosen
    assert drive.error == pytest.approx(0.0, abs=0.05)


def test_a_release_of_the_pedal_forgives(drive: Drive) -> None:
    drive.run(120, "twist", size=1.0)
    assert drive.chosen[-1] == NO_TWIST
    inertial, speeds = np.zeros(3), np.zeros(4)
    answer = np.empty(3)
    observe(
        drive.constants,
        drive.memory,
        120 * PERIOD_NS,
        Brakes(False, np.ones(4)),
        PassedTwist(False, 0, np.zeros(3), np.zeros(3)),
        Sensed(inertial, speeds),
        answer,
    )
    assert drive.memory.belief[0] == ALL


def test_a_wheel_that_spins_up_slowly_on_ice_does_not_mislead(
    mecanum: dict[str, WheelMount],
) -> None:
    drive = Drive(mecanum)
    radius = mecanum["front_left"].radius
    drive.run(170, "ice", onset=80, size=0.08 / radius)  # 8 m/s^2 at the rim
    for step in range(80, 170):
        truth = drive.truth(step)[0]
        assert np.hypot(*(drive.answers[step][:2] - truth[:2])) < 0.1
        assert np.hypot(*(drive.memory.state[NO_TWIST, :2] - drive.truth(169)[0][:2])) < 0.1
