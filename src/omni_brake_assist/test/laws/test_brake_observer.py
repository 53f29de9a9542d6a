"""Detection of a brake without torque from the specific force, with known friction forces."""

import numpy as np
import pytest

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.laws import allocation
from omni_brake_assist.laws.allocation_state import Constants, Memory
from omni_brake_assist.laws.brake_observer import MASS, failed_brake, observe_brakes
from omni_brake_assist.laws.law import NO_WHEEL, Motion
from omni_core.brakes import PROPORTIONAL, BrakeConfiguration
from omni_core.geometry import PlatformGeometry, WheelMount
from omni_core.quantities import FloatArray

DT = 0.01
NOMINAL_MASS, FORCE, HUB = 1000.0, 1500.0, 5.0  # [kg], [N] for each wheel, [m/s]
BEFORE = 0.3  # time from the pedal to the failure [s]


@pytest.fixture
def law(mecanum: dict[str, WheelMount]) -> Constants:
    configuration = BrakeAssistConfiguration(
        wheels=mecanum,
        law="allocation",
        nominal_mass=NOMINAL_MASS,
        brake=BrakeConfiguration(kind=PROPORTIONAL, max_torque=1500.0),
    )
    return allocation.make_constants(configuration, PlatformGeometry.from_wheels(mecanum))


class Stop:
    """Stop straight ahead in which every brake exerts the same force, if it works."""

    def __init__(self, law: Constants, *, imu: bool = True) -> None:
        self.law, self.memory, self.imu = law, allocation.new_memory(law), imu
        self.error = 0.0  # of the accelerometer along x [m/s^2]
        self.push = 0.0, 0.0  # external force [N]
        self.slip = np.full(4, 0.1)  # of the wheels with a force
        self.held = 1  # steps for which a reading of the IMU is held
        body, wheel = self.memory.body[0], self.memory.wheel
        body["dt"], body["responded"] = DT, True
        body["inverse_mass"] = 1.0 / law.mass
        body["inverse_variance"] = (MASS / law.mass) ** 2
        wheel["known"], wheel["hub"], wheel["sign"] = True, HUB, np.sign(law.active[:, 0])

    def run(self, time: float, forces: FloatArray, intended: FloatArray, mass: float) -> float:
        """Return the time until a failure is detected, inf if there is none.

        Args:
            time: duration of the braking [s].
            forces: true friction forces [N], shape (4,); wheels without a force do not slip.
            intended: forces if all brakes work [N], shape (4,).
            mass: true mass of the vehicle [kg].
        """
        wheel, body = self.memory.wheel, self.memory.body[0]
        wheel["brake"], wheel["measured"] = intended, intended
        wheel["speed"] = wheel["last_speed"] = HUB * (1.0 - self.slip * (forces > 0.0))
        x, y = (self.push - (wheel["sign"] * forces) @ self.law.active[:, :2]) / mass
        body["twist"] = HUB - x * DT, -y * DT, 0.0
        x, y = (x + self.error, y) if self.imu else (np.nan, np.nan)
        line, speeds = (0.0, 1.0), wheel["speed"] / self.law.rim
        motion = Motion(False, DT, HUB, 0.0, 0.0, *line, 1.0, speeds, NO_WHEEL, x, y)
        for step in range(round(time / DT)):
            body["steps"] += 1
            motion = motion._replace(new_force=(step + 1) % self.held == 0)
            if observe_brakes(self.law, self.memory, motion):
                return (step + 1) * DT
        return np.inf


def found(memory: Memory) -> int:
    return int(failed_brake(memory, 1.0))


@pytest.mark.safety(
    "a brake does not follow its command",
    "a brake loses its torque in the middle of the stop, with an IMU and the law `allocation`; the "
    "mass is half, equal to or twice the nominal mass",
    "brake observer, on level ground: the specific force contradicts the brake force; then as in "
    "the next row",
    within=0.1,
)
@pytest.mark.parametrize("lost", range(4))
@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0])
def test_a_brake_that_loses_its_torque_is_found(
    law: Constants, lost: int, ratio: float, within: float
) -> None:
    stop, all_work = Stop(law), np.full(4, FORCE)
    assert stop.run(BEFORE, all_work, all_work, ratio * NOMINAL_MASS) == np.inf
    forces = np.where(np.arange(4) == lost, 0.0, FORCE)
    assert stop.run(1.0, forces, all_work, ratio * NOMINAL_MASS) <= within
    assert found(stop.memory) == lost


def test_a_reading_that_is_held_is_no_further_evidence(law: Constants) -> None:
    stop, all_work = Stop(law), np.full(4, FORCE)
    forces = np.where(np.arange(4) == 0, 0.0, FORCE)
    stop.run(BEFORE, all_work, all_work, NOMINAL_MASS)
    stop.held = 4  # an IMU with 25 Hz
    assert stop.run(0.07, forces, all_work, NOMINAL_MASS) == np.inf  # one reading
    assert stop.run(0.1, forces, all_work, NOMINAL_MASS) <= 0.1
    assert found(stop.memory) == 0


@pytest.mark.parametrize("ratio", [0.5, 0.8, 1.25, 2.0])
def test_an_error_that_all_forces_share_is_no_failure(law: Constants, ratio: float) -> None:
    forces = np.full(4, FORCE)
    assert Stop(law).run(3.0, forces, forces, ratio * NOMINAL_MASS) == np.inf


def test_ice_that_the_wheels_show_is_no_failure(law: Constants) -> None:
    """The wheels on ice slow down, so that their calculated friction forces decrease, too."""
    stop, grip = Stop(law), np.full(4, FORCE)
    stop.run(BEFORE, grip, grip, NOMINAL_MASS)
    iced = np.array([0.2, 0.2, 1.0, 1.0]) * FORCE
    assert stop.run(1.0, iced, iced, NOMINAL_MASS) == np.inf


@pytest.mark.parametrize("angle", np.arange(90.0, 361.0, 15.0))
def test_a_push_is_no_failure(law: Constants, angle: float) -> None:
    """A wheel rolls as if its brake had failed, but a push that equals this acts at 45 deg."""
    stop, all_work = Stop(law), np.full(4, FORCE)
    stop.slip[0] = 0.0
    stop.run(BEFORE, all_work, all_work, NOMINAL_MASS)
    direction = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    stop.push = FORCE * direction[0], FORCE * direction[1]
    assert stop.run(0.4, all_work, all_work, NOMINAL_MASS) == np.inf


def test_two_brakes_without_torque_are_not_attributed_to_one(law: Constants) -> None:
    """Only a certain wheel counts: the two hypotheses of one lost brake are equally likely."""
    stop, all_work = Stop(law), np.full(4, FORCE)
    stop.run(BEFORE, all_work, all_work, NOMINAL_MASS)
    assert stop.run(1.0, np.array([0.0, 0.0, FORCE, FORCE]), all_work, NOMINAL_MASS) == np.inf


def test_an_accelerometer_that_the_twist_contradicts_is_no_evidence(law: Constants) -> None:
    stop, all_work = Stop(law), np.full(4, FORCE)
    stop.run(BEFORE, all_work, all_work, NOMINAL_MASS)
    stop.error = 2.0
    assert stop.run(1.0, np.array([0.0, FORCE, FORCE, FORCE]), all_work, NOMINAL_MASS) == np.inf


def test_without_an_imu_there_is_no_evidence(law: Constants) -> None:
    stop, all_work = Stop(law, imu=False), np.full(4, FORCE)
    assert stop.run(1.0, np.array([0.0, FORCE, FORCE, FORCE]), all_work, NOMINAL_MASS) == np.inf


def test_the_evidence_ends_with_the_pedal(law: Constants) -> None:
    stop, all_work = Stop(law), np.full(4, FORCE)
    stop.run(BEFORE, all_work, all_work, NOMINAL_MASS)
    stop.run(1.0, np.array([0.0, FORCE, FORCE, FORCE]), all_work, NOMINAL_MASS)
    assert found(stop.memory) == 0
    assert failed_brake(stop.memory, 0.0) == NO_WHEEL
    assert found(stop.memory) == NO_WHEEL
