"""Driver node: receives the inputs of a page or `cmd_vel`, and publishes the driver's demands.

The README of this package describes the contract: topics, parameters and timeouts.
"""

import asyncio
import dataclasses
import math
import os
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from omni_core import topics
from omni_core.configuration import (
    Configuration,
    ConfigurationError,
    parameter,
    section,
    to_mapping,
)
from omni_core.geometry import WheelMount
from omni_ros import parameters, process, qos
from omni_ros.environment import REPORT_VARIABLE, report
from omni_ros.messages import joint_state, planar_pose_of, planar_twist, to_nanoseconds
from omni_sim.ground.configuration import FrictionPatch
from omni_tools.drive.confirmed_call import ConfirmedCall
from omni_tools.drive.demand_source import DemandSource
from omni_tools.drive.placement import was_placed
from omni_tools.drive.server import Demand, DriveServer

_ASSISTANT = "brake_assist"  # in the namespace of this node
_SWITCH = "enabled"
_RESET = "simulator/reset"
# Time for which poses are kept, because a stop begins at the pose with the stamp of the pedal [ns].
_KEPT_NS = 500_000_000
_DRIVER_COMMAND = topics.Topic("driver/cmd_vel", topics.TWIST_STAMPED, "driver")
_PARAMETER_EVENTS = topics.Topic(
    "parameter_events", "rcl_interfaces/msg/ParameterEvent", "every node", shared=True
)


class Choice(Configuration):
    """Items that the page offers for one kind of choice, such as vehicles or grounds."""

    chosen: str = parameter()
    """Name of the item that is in use"""
    names: tuple[str, ...] = parameter()
    """Names of all items that the page offers"""


class DriverConfiguration(Configuration):
    """Parameters of the driver node."""

    wheels: Mapping[str, WheelMount] = parameter()
    """Wheels of the platform, keyed by name; the page draws them"""
    chassis_length: float = parameter(unit="m", above=0.0, maximum=100.0)
    """Length of the platform"""
    chassis_width: float = parameter(unit="m", above=0.0, maximum=100.0)
    """Width of the platform"""
    chassis_x: float = parameter(0.0, unit="m", minimum=-100.0, maximum=100.0)
    """Center of the platform, forward of base_link"""
    chassis_y: float = parameter(0.0, unit="m", minimum=-100.0, maximum=100.0)
    """Center of the platform, left of base_link"""
    patches: Mapping[str, FrictionPatch] = section(dict)
    """Patches of the ground that the page draws, keyed by name"""
    choices: Mapping[str, Choice] = section(dict)
    """Choices that the page offers, keyed by kind"""
    remark: str = parameter("")
    """Sentence that the page shows at the choices"""
    assist: bool = parameter(True)
    """Whether the brake assistant is switched on at the start"""
    max_speed: float = parameter(5.0, unit="m/s", above=0.0, maximum=50.0)
    """Speed at full deflection of the stick"""
    max_yaw_rate: float = parameter(1.5, unit="rad/s", above=0.0, maximum=12.0)
    """Yaw rate at full deflection of the stick"""
    page_timeout: float = parameter(0.3, unit="s", above=0.0, maximum=5.0)
    """Time without a message from the open page after which the vehicle brakes fully"""
    demand_period: float = parameter(0.02, unit="s", above=0.0, maximum=0.1)
    """Time between two published demands"""
    state_period: float = parameter(0.033, unit="s", above=0.0, maximum=1.0)
    """Time between two updates of the vehicle's state on the page"""
    command_timeout: float = parameter(1.0, unit="s", above=0.0, maximum=5.0)
    """Time after which the last cmd_vel is ignored; must be longer than the repeat period of a
    keyboard"""
    stamped_cmd_vel: bool = parameter(True)
    """Whether cmd_vel has the type TwistStamped; otherwise the type is Twist"""
    host: str = parameter("127.0.0.1")
    """IP address of this machine at which the page is served"""
    port: int = parameter(0, minimum=0, maximum=65535)
    """TCP port of the page; 0 for any free port"""
    token: str = parameter("")
    """Token in the page's address; empty for a random token"""


class DriverNode(Node):
    """Publishes the driver's demands, and shows the motion of the vehicle on the page."""

    def __init__(self) -> None:
        super().__init__("driver")
        configuration = parameters.declare_configuration(self, DriverConfiguration)
        self.configuration = configuration
        self._wheels = tuple(configuration.wheels)
        self.source = DemandSource(configuration.page_timeout, configuration.command_timeout)
        speed = configuration.max_speed
        self._choices = configuration.choices
        choices = {kind: dataclasses.asdict(one) for kind, one in self._choices.items()}
        try:
            self.server = DriveServer(
                self.source,
                largest=(speed, speed, configuration.max_yaw_rate),
                greeting={
                    "vehicle": _drawing(configuration),
                    "choices": choices,
                    "remark": configuration.remark,
                },
                receive=self._receive,
                token=configuration.token,
                clock=time.monotonic,
                address=(configuration.host, configuration.port),
            )
        except OSError as error:
            raise ConfigurationError(
                "port", f"cannot be used at {configuration.host}: {error.strerror}"
            ) from None
        self.state: dict[str, Any] = {"assist": configuration.assist, "reset": None, "placed": 0}
        self._pedal = qos.advertise(self, topics.DRIVER_PEDAL)
        self._command = qos.advertise(self, _DRIVER_COMMAND)
        self._assistant = f"{self.get_namespace().rstrip('/')}/{_ASSISTANT}"
        self._assist = ConfirmedCall(
            self.create_client(SetParameters, f"{_ASSISTANT}/set_parameters"),
            _switch_request,
            lambda reply: all(result.successful for result in reply.results),
            partial(self.state.__setitem__, "assist"),
        )
        self._reset = ConfirmedCall(
            self.create_client(Trigger, _RESET),
            lambda _: Trigger.Request(),
            lambda reply: reply.success,
            partial(self.state.__setitem__, "reset"),
        )
        self.received = 0
        command = topics.cmd_vel(stamped=configuration.stamped_cmd_vel)
        self._receive_from(command, self._on_command, "stamped_cmd_vel")
        self._receive_from(topics.GROUND_TRUTH, self._on_truth)
        self._receive_from(topics.PEDAL, self._on_pedal)
        self._receive_from(topics.ENABLE, partial(self._on_wheels, "enable", "effort"))
        self._receive_from(topics.SLIDING, partial(self._on_wheels, "error", "velocity"))
        self._receive_from(topics.DIAGNOSTICS, self._on_diagnostics)
        self._receive_from(_PARAMETER_EVENTS, self._on_parameters)
        self._stamp_ns = 0
        self._poses: deque[tuple[int, list[float], list[float]]] = deque()
        self._pedal_down_ns: int | None = None

    def _receive_from(
        self, topic: topics.Topic, take: Callable[[Any], None], type_parameter: str = ""
    ) -> None:
        def on_message(message: Any) -> None:
            self.received += 1
            take(message)

        qos.subscribe(self, topic, on_message, type_parameter=type_parameter)

    def publish_demand(self) -> None:
        """Publish the present demand of the driver."""
        now = time.monotonic()
        self._assist.advance(now)
        self._reset.advance(now)
        self.state["switching"] = self._assist.wanted is not None
        demand = self.source.demand(now)
        self.state["source"] = demand.source
        pedal = joint_state(self._stamp_ns, ("brake_pedal",), position=np.array([demand.pedal]))
        self._command.publish(planar_twist(self._stamp_ns, np.array(demand.twist)))
        self._pedal.publish(pedal)

    def _receive(self, demand: Demand) -> None:
        # The page repeats a request until the state confirms it.
        switches = self._assist.wanted is not None or demand.assist != self.state["assist"]
        if demand.assist is not None and switches:
            self._assist.wanted = demand.assist
        if demand.reset is not None and demand.reset != self.state["reset"]:
            self._reset.wanted = demand.reset
        kind, name = demand.choose or ("", "")
        # `omni drive` restarts the nodes with the choice; names that were not offered are ignored.
        if kind in self._choices and name in self._choices[kind].names:
            report({"choose": {kind: name}})

    def _on_command(self, message: TwistStamped | Twist) -> None:
        twist = message.twist if isinstance(message, TwistStamped) else message
        values = (twist.linear.x, twist.linear.y, twist.angular.z)
        self.source.take_command(values, time.monotonic())

    def _on_truth(self, message: Odometry) -> None:
        self._stamp_ns = to_nanoseconds(message.header.stamp)
        twist = message.twist.twist
        self.state["time"] = self._stamp_ns / 1e9
        self.state["pose"] = planar_pose_of(message.pose.pose).tolist()
        self.state["twist"] = [twist.linear.x, twist.linear.y, twist.angular.z]
        motion = (self._stamp_ns, self.state["pose"], self.state["twist"])
        self.state["placed"] += bool(self._poses) and was_placed(self._poses[-1], motion)
        self._poses.append(motion)
        while abs(self._stamp_ns - self._poses[0][0]) > _KEPT_NS:
            self._poses.popleft()
        self._note_start()

    def _on_pedal(self, message: JointState) -> None:
        before, pedal = self.state.get("pedal", 0.0), float(message.position[0])
        if pedal > 0.0 and not before > 0.0:
            self._pedal_down_ns = to_nanoseconds(message.header.stamp)
            self._note_start()
        self.state["pedal"] = pedal

    def _note_start(self) -> None:
        """Store the vehicle's pose and speed at the time when the brake pedal was pressed."""
        for stamp_ns, pose, twist in self._poses:
            if stamp_ns == self._pedal_down_ns:
                start = {"time": stamp_ns / 1e9, "pose": pose, "speed": math.hypot(*twist[:2])}
                self.state["start"], self._pedal_down_ns = start, None

    def _on_wheels(self, key: str, field: str, message: JointState) -> None:
        found = dict(zip(message.name, getattr(message, field), strict=False))
        self.state[key] = [float(found.get(name, 0.0)) for name in self._wheels]

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self._assistant.removeprefix("/"):
                self.state["assist_state"] = next(
                    (entry.value for entry in status.values if entry.key == "state"), ""
                )
                self.state["assist_reason"] = status.message

    def _on_parameters(self, message: ParameterEvent) -> None:
        if message.node == self._assistant:
            for given in message.changed_parameters:
                if given.name == _SWITCH:
                    self.state["assist"] = given.value.bool_value


def _switch_request(enabled: bool) -> SetParameters.Request:
    given = Parameter(_SWITCH, value=enabled).to_parameter_msg()
    return SetParameters.Request(parameters=[given])


def _drawing(configuration: DriverConfiguration) -> dict[str, Any]:
    """Return the data with which the page draws the vehicle."""
    tree = to_mapping(configuration)
    named = {
        kind: [part | {"name": name.replace("_", " ")} for name, part in tree[kind].items()]
        for kind in ("patches", "wheels")
    }
    size = {name: tree[f"chassis_{name}"] for name in ("length", "width", "x", "y")}
    return {**size, **named}


def _take_in(node: DriverNode, spinner: process.Spinner) -> None:
    """Run the callbacks of all received messages; a single `spin_once` runs only one callback."""
    before = -1
    while node.received != before:
        before = node.received
        spinner.spin_once(0.0)


async def _drive(node: DriverNode, spinner: process.Spinner) -> None:
    async with node.server.running():
        report({"url": node.server.url})
        if REPORT_VARIABLE not in os.environ:  # no process reads reports, as under ros2 launch
            node.get_logger().info(f"the page is at {node.server.url}")
        demand_due = state_due = 0.0
        while not spinner.stop:
            _take_in(node, spinner)
            now = time.monotonic()
            if now >= demand_due:
                node.publish_demand()
                demand_due = now + node.configuration.demand_period
            if now >= state_due:
                node.server.show(node.state)
                state_due = now + node.configuration.state_period
            await asyncio.sleep(0.005)


def drive(node: DriverNode, spinner: process.Spinner) -> None:
    """Serve the page and publish the demands until a signal requests shutdown."""
    asyncio.run(_drive(node, spinner))


main = partial(process.run_process, DriverNode, drive)


if __name__ == "__main__":
    raise SystemExit(main())
