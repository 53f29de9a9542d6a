"""An assisted stop on the velocity sensor, and the same stop on the line-scan odometry.

The dissertation assumes ideal feedback in chapter 3 and treats the sensor of chapter 4 separately;
here the loop is closed with this sensor.
"""

import dataclasses
import math
from collections.abc import Callable, Iterable

import numpy as np

from omni_loop import compiled, loop, metrics
from omni_loop.experiment import ExperimentLibrary
from omni_loop.history import RunHistory
from omni_platform.quantities import FloatArray

EXPERIMENTS = (
    "straight_line",
    "three_wheel_diagonal",
    "ice_patch",
    "ice_patch_noisy",
    "turn_while_translate",
)
"""The experiments of section 3.6."""

_REPEATED = {("ice_patch_noisy", "assisted")}  # is the run of ice_patch


@dataclasses.dataclass(frozen=True, eq=False)
class Comparison:
    """One variant of an experiment with either feedback.

    Attributes:
        experiment: name of the experiment.
        variant: name of its variant.
        sensor: the run on the velocity sensor as the experiment configures it.
        optical: the run on the line-scan odometry.
    """

    experiment: str
    variant: str
    sensor: RunHistory
    optical: RunHistory

    @property
    def case(self) -> str:
        """Experiment and variant in one name."""
        return f"{self.experiment}_{self.variant}"

    @property
    def sensor_metrics(self) -> dict[str, metrics.Metric]:
        """Metrics of the run on the velocity sensor."""
        return metrics.run_metrics(self.sensor)

    @property
    def optical_metrics(self) -> dict[str, metrics.Metric]:
        """Metrics of the run on the line-scan odometry."""
        return metrics.run_metrics(self.optical)


def compare(
    library: ExperimentLibrary,
    experiments: Iterable[str],
    overrides: Iterable[str],
    on_case: Callable[[float, str], None] | None = None,
) -> tuple[Comparison, ...]:
    """Run every assisted variant of some experiments with either feedback.

    Args:
        library: where the experiments are.
        experiments: their names.
        overrides: ``dotted.key=value`` texts, laid over every variant.
        on_case: receives the completed share, 0..1, and the next case.

    Raises:
        ConfigurationError: a name, key or value does not fit.
    """
    changes = tuple(overrides)
    pairs = {}
    for experiment in experiments:
        for variant in library.variants(experiment):
            sensor, optical = (
                library.load(experiment, variant, (*changes, f"feedback={feedback}"))
                for feedback in ("velocity_sensor", "optical")
            )
            if sensor.brake_assist.enabled and (experiment, variant) not in _REPEATED:
                pairs[experiment, variant] = sensor, optical
    comparisons: list[Comparison] = []
    for (experiment, variant), (sensor, optical) in pairs.items():
        if on_case is not None:
            on_case(len(comparisons) / len(pairs), f"{experiment} {variant}")
        comparisons.append(
            Comparison(
                experiment,
                variant,
                compiled.run_fast_loop(sensor).history(),
                loop.run_closed_loop(optical),
            )
        )
    return tuple(comparisons)


def turned(history: RunHistory) -> FloatArray:
    """Return the change of orientation since the start of braking [deg], shape (T,)."""
    yaw = history.pose[:, 2]
    start = history.brake_start or 0
    return np.asarray((yaw - yaw[start]) * (180.0 / math.pi), dtype=np.float64)


def odometry_lag(history: RunHistory) -> float:
    """Return the lag of the odometry's velocity while braking [s].

    A lag ``tau`` causes an error of ``-tau`` times the acceleration, to which ``tau`` is fitted;
    noise that is independent of the acceleration does not affect it. NaN if the odometry never
    measured.
    """
    start = history.brake_start or 0
    acceleration = np.gradient(history.twist[:, :2], history.time, axis=0)[start:]
    error = (history.estimate - history.twist)[start:, :2]
    known = history.measured[start:]
    square = float(np.sum(acceleration[known] ** 2))
    return -float(np.sum(error[known] * acceleration[known])) / square if square else math.nan
