"""ROS node of an optical-flow chip: reads its registers and publishes twists.

The README of this package describes the contract: topics, types, parameters and timeouts.
"""

import math
import time
from functools import partial

import numpy as np
from geometry_msgs.msg import TwistWithCovarianceStamped
from rclpy.node import Node

from omni_core import topics
from omni_core.configuration import Configuration, parameter
from omni_core.signals import UNMEASURED_VARIANCE
from omni_ros.messages import planar_twist_with_covariance
from omni_ros.parameters import declare_configuration
from omni_ros.process import run_process, spin_until_stopped
from omni_ros.qos import advertise
from omni_ros.status import ERROR, OK, WARN, Status, StatusReporter, steady_clock
from omni_vehicle import flow_chips


class FlowNodeConfiguration(Configuration):
    """Name of the flow sensor, and periods with which the node reads and reopens it."""

    sensor: str = parameter("flow")
    """Name of the sensor, as in the odometry's parameter flow_sensors"""
    period: float = parameter(0.0, unit="s", minimum=0.0, maximum=0.05)
    """Time between two readings; 0 for 10 ms with an OTOS, and for a quarter of the time between
    two images with other chips"""
    retry_period: float = parameter(1.0, unit="s", above=0.0, maximum=3600.0)
    """Time between two attempts to open the chip"""


class FlowSensorNode(Node):
    """Reads an optical-flow chip at a fixed rate, reopens it on failure, and publishes readings."""

    def __init__(self) -> None:
        super().__init__("flow_sensor")
        self._configuration = declare_configuration(self, flow_chips.FlowChipConfiguration)
        node = declare_configuration(self, FlowNodeConfiguration)
        self._frame, self._retry_period = node.sensor, node.retry_period
        chip = self._configuration
        of_chip = 0.01 if chip.chip == flow_chips.OTOS else 0.25 / chip.image_rate
        self._chip: flow_chips.FlowChip | None = None
        self._attempted = -math.inf
        self._twist = advertise(self, topics.flow(node.sensor))
        self._status = StatusReporter(self, Status(ERROR, "no reading yet"))
        self._step()  # outside of a callback, so that a missing library prevents the start
        self.create_timer(node.period or of_chip, self._step, clock=steady_clock())

    def _step(self) -> None:
        now = time.monotonic()
        stamp_ns = self.get_clock().now().nanoseconds
        try:
            if self._chip is None:
                if now - self._attempted < self._retry_period:
                    return
                self._attempted = now
                self._chip = flow_chips.open_chip(self._configuration)
            sample = self._chip.read(time.monotonic())
        except flow_chips.FlowChipError as error:
            # Nothing is published, so that subscribers apply all brakes after their timeout.
            self._chip = None
            self._status.update(stamp_ns, "lost", Status(ERROR, f"{error}; trying again"))
            return
        if sample is None:
            return
        self._twist.publish(_message(stamp_ns, self._frame, sample))
        values = {"sensor": self._frame}
        if isinstance(self._chip, flow_chips.CountingChip):
            values["counts"] = " ".join(map(str, self._chip.counts))
        words = sample.problem or "measures"
        level = WARN if sample.problem else OK
        self._status.update(stamp_ns, bool(sample.problem), Status(level, words, values))


def _message(
    stamp_ns: int, frame: str, sample: flow_chips.FlowSample
) -> TwistWithCovarianceStamped:
    measured = np.isfinite(sample.velocity) & np.isfinite(sample.deviation)
    velocity = np.where(measured, sample.velocity, 0.0)
    variance = np.where(measured, sample.deviation**2, UNMEASURED_VARIANCE)
    message = planar_twist_with_covariance(stamp_ns, velocity, np.diag(variance))
    message.header.frame_id = frame
    return message


main = partial(run_process, FlowSensorNode, spin_until_stopped)


if __name__ == "__main__":
    raise SystemExit(main())
