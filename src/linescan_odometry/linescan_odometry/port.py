"""Creation of an odometry estimator by its name, and grouping of its inputs, without ROS."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.measurements import TwistEstimate
from linescan_odometry.odometry import LineScanOdometry
from linescan_odometry.own_odometry import Odometry, own_odometry
from linescan_odometry.sideslip import SideslipEstimate, WheelSideslip
from omni_core.signals import Flow, LineBatch

_ANGLES = 16
"""Number of steering angles that are kept; a batch is between two of the newest ones"""
_PATIENCE_NS = 15_000_000
"""Time by which another sensor may be ahead before a group stops waiting [ns]."""


def make_odometry(name: str, configuration: OdometryConfiguration) -> Odometry:
    """Return the odometry estimator that a name selects.

    Args:
        name: ``module:Class`` or the name of an entry point; empty for the line-scan odometry.
        configuration: configuration of sensors and estimation.

    Raises:
        ConfigurationError: the class does not exist, or cannot be imported or created.
    """
    return own_odometry(name, configuration) if name else LineScanOdometry(configuration)


class BatchCollector:
    """Groups the batches of all sensors by stamp; the sensors may deliver in any order.

    Batches form a group if their stamps differ by at most `maximum_skew`. A group waits for a
    missing camera until another camera has delivered two batches that are newer than the group. The
    group is then returned without the missing camera, and later groups do not wait for this camera
    until it delivers again. A batch that arrives after its group was returned is dropped; the
    odometry detects the gap in the lines and restarts the chain of lines.

    Followers are flow sensors that do not start groups, because cameras or faster flow sensors do.
    If the next measurement of a follower is due before the end of a group, the group waits for this
    measurement as long as for a missing camera.
    """

    def __init__(
        self,
        sensors: Iterable[str],
        maximum_skew: float,
        followers: Mapping[str, float] | None = None,
    ) -> None:
        """Create a collector without batches.

        Args:
            sensors: names of the sensors; a group lists its batches in this order.
            maximum_skew: limit on the difference of stamps within a group [s].
            followers: rate of each follower [1/s], keyed by sensor name.
        """
        self._skew_ns = round(1e9 * maximum_skew)
        self._pending: dict[str, deque[LineBatch | Flow]] = {name: deque() for name in sensors}
        self._periods = {name: round(1e9 / rate) for name, rate in (followers or {}).items()}
        self._following: dict[str, deque[Flow]] = {name: deque() for name in self._periods}
        self._last_ns: dict[str, int] = {}  # newest stamp of each sensor
        self._silent: set[str] = set()
        self._handed_on_ns: int | None = None  # newest stamp of the groups returned so far

    @classmethod
    def of(cls, configuration: OdometryConfiguration) -> BatchCollector:
        """Return a collector for all sensors of a configuration.

        With cameras, all flow sensors are followers. Without cameras, the flow sensors with the
        highest rate start the groups, and the others are followers.
        """
        flows = configuration.flow_sensors
        leading = list(configuration.sensors)
        if not leading and flows:
            fastest = max(sensor.rate for sensor in flows.values())
            leading = [name for name, sensor in flows.items() if sensor.rate == fastest]
        followers = {name: s.rate for name, s in flows.items() if name not in leading}
        return cls(leading, configuration.skew, followers)

    def add(self, sensor: str, batch: LineBatch | Flow) -> list[dict[str, LineBatch | Flow]]:
        """Add a batch and return the groups that are now complete, oldest first.

        Args:
            sensor: name of a camera or flow sensor.
            batch: lines of a camera, or measurement of a flow sensor.

        Raises:
            KeyError: the sensor is unknown.
        """
        following = self._following.get(sensor)
        if following is not None and isinstance(batch, Flow):
            self._silent.discard(sensor)
            if batch.stamp_ns > self._last_ns.get(sensor, batch.stamp_ns - 1):
                self._last_ns[sensor] = batch.stamp_ns
                following.append(batch)
            return self._ready()
        queue = self._pending[sensor]
        if batch.stamp_ns <= self._last_ns.get(sensor, batch.stamp_ns - 1):
            self._start_anew()  # its stamp went back: the recording is played again
        self._last_ns[sensor] = batch.stamp_ns
        self._silent.discard(sensor)
        if self._handed_on_ns is not None and batch.stamp_ns <= self._handed_on_ns:
            return []
        queue.append(batch)
        return self._ready()

    def _ready(self) -> list[dict[str, LineBatch | Flow]]:
        ready = []
        while group := self._take_group():
            ready.append(group)
        return ready

    def _start_anew(self) -> None:
        for queue in self._pending.values():
            queue.clear()
        for follower in self._following.values():
            follower.clear()
        self._last_ns.clear()
        self._handed_on_ns = None

    def _take_group(self) -> dict[str, LineBatch | Flow]:
        """Return the oldest group if it is complete, otherwise an empty dictionary."""
        oldest = {name: queue[0] for name, queue in self._pending.items() if queue}
        awaited = self._pending.keys() - oldest.keys() - self._silent
        if not oldest:
            return {}
        until_ns = min(batch.stamp_ns for batch in oldest.values()) + self._skew_ns
        newest_ns = max(b.stamp_ns for b in oldest.values() if b.stamp_ns <= until_ns)
        from_ns = until_ns - 2 * self._skew_ns
        choices = {name: self._choice(name, from_ns, newest_ns, until_ns) for name in self._periods}
        awaited |= {
            name
            for name, period_ns in self._periods.items()
            # The follower's next measurement is due before the end of the group.
            if self._last_ns.get(name, from_ns - period_ns) + period_ns
            <= (until_ns if choices[name] is None else newest_ns)
        } - self._silent
        queues = [queue for queue in self._pending.values() if queue]
        ahead_ns = max(queue[-1].stamp_ns - queue[0].stamp_ns for queue in queues)
        if awaited and ahead_ns <= _PATIENCE_NS:
            return {}
        self._silent |= awaited
        group = {name: batch for name, batch in oldest.items() if batch.stamp_ns <= until_ns}
        for name in group:
            self._pending[name].popleft()
        self._handed_on_ns = max(batch.stamp_ns for batch in group.values())
        for name, chosen in choices.items():
            queue = self._following[name]
            while queue and queue[0].stamp_ns <= newest_ns:
                queue.popleft()
            if chosen is not None:
                group[name] = chosen
                if chosen.stamp_ns > newest_ns:
                    queue.popleft()
        return group

    def _choice(self, name: str, from_ns: int, newest_ns: int, until_ns: int) -> Flow | None:
        """Return the flow measurement that belongs to a group of batches; None if there is none.

        This is the last measurement up to the newest batch, or else the first later measurement.

        Args:
            name: name of the flow sensor.
            from_ns: earliest stamp of the measurement [ns].
            newest_ns: stamp of the newest batch of the group [ns].
            until_ns: latest stamp of the measurement [ns].
        """
        near = [flow for flow in self._following[name] if from_ns <= flow.stamp_ns <= until_ns]
        before = [flow for flow in near if flow.stamp_ns <= newest_ns]
        return before[-1] if before else (near[0] if near else None)


class OdometryPort:
    """Receives the inputs of the odometry one by one in any order, and yields the estimates.

    Args:
        own_odometry: name of a user's odometry class; empty for the line-scan odometry.
        configuration: configuration of sensors and estimation.
    """

    def __init__(self, own_odometry: str, configuration: OdometryConfiguration) -> None:
        self._odometry = make_odometry(own_odometry, configuration)
        self._collector = BatchCollector.of(configuration)
        self._groups: deque[dict[str, LineBatch | Flow]] = deque()
        self._steered = {name: s for name, s in configuration.sensors.items() if s.carrier}
        self._steering: deque[tuple[int, Mapping[str, float]]] = deque(maxlen=_ANGLES)
        self._wheels = {
            name: WheelSideslip(wheel, configuration.sensors[wheel.sensor])
            for name, wheel in configuration.sideslip.items()
        }

    def warm_up(self) -> None:
        """Compile or load all kernels of the estimator, so that the first update is fast."""
        self._odometry.warm_up()

    def steer(
        self, stamp_ns: int, angles: Mapping[str, float]
    ) -> Iterator[tuple[TwistEstimate, dict[str, SideslipEstimate]]]:
        """Process the steering angles at a stamp, and yield the estimates like `take`.

        Args:
            stamp_ns: stamp [ns].
            angles: steering angle of each wheel [rad]; ignored if no camera is on a carrier.
        """
        if not self._steered:
            return
        if self._steering and stamp_ns <= self._steering[-1][0]:
            self._steering.clear()  # the recording is played again
        self._steering.append((stamp_ns, angles))
        yield from self._finished()

    def take(
        self, sensor: str, batch: LineBatch | Flow
    ) -> Iterator[tuple[TwistEstimate, dict[str, SideslipEstimate]]]:
        """Process an input, and yield the estimates whose inputs are now complete.

        Args:
            sensor: name of a camera or flow sensor.
            batch: lines of a camera, or measurement of a flow sensor.

        Yields:
            Twist, and sideslip of each configured wheel, keyed by wheel name.
        """
        if isinstance(batch, LineBatch):
            self._odometry.match(sensor, batch)
        self._groups.extend(self._collector.add(sensor, batch))
        yield from self._finished()

    def _finished(self) -> Iterator[tuple[TwistEstimate, dict[str, SideslipEstimate]]]:
        """Yield the estimates of all groups for which the steering angles are known.

        If the angles are late, the newest group waits for them.
        """
        while self._groups:
            batches = self._groups[0]
            newest_ns = max(batch.stamp_ns for batch in batches.values())
            late = not self._steering or self._steering[-1][0] < newest_ns
            if self._steered and late and len(self._groups) < 2:
                return
            self._groups.popleft()
            steering = self._angles(batches) if self._steered else None
            estimate = self._odometry.update(batches, steering)
            angles = {name: wheel.measure_with(estimate) for name, wheel in self._wheels.items()}
            yield estimate, angles

    def _angles(self, batches: Mapping[str, LineBatch | Flow]) -> dict[str, tuple[float, float]]:
        """Return mean angle [rad] and rate [rad/s] of each carrier in the batch of its camera."""
        found = {}
        stamps = [stamp_ns for stamp_ns, _ in self._steering]
        for name, batch in batches.items():
            sensor = self._steered.get(name)
            if sensor is None or not isinstance(batch, LineBatch) or not stamps:
                continue
            duration_ns = 1e9 * max(len(batch.lines), 1) / sensor.line_rate
            ends = np.array([batch.stamp_ns - duration_ns, batch.stamp_ns])
            angle = [angles.get(sensor.carrier, math.nan) for _, angles in self._steering]
            first, last = np.interp(ends, stamps, angle)
            if ends[1] <= stamps[-1] and math.isfinite(first + last):
                found[sensor.carrier] = 0.5 * (first + last), 1e9 * (last - first) / duration_ns
        return found
