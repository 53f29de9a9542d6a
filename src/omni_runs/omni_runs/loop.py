"""Closed loop of plant, estimator and controller in one process, without ROS.

The loop passes the same values between the same cores in the same order as the ROS graph in
lockstep, so the results are bit-identical. The generator `steps` is the loop; the other functions
use it.
"""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain, starmap
from typing import Any, Protocol

import numpy as np

from linescan_odometry.port import OdometryPort
from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand
from omni_brake_assist.conditions import Decision
from omni_brake_assist.imu_integration import ImuIntegrator
from omni_core import signals
from omni_runs import experiment, history
from omni_sim.run_progress import RunProgress
from omni_sim.simulator import Observation, Simulator


class Estimator(Protocol):
    """Source of the body twist: line-scan odometry, a user's odometry or a velocity sensor."""

    def estimate(self, observation: Observation) -> signals.TwistSample:
        """Return the twist estimated from the measurements; the loop calls this once per stamp."""


@dataclasses.dataclass(frozen=True, eq=False)
class Moment:
    """Outputs of plant, estimator and controller at one control stamp.

    Attributes:
        observation: output of the plant.
        feedback: output of the estimator.
        decision: output of the controller.
    """

    observation: Observation
    feedback: signals.TwistSample
    decision: Decision


def steps(plant: Simulator, estimator: Estimator, controller: BrakeAssist) -> Iterator[Moment]:
    """Run the loop endlessly: observe, estimate, decide, advance.

    Args:
        plant: simulator, advanced by one control period after each yielded moment.
        estimator: source of the twist, called with every observation.
        controller: brake assistant, called with every estimate.
    """
    imu = ImuIntegrator(controller.configuration.feedback_timeout)
    while True:
        observation = plant.observe()
        feedback = estimator.estimate(observation)
        for reading in observation.imu:
            imu.add(reading)
        decision = controller.update(_demand(observation, feedback, imu))
        yield Moment(observation, feedback, decision)
        plant.advance(decision.enable)


def _demand(
    observation: Observation, feedback: signals.TwistSample, imu: ImuIntegrator
) -> BrakeDemand:
    stamp_ns = observation.stamp_ns
    return BrakeDemand(
        stamp_ns,
        observation.pedal,
        feedback,
        signals.WheelSample(stamp_ns, observation.encoder_speed),
        imu.end_step(stamp_ns),
    )


class SensorEstimator:
    """Returns the readings of the velocity sensor unchanged."""

    def estimate(self, observation: Observation) -> signals.TwistSample:
        """Return the reading of the velocity sensor."""
        return observation.velocity_sensor


class LineEstimator:
    """Odometry that estimates the twist from the lines of the cameras."""

    def __init__(self, odometry: OdometryPort, wheels: Iterable[str] = ()) -> None:
        """Create the estimator; `wheels` names the wheels if cameras are on steered carriers."""
        self._odometry, self._wheels = odometry, tuple(wheels)

    def estimate(self, observation: Observation) -> signals.TwistSample:
        """Return the twist estimated from the lines since the last stamp."""
        # The lines of each camera are matched while those of the next camera are rendered.
        inputs = chain(observation.line_batches.items(), observation.flows.items())
        angles = dict(zip(self._wheels, observation.steering_angle.tolist(), strict=False))
        *_, (newest, _) = chain(
            chain.from_iterable(starmap(self._odometry.take, inputs)),
            self._odometry.steer(observation.stamp_ns, angles),
        )
        return signals.TwistSample(newest.stamp_ns, newest.twist, newest.covariance)


def make_estimator(configuration: experiment.ExperimentConfiguration) -> Estimator:
    """Return the source of the twist for the brake assistant of a configuration."""
    if configuration.uses_lines:
        port = OdometryPort(configuration.own_odometry, configuration.odometry)
        return LineEstimator(port, configuration.vehicle.wheels)
    return SensorEstimator()


def run_closed_loop(
    configuration: experiment.ExperimentConfiguration, simulator: Simulator | None = None
) -> history.RunHistory:
    """Run an experiment to its end, and return the history.

    Args:
        configuration: configuration of the whole loop.
        simulator: simulator of this configuration, which the caller can inspect after the run; None
            to create one.

    Returns:
        The history of the run, without a real-time factor, because this function reads no clock.
    """
    plant = simulator or Simulator(configuration)
    estimator, controller = make_estimator(configuration), BrakeAssist(configuration.brake_assist)
    moments = steps(plant, estimator, controller)
    return record(tuple(configuration.vehicle.wheels), _until_over(configuration, moments))


def _until_over(
    configuration: experiment.ExperimentConfiguration, moments: Iterable[Moment]
) -> Iterator[tuple[Moment, signals.TwistSample | None]]:
    """Yield the moments of a run until its end.

    Each moment comes with the twist of the odometry, or with None if no lines are rendered.
    """
    progress = RunProgress(configuration)
    # The assistant does not use this odometry; its estimate is only recorded.
    recorded: Estimator | None = None
    if configuration.simulation.render_lines and not configuration.uses_lines:
        port = OdometryPort("", configuration.odometry)
        recorded = LineEstimator(port, configuration.vehicle.wheels)
    for moment in moments:
        if recorded is not None:
            yield moment, recorded.estimate(moment.observation)
        else:
            yield moment, moment.feedback if configuration.uses_lines else None
        progress.update(moment.observation)
        if progress.finished:
            return


def record(
    wheel_names: tuple[str, ...], moments: Iterable[tuple[Moment, signals.TwistSample | None]]
) -> history.RunHistory:
    """Convert the moments of a run to a history.

    Args:
        wheel_names: wheel names of the plant.
        moments: moment of every control stamp, with the twist of the odometry (None without
            odometry).
    """
    samples: dict[str, list[Any]] = {}
    states: list[str] = []
    for moment, estimate in moments:
        states.append(moment.decision.state.value)
        for name, value in _sample(moment, estimate).items():
            samples.setdefault(name, []).append(np.array(value))
    return history.RunHistory.from_samples(wheel_names=wheel_names, assist_state=states, **samples)


_NOTHING = np.full(3, np.nan)


def _sample(moment: Moment, estimate: signals.TwistSample | None) -> Mapping[str, Any]:
    samples = {"simulator": moment.observation, "brake_assist": moment.decision}
    return {
        "stamp_ns": moment.observation.stamp_ns,
        **{
            name: getattr(samples[topic.publisher], name)
            for name, (topic, _) in history.SOURCES.items()
            if topic.publisher in samples
        },
        "estimate": _NOTHING if estimate is None else estimate.value,
        "estimate_variance": _NOTHING if estimate is None else np.diag(estimate.covariance),
    }
