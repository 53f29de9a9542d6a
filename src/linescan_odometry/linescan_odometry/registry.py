"""Creation of the line-scan odometry, or of a user's odometry by name."""

from collections.abc import Mapping
from typing import Any, Protocol

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.measurements import TwistEstimate
from linescan_odometry.odometry import LineScanOdometry
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
