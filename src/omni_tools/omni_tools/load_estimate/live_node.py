"""Estimate of the load while the vehicle drives, published as diagnostics."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rclpy.qos import QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

from omni_core import topics
from omni_core.configuration import InputError, WorkError
from omni_ros.messages import diagnostics, to_nanoseconds
from omni_ros.qos import BEST_EFFORT, advertise
from omni_runs.recorded_run import Stream
from omni_tools.load_estimate.data import REQUIRED, drive_data
from omni_tools.load_estimate.estimate import LoadEstimate
from omni_tools.node_check.exchange_node import Partner, subscribe

# All messages are kept until they are taken, so that none is lost during an evaluation.
_LOSSLESS = QoSProfile(history=QoSHistoryPolicy.KEEP_ALL, reliability=QoSReliabilityPolicy.RELIABLE)
_PERIOD = 2.0  # time between two estimates [s]


def receive(
    partner: Partner,
    wheels: Sequence[str],
    twist_topic: str,
    duration: float,
    evaluate: Callable[[Any], LoadEstimate],
    state: Callable[[LoadEstimate], tuple[str, Mapping[str, str]]],
) -> LoadEstimate:
    """Return the estimate from all messages of a running vehicle; publish each earlier one.

    Args:
        partner: node of this process, in the namespace of the vehicle.
        wheels: names of the wheels.
        twist_topic: topic of the twist.
        duration: duration of the reception [s].
        evaluate: function that estimates the load from a drive.
        state: function that returns a warning, empty if there is none, and values to publish.

    Raises:
        WorkError: a topic has no messages.
        LoadDataError: the drive does not suffice for an estimate.
    """
    publisher = advertise(partner.node, topics.DIAGNOSTICS)
    chosen = (*REQUIRED, topics.WITH_TWIST[twist_topic])
    seen: dict[str, list[tuple[int, Any]]] = {}
    end = time.monotonic() + duration
    while True:
        for topic in chosen:
            if topic.name not in seen and (found := partner.publishers(topic.name)):
                qos = _LOSSLESS if all(found) else BEST_EFFORT
                seen[topic.name] = subscribe(partner, topic, qos)
        late = time.monotonic() >= end
        partner.spin(min(time.monotonic() + _PERIOD, max(end, time.monotonic() + 0.1)))
        silent = [topic.path for topic in chosen if not seen.get(topic.name)]
        if silent:
            if late:
                raise WorkError(f"no messages on {' and '.join(silent)} in {duration:g} s")
            continue
        streams = {
            name: Stream.of((to_nanoseconds(m.header.stamp), m) for _, m in messages)
            for name, messages in seen.items()
        }
        try:
            estimate = evaluate(drive_data(streams, wheels, twist_topic))
        except (InputError, WorkError):
            if late:
                raise
            continue
        warning, values = state(estimate)
        stamp_ns = partner.node.get_clock().now().nanoseconds
        words = warning or "no large rotation without assistance"
        publisher.publish(diagnostics(stamp_ns, "estimate_load", int(bool(warning)), words, values))
        if late:
            return estimate
