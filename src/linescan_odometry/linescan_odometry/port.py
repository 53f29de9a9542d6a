"""Odometry with the grouping of its inputs, as in the node, but without topics."""

from collections.abc import Iterator

from linescan_odometry.batching import BatchCollector
from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.measurements import TwistEstimate
from linescan_odometry.registry import make_odometry
from linescan_odometry.sideslip.angle import SideslipEstimate
from linescan_odometry.sideslip.meter import SideslipMonitor
from omni_platform.signals import Flow, LineBatch


class OdometryPort:
    """Takes the inputs of the odometry one by one, in any order of the sensors.

    Args:
        own_odometry: name of a user's odometry class; empty for the line-scan odometry.
        configuration: configuration of sensors and estimation.
    """

    def __init__(self, own_odometry: str, configuration: OdometryConfiguration) -> None:
        self._odometry = make_odometry(own_odometry, configuration)
        self._collector = BatchCollector.of(configuration)
        self._sideslip = SideslipMonitor(configuration)

    def warm_up(self) -> None:
        """Compile or load all kernels."""
        self._odometry.warm_up()

    def take(
        self, sensor: str, batch: LineBatch | Flow
    ) -> Iterator[tuple[TwistEstimate, dict[str, SideslipEstimate]]]:
        """Process an input; yield each estimate that is now complete, with the wheels' sideslip."""
        if isinstance(batch, LineBatch):
            self._odometry.match(sensor, batch)
        for batches in self._collector.add(sensor, batch):
            estimate = self._odometry.update(batches)
            yield estimate, self._sideslip.measure(estimate)
