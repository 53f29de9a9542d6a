"""Interface of an odometry estimator, and import of the user's own."""

from collections.abc import Mapping
from typing import Any, Protocol

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.measurements import TwistEstimate
from omni_core.plugins import load_class, make_part
from omni_core.signals import Flow, LineBatch, TwistSample

ODOMETRY_GROUP = "linescan_odometry.odometries"
"""Group of entry points in which an installed package registers odometry classes by name."""


Steering = Mapping[str, tuple[float, float]]


class Odometry(Protocol):
    """Interface of an odometry estimator."""

    def match(self, name: str, batch: LineBatch) -> None:
        """Start to process a batch of one camera; the next `update` receives the same batch."""

    def update(
        self, batches: Mapping[str, LineBatch | Flow], steering: Steering | None = None
    ) -> TwistEstimate:
        """Return the twist estimated from the measurements since the last update.

        `steering` is given only if cameras are on steered carriers: mean angle [rad] and rate
        [rad/s] of each carrier during the batch, keyed by wheel.
        """

    def warm_up(self) -> None:
        """Compile or load all kernels of the estimator, so that the first update is fast."""


class _OwnOdometry:
    """Wrapper of a user's odometry class, which needs only the method ``update``."""

    def __init__(self, odometry: Any) -> None:
        self._odometry = odometry

    def match(self, name: str, batch: LineBatch) -> None:
        pass

    def update(
        self, batches: Mapping[str, LineBatch | Flow], steering: Steering | None = None
    ) -> TwistEstimate:
        inputs = (batches,) if steering is None else (batches, steering)
        twist: TwistSample = self._odometry.update(*inputs)
        return TwistEstimate(twist.stamp_ns, twist.value, twist.covariance, True, {})

    def warm_up(self) -> None:
        pass


def own_odometry(name: str, configuration: OdometryConfiguration) -> Odometry:
    """Return the user's odometry estimator that a name selects.

    Args:
        name: ``module:Class`` or the name of an entry point.
        configuration: configuration of sensors and estimation.

    Raises:
        ConfigurationError: the class does not exist, or cannot be imported or created.
    """
    cls = load_class("feedback", name, (), ODOMETRY_GROUP, "update")
    return _OwnOdometry(make_part("feedback", name, cls, configuration))
