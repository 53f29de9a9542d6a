"""Test of a simulator with valid and invalid enables, based on the resulting brake torques."""

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState

from omni_core import topics
from omni_core.quantities import SECOND_NS
from omni_ros import messages, qos
from omni_tools.node_check.contract import CONTRACT
from omni_tools.node_check.exchange_node import Partner, Received, subscribe

_PHASE_NS = SECOND_NS // 5
_SETTLING_NS = SECOND_NS // 10  # time in which the brakes follow the enables
_FIRST_WHEEL = (1.0, 0.0, math.nan)
"""Brake enable of the first wheel in each phase of the test after the pedal is pressed."""


class Enables:
    """Sends brake enables to a simulator and checks the resulting brake torques.

    After the pedal is pressed, the test has four phases: all brakes are on, the first brake is
    released, the enable of the first brake is NaN, and all brakes are on again.
    """

    def __init__(self, node: Node, wheels: Sequence[str]) -> None:
        self._wheels = wheels
        self._braking_ns: int | None = None
        self._publisher = node.create_publisher(JointState, topics.ENABLE.path, qos.RELIABLE)
        node.create_subscription(JointState, topics.PEDAL.path, self._answer, qos.RELIABLE)

    def watch(
        self, partner: Partner, duration: float, alive: Callable[[], bool]
    ) -> dict[str, Received]:
        """Receive messages until the simulator ends; return them, keyed by topic.

        The entry ``twist`` contains the messages of the odometry; if there are none, those of the
        velocity sensor; if there are none either, those of the front camera.

        Args:
            partner: node of this process, which receives the messages.
            duration: time after which the reception ends in any case [s].
            alive: function that returns whether the simulator's process still runs.
        """
        watched = {
            "clock": topics.CLOCK,
            "wheel_states": topics.WHEEL_STATES,
            "pedal": topics.PEDAL,
            "imu": topics.IMU,
            "twist": topics.TWIST,
            "velocity_sensor": topics.VELOCITY_SENSOR,
            "lines": topics.lines("front"),
        }
        seen = {}
        for key, topic in watched.items():
            publishers = partner.publishers(topic.path)
            profile = qos.RELIABLE if all(publishers) else qos.BEST_EFFORT
            seen[key] = Received(subscribe(partner, topic, profile), publishers)
        last_gap = time.monotonic() + duration - CONTRACT.longest_gap
        while alive() and (now := time.monotonic()) < last_gap:
            partner.spin(min(last_gap, now + 0.1))
        before = {key: len(received.messages) for key, received in seen.items()}
        partner.spin(time.monotonic() + CONTRACT.longest_gap)
        for key, topic in watched.items():
            publishers = partner.publishers(topic.path)
            if seen[key].messages and publishers and alive():  # an ended simulator is not silent
                seen[key].publishers = publishers
                seen[key].silent = len(seen[key].messages) == before[key]
        sources = [seen.pop(key) for key in ("twist", "velocity_sensor", "lines")]
        seen["twist"] = next((source for source in sources if source.messages), sources[0])
        return seen

    def breaches(self, seen: Mapping[str, Received]) -> Iterator[str]:
        """Yield violations of the contract by the brake torques on `wheel_states`."""
        if self._braking_ns is None:
            yield "brake/pedal stayed 0: press the pedal during the check of the enables"
            return
        torques: dict[int, list[float]] = {}
        for _, message in seen["wheel_states"].messages:
            since = messages.to_nanoseconds(message.header.stamp) - self._braking_ns
            first = dict(zip(message.name, message.effort, strict=False)).get(self._wheels[0])
            if since >= 0 and since % _PHASE_NS >= _SETTLING_NS and first is not None:
                torques.setdefault(since // _PHASE_NS, []).append(abs(first))
        if 0 not in torques:
            yield "wheel_states: effort must contain the torque of each brake [N m]"
            return
        braked = np.median(torques[0])
        if not braked > 0.0:
            yield "a wheel with enable 1 is not braked while the pedal is down"
        elif np.median(torques.get(1, [0.0])) > 0.1 * braked:
            yield "a wheel with enable 0 is still braked"
        elif np.median(torques.get(2, [braked])) <= 0.1 * braked:
            yield "an enable that is not a number releases a brake; it must apply it"

    def _answer(self, message: JointState) -> None:
        stamp = messages.to_nanoseconds(message.header.stamp)
        if self._braking_ns is None and message.position and message.position[0] > 0.0:
            self._braking_ns = stamp
        values = np.ones(len(self._wheels))
        if self._braking_ns is not None:
            phase = (stamp - self._braking_ns) // _PHASE_NS
            values[0] = _FIRST_WHEEL[phase] if 0 <= phase < len(_FIRST_WHEEL) else 1.0
        self._publisher.publish(messages.joint_state(stamp, self._wheels, effort=values))
