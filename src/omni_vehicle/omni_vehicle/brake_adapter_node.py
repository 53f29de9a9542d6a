"""ROS node that converts brake enables to commands for brakes or motor drives.

The README of this package describes the contract: topics, types, parameters and timeouts.
"""

import math
import time
from collections import Counter
from collections.abc import Sequence
from functools import partial
from itertools import compress
from typing import Any

import numpy as np
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64MultiArray

from omni_core import topics
from omni_core.brakes import BRAKES
from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_core.quantities import CONTROL_PERIOD, FloatArray
from omni_ros.messages import joint_state, to_nanoseconds
from omni_ros.parameters import declare_configuration
from omni_ros.process import run_process, spin_until_stopped
from omni_ros.publisher_guard import PublisherGuard
from omni_ros.qos import RECENT, advertise, subscribe
from omni_ros.status import ERROR, OK, Status, StatusReporter, steady_clock
from omni_vehicle import brake_adapter
from omni_vehicle.brake_adapter import BrakeAdapter, BrakeAdapterConfiguration, WheelDemand
from omni_vehicle.controller_switch import ControllerSwitch, SwitchConfiguration

_ARRAY, _BOOL = "std_msgs/msg/Float64MultiArray", "std_msgs/msg/Bool"
_PEDALS = {
    "joint_state": topics.PEDAL,
    "bool": topics.Topic("pedal_input", _BOOL, "user's node"),
    "float": topics.Topic("pedal_input", "std_msgs/msg/Float64", "user's node"),
    "twist": topics.cmd_vel(stamped=False),
    "twist_stamped": topics.cmd_vel(stamped=True),
}
_SHOWN = 12  # number of names in a message about joint_states


class TopicsConfiguration(Configuration):
    """Message types and timing of the topics that connect the brake adapter with the vehicle."""

    joints: tuple[str, ...] = parameter(())
    """Names of the joints on joint_states, in the order of the wheels; default: the wheel names"""
    output: str = parameter("array", choices=("array", "joint_state"))
    """Type of the commands: `array` for a Float64MultiArray to a forward_command_controller, or
    `joint_state` for a JointState with the commands in its field `effort`"""
    pedal: str = parameter("joint_state", choices=tuple(_PEDALS))
    """Source of the braking demand: `joint_state` for the topic brake/pedal; `bool` or `float` for
    the topic pedal_input; `twist` or `twist_stamped` for the topic cmd_vel, where a zero command
    brakes. Except with `joint_state`, this node publishes the demand on brake/pedal"""
    estop: bool = parameter(False)
    """Whether Bool messages on the topic estop are required; a message with the value true requests
    full braking"""
    pedal_timeout: float = parameter(0.1, unit="s", above=0.0, maximum=2.0)
    """Time without a demand, or without an emergency-stop message, after which all brakes are on"""
    period: float = parameter(CONTROL_PERIOD, unit="s", minimum=0.001, maximum=0.05)
    """Time between two commands"""


class BrakeAdapterNode(Node):
    """Commands the brakes of a vehicle at a fixed rate, even without any input."""

    def __init__(self) -> None:
        super().__init__("brake_adapter")
        self._configuration = declare_configuration(self, BrakeAdapterConfiguration)
        self._topics = given = declare_configuration(self, TopicsConfiguration)
        wheels = self._configuration.wheels
        if given.joints and len(given.joints) != len(wheels):
            raise ConfigurationError("joints", f"must be as many as the {len(wheels)} wheels")
        self._joints = given.joints or wheels
        self._adapter = BrakeAdapter(self._configuration)
        switched = declare_configuration(self, SwitchConfiguration)
        self._switch = ControllerSwitch(switched, self) if switched.drive_controller else None
        self._enable, self._speed, self._drive = (np.full(len(wheels), math.nan) for _ in "123")
        self._pedal = self._estop = math.nan
        self._unnamed = set(self._joints)  # joints that no message on joint_states has named yet
        self._named: dict[str, None] = {}  # first names of messages that did not name all joints
        self._received: dict[str, float] = {}
        self._enable_age = math.inf
        output = _ARRAY if given.output == "array" else topics.JOINT_STATE
        self._command = advertise(self, topics.Topic("commands", output, "brake_adapter"))
        self._wheel_states = advertise(self, topics.WHEEL_STATES)
        if given.pedal != "joint_state":
            self._pedal_output = advertise(self, topics.PEDAL)
        guarded = [subscribe(self, topics.ENABLE, self._on_enable, RECENT)]
        subscribe(self, topics.JOINT_STATES, self._on_joints, RECENT)
        drive = topics.Topic("drive_commands", _ARRAY, "user's node")
        subscribe(self, drive, self._on_drive, RECENT)
        pedal = subscribe(
            self, _PEDALS[given.pedal], self._on_pedal, RECENT, type_parameter="pedal"
        )
        if "twist" not in given.pedal:  # Nav2 has several publishers of velocity commands
            guarded.append(pedal)
        if given.estop:
            estop = topics.Topic("estop", _BOOL, "user's node")
            guarded.append(subscribe(self, estop, self._on_estop, RECENT))
        self._guard = PublisherGuard(self, guarded, (self._command,))
        self._status = StatusReporter(self, Status(ERROR, "no enables yet: all brakes on"))
        self._stepped = time.monotonic()
        self.create_timer(given.period, self._step, clock=steady_clock())

    def _on_enable(self, message: JointState) -> None:
        wheels = self._configuration.wheels
        self._enable = _column(message.effort, _rows(message.name), wheels)
        now_ns = self.get_clock().now().nanoseconds
        self._enable_age = 1e-9 * (now_ns - to_nanoseconds(message.header.stamp))
        self._received["enable"] = time.monotonic()

    def _on_joints(self, message: JointState) -> None:
        found = _rows(message.name)
        if not set(self._joints) <= found.keys():
            self._unnamed -= found.keys()
            self._named = dict.fromkeys([*self._named, *found][:_SHOWN])
            self._received["other joints"] = time.monotonic()
            return
        position, self._speed, effort = (
            _column(values, found, self._joints)
            for values in (message.position, message.velocity, message.effort)
        )
        self._received["joints"] = time.monotonic()
        states = joint_state(
            to_nanoseconds(message.header.stamp),
            self._configuration.wheels,
            position=position,
            velocity=self._speed,
            effort=effort,
        )
        self._wheel_states.publish(states)

    def _on_drive(self, message: Float64MultiArray) -> None:
        fits = len(message.data) == len(self._drive)
        if fits:
            self._drive = np.array(message.data)
        self._received["drive" if fits else "other drive commands"] = time.monotonic()

    def _on_pedal(self, message: Any) -> None:
        if isinstance(message, TwistStamped):
            message = message.twist
        if isinstance(message, JointState):
            self._pedal = float(message.position[0]) if message.position else math.nan
        elif isinstance(message, Twist):
            speeds = (message.linear.x, message.linear.y, message.angular.z)
            # A command that is not finite must not count as a demand to drive.
            self._pedal = float(not any(speeds) or not np.isfinite(speeds).all())
        else:
            self._pedal = float(message.data)
        self._received["pedal"] = time.monotonic()

    def _on_estop(self, message: Bool) -> None:
        self._estop = float(message.data)
        self._received["estop"] = time.monotonic()

    def _silent(self, name: str, timeout: float) -> bool:
        age = time.monotonic() - self._received.get(name, -math.inf)
        return brake_adapter.is_silent(age, timeout, self._topics.period)

    def _demand(self) -> tuple[WheelDemand, str]:
        """Return the inputs of the brake adapter, and a description of problems (empty if none).

        A pedal position or an enable that is missing, late or invalid is replaced by full braking.
        Missing wheel speeds are NaN. Missing commands for the drives are zero.
        """
        timeout, enable_timeout = self._topics.pedal_timeout, self._configuration.enable_timeout
        problems = []
        pedal, enable = self._pedal, self._enable
        if self._silent("pedal", timeout):
            pedal = 1.0
            problems.append("no braking demand: full demand")
        pedal = pedal if 0.0 <= pedal <= 1.0 else 1.0
        if self._topics.estop:
            silent = self._silent("estop", timeout)
            pedal = 1.0 if silent else max(pedal, self._estop)  # a request to brake has priority
            problems += ["no emergency stop signal: full demand"] if silent else []
        silent = self._silent("enable", enable_timeout)
        if silent or not -enable_timeout <= self._enable_age <= enable_timeout:
            enable = np.ones(len(enable))
            problems.append(f"{'no enables' if silent else 'enables are late'}: all brakes on")
            # Without enables all brakes act, and a missing pedal means full braking.
            pedal = 1.0
        elif not np.all((enable >= 0.0) & (enable <= 1.0)):
            problems.append("an enable is missing or outside [0, 1]: full demand for its wheel")
        misconnected = list(filter(None, [self._guard.second()]))
        if "other joints" in self._received and "joints" not in self._received:
            missing = [joint for joint in self._joints if joint in self._unnamed]
            wanted = ", ".join(missing) or "all joints in one message"
            misconnected.append(
                f"joint_states never named {wanted} exactly once, "
                f"only {', '.join(self._named) or 'nothing'}; correct the parameter joints"
            )
        if misconnected:
            problems += [f"all brakes on: {sentence}" for sentence in misconnected]
            pedal, enable = 1.0, np.ones(len(enable))
        speed = np.full(len(enable), math.nan) if self._silent("joints", timeout) else self._speed
        unknown = ~np.isfinite(speed)
        if np.any(unknown) and BRAKES[self._configuration.kind].is_drive:
            names = ", ".join(compress(self._configuration.wheels, unknown))
            problems.append(
                f"no speed of {names}: a torque drive cannot brake, a velocity drive brakes fully"
            )
        drive = np.zeros(len(enable)) if self._silent("drive", timeout) else self._drive
        if not self._silent("other drive commands", timeout):
            problems.append(f"drive_commands must contain {len(drive)} values, one for each wheel")
        return WheelDemand(pedal, enable, speed, drive), "; ".join(problems)

    def _step(self) -> None:
        now = time.monotonic()
        demand, problem = self._demand()
        if self._switch is not None:
            refused = self._switch.follow(demand.pedal > 0.0, now)
            problem = "; ".join(filter(None, [problem, refused]))
        stamp_ns = self.get_clock().now().nanoseconds
        if self._topics.pedal != "joint_state":
            position = np.array([demand.pedal])
            self._pedal_output.publish(joint_state(stamp_ns, ("brake_pedal",), position=position))
        command = self._adapter.step(demand, now - self._stepped)
        self._stepped = now
        if self._topics.output == "array":
            self._command.publish(Float64MultiArray(data=command.tolist()))
        else:
            self._command.publish(joint_state(stamp_ns, self._joints, effort=command))
        status = Status(ERROR if problem else OK, problem or "follows the enables")
        self._status.update(stamp_ns, problem, status)


def _rows(names: Sequence[str]) -> dict[str, int]:
    """Return the row of each name that occurs exactly once; a repeated name would be ambiguous."""
    counts = Counter(names)
    return {name: row for row, name in enumerate(names) if counts[name] == 1}


def _column(values: Sequence[float], rows: dict[str, int], names: Sequence[str]) -> FloatArray:
    """Return the value of each name, shape (N,).

    A missing value is NaN, which releases no brake.
    """
    found = (rows.get(name, len(values)) for name in names)
    return np.array([values[row] if row < len(values) else math.nan for row in found])


main = partial(run_process, BrakeAdapterNode, spin_until_stopped)


if __name__ == "__main__":
    raise SystemExit(main())
