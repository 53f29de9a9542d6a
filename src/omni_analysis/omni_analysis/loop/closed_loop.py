"""The loop of simulator, odometry and brake assistant in one process, without ROS.

It passes the same values between the same cores in the same order as the graph in lockstep does,
so that a run gives the same bits either way.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from linescan_odometry.odometry import LineBatch, LineScanOdometry, TwistEstimate
from omni_analysis.loop.experiment import ExperimentConfiguration
from omni_analysis.loop.history import RunHistory
from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand, Decision
from omni_platform.signals import ImuReading, Twist, WheelSpeeds
from omni_sim.run_progress import RunProgress
from omni_sim.simulator import Observation, Simulator


def run_closed_loop(
    configuration: ExperimentConfiguration, simulator: Simulator | None = None
) -> RunHistory:
    """Run an experiment to its end.

    Args:
        configuration: the whole loop.
        simulator: a simulator of this configuration to look into afterwards; made if not given.

    Returns:
        The history at every control stamp. Its real-time factor is unknown: this function reads
        no clock.
    """
    simulator = simulator or Simulator(configuration.simulator())
    odometry = LineScanOdometry(configuration.odometry)
    assist = BrakeAssist(configuration.brake_assist)
    progress = RunProgress(configuration.simulator())
    record = _Record(tuple(configuration.vehicle.wheels))
    while True:
        observation = simulator.observe()
        progress.update(observation)
        estimate = odometry.update(
            {
                name: LineBatch(batch.stamp_ns, batch.lines)
                for name, batch in observation.line_batches.items()
            }
        )
        if configuration.feedback == "optical":
            feedback = Twist(estimate.stamp_ns, estimate.twist, estimate.covariance)
        else:
            feedback = observation.velocity_sensor
        decision = assist.update(
            BrakeDemand(
                observation.stamp_ns,
                observation.pedal,
                feedback,
                WheelSpeeds(observation.stamp_ns, observation.encoder_speed),
                ImuReading(observation.stamp_ns, float(observation.imu[0]), observation.imu[1:]),
            )
        )
        record.add(observation, estimate, decision)
        if progress.finished:
            return record.history()
        simulator.advance(decision.enable)


class _Record:
    """Samples of a run, one per control stamp."""

    def __init__(self, wheel_names: tuple[str, ...]) -> None:
        self._wheel_names = wheel_names
        self._samples: dict[str, list[Any]] = {}
        self._pose: list[Any] = []
        self._states: list[str] = []

    def add(self, observation: Observation, estimate: TwistEstimate, decision: Decision) -> None:
        self._pose.append(observation.pose)
        self._states.append(decision.state.value)
        sample: dict[str, Any] = {
            "stamp_ns": observation.stamp_ns,
            "twist": observation.twist,
            "wheel_angle": observation.wheel_angle,
            "wheel_speed": observation.wheel_speed,
            "brake_torque": observation.brake_torque,
            "enable": decision.enable,
            "error": decision.error,
            "pedal": observation.pedal,
            "estimate": estimate.twist,
            "estimate_variance": np.diag(estimate.covariance),
        }
        for name, value in sample.items():
            self._samples.setdefault(name, []).append(np.array(value))

    def history(self) -> RunHistory:
        return RunHistory.from_samples(
            wheel_names=self._wheel_names,
            pose=np.array(self._pose),
            assist_state=self._states,
            real_time_factor=math.nan,
            **{name: np.array(values) for name, values in self._samples.items()},
        )
