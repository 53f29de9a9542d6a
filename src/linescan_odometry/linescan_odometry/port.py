"""Odometries by name, and the grouping of their inputs, as in the node but without topics."""

from collections.abc import Iterator, Mapping
from typing import Any, Protocol

from linescan_odometry.batching import BatchCollector
from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.measurements import TwistEstimate
from linescan_odometry.odometry import LineScanOdometry
from linescan_odometry.sideslip.angle import SideslipEstimate
from linescan_odometry.sideslip.meter import SideslipMonitor
from omni_platform.plugins import load_class, make_part
from omni_platform.signals import Flow, LineBatch, TwistSample

ODOMETRY_GROUP = "linescan_odometry.odometries"
"""Group of entry points under which an installed package offers odometries by name."""


class Odometry(Protocol):
    """Interface of an odometry."""

    def match(self, name: str, batch: LineBatch) -> None:
        """Start to process a batch early; the next `update` receives the same batch."""

    def update(self, batches: Mapping[str, LineBatch | Flow]) -> TwistEstimate:
        """Estimate the twist from the batches since the last update."""

    def warm_up(self) -> None:
        """Compile or load all kernels."""


class _OwnOdometry:
    """Wrapper of a user's odometry class, of which only ``update`` is required."""

    def __init__(self, odometry: Any) -> None:
        self._odometry = odometry

    def match(self, name: str, batch: LineBatch) -> None:
        pass

    def update(self, batches: Mapping[str, LineBatch | Flow]) -> TwistEstimate:
        twist: TwistSample = self._odometry.update(batches)
        return TwistEstimate(twist.stamp_ns, twist.value, twist.covariance, True, {})

    def warm_up(self) -> None:
        pass


def make_odometry(name: str, configuration: OdometryConfiguration) -> Odometry:
    """Create an odometry.

    Args:
        name: ``module:Class`` or the name of an entry point; empty for the line-scan odometry.
        configuration: configuration of sensors and estimation.

    Raises:
        ConfigurationError: the class does not exist, or cannot be imported or created.
    """
    if not name:
        return LineScanOdometry(configuration)
    cls = load_class("feedback", name, (), ODOMETRY_GROUP, "update")
    return _OwnOdometry(make_part("feedback", name, cls, configuration))


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
