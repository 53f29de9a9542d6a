"""Reception of a vehicle's signals during a commissioning drive, until its last stop ends."""

import time
from collections.abc import Sequence
from typing import Any

from rclpy.qos import QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

from omni_core import topics
from omni_core.configuration import ConfigurationError, WorkError
from omni_core.quantities import FloatArray
from omni_ros.messages import to_nanoseconds
from omni_ros.qos import BEST_EFFORT
from omni_runs.recorded_run import Stream
from omni_tools.commissioning.signals import TOPICS, Signals, motions_of, signals_of
from omni_tools.node_check.exchange_node import Partner, subscribe

# All messages are kept until they are taken, so that none is lost while a drive is evaluated.
_LOSSLESS = QoSProfile(history=QoSHistoryPolicy.KEEP_ALL, reliability=QoSReliabilityPolicy.RELIABLE)
_DISCOVERY = 0.1  # period at which topics with a new publisher are subscribed to [s]


def receive_drive(
    partner: Partner,
    wheels: Sequence[str],
    timeout: float,
    rest: float = 2.0,
    least: int = 100,
    imu_axes: FloatArray | None = None,
) -> Signals:
    """Return the signals of a commissioning drive as soon as the vehicle rests after a stop.

    Args:
        partner: node of this process, in the namespace of the vehicle.
        wheels: names of the wheels, in the order of the result's columns.
        timeout: limit on the time until the drive is complete [s].
        rest: duration at rest after which the last stop is complete [s].
        least: required number of messages on each required topic.
        imu_axes: as in `signals_of`.

    Raises:
        WorkError: wheel speeds or pedal are not published.
        ConfigurationError: the drive has other wheels or motions than expected, or wheel speeds are
            missing for too long.
    """
    seen: dict[str, list[tuple[int, Any]]] = {topic.name: [] for topic in TOPICS}
    unseen, deadline = list(TOPICS), time.monotonic() + timeout
    while True:
        until = time.monotonic() + rest
        while time.monotonic() < until:
            for topic in [topic for topic in unseen if partner.publishers(topic.name)]:
                qos = _LOSSLESS if all(partner.publishers(topic.name)) else BEST_EFFORT
                seen[topic.name] = subscribe(partner, topic, qos)
                unseen.remove(topic)
            partner.spin(time.monotonic() + _DISCOVERY)
        late = time.monotonic() > deadline
        needed = (topics.WHEEL_STATES.name, topics.PEDAL.name)
        missing = [name for name in needed if len(seen[name]) < least]
        if missing and late:
            raise WorkError(f"too few messages on {' and '.join(missing)} in {timeout:g} s")
        if missing:
            continue
        streams = {
            name: Stream.of((to_nanoseconds(m.header.stamp), m) for _, m in messages)
            for name, messages in seen.items()
        }
        signals = signals_of(streams, wheels, imu_axes)
        try:
            at_rest = len(signals.time) - motions_of(signals, wheels).stop.stop
        except ConfigurationError:
            if late:
                raise
            continue
        if late or at_rest * signals.period >= rest:
            return signals
