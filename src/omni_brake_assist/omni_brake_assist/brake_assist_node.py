"""ROS node of the brake assistant: subscribes to pedal and body twist, publishes brake enables.

The README of this package describes the contract: topics, types, QoS, parameters and timeouts.
"""

import dataclasses
import gc
import math
from collections.abc import Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np
from geometry_msgs.msg import TwistWithCovarianceStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import Imu, JointState

from omni_brake_assist.brake_assist import BrakeAssist, BrakeDemand
from omni_brake_assist.conditions import WARNING, AssistState, Decision, Fault
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.imu_integration import ImuIntegrator
from omni_brake_assist.sources import ReceivedRate, RejectionTimers, Source, summary
from omni_core import signals, topics
from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_core.sensors import rotation_matrix
from omni_ros import messages
from omni_ros.clocks import RunningClock
from omni_ros.frames import FrameConfiguration, frame_problem
from omni_ros.parameters import declare_configuration
from omni_ros.process import Spinner, StartupConfiguration, run_process, spin_until_stopped
from omni_ros.publisher_guard import PublisherGuard
from omni_ros.qos import RECENT, RELIABLE, advertise, subscribe
from omni_ros.status import Status, StatusReporter, steady_clock

Sample = signals.PedalSample | signals.TwistSample | signals.WheelSample | signals.ImuSample
_S = TypeVar("_S")

_SWITCH = "enabled"  # this parameter may be changed at any time
# Parameters that may be changed only while the pedal is up.
TUNABLE = frozenset(
    {
        "weighting",
        "k",
        "max_rotation",
        "minimum_dwell_time",
        "pedal_threshold",
        "speed_threshold",
        "speed_hysteresis",
        "minimum_reference_speed",
        "recovery_count",
        "maximum_speed_deviation",
        "maximum_yaw_rate_deviation",
        "maximum_speed",
        "maximum_yaw_rate",
        "maximum_acceleration",
        "maximum_yaw_acceleration",
        "speed_noise",
        "yaw_rate_noise",
        "frozen_time",
    }
)
_DECISION = tuple(one for one in topics.published_by("brake_assist") if one.is_plain)
_NOTHING_YET = {"state": AssistState.NO_DEMAND.value, "fault": AssistState.NO_DEMAND.value}


class StepPairing:
    """Stores the newest sample of each input; pairs each pedal value with the twist of its step.

    The samples may arrive in any order. The stamp of a twist is the time of the newest camera line,
    which may be up to one line period earlier than the step. A twist therefore belongs to the first
    demand whose stamp is not earlier than the stamp of the twist. Wheel speeds and IMU readings
    have the stamp of their step. If the sampling period of the twist is longer than a step, a twist
    belongs to all steps within this period.

    Args:
        fault_detection: whether a demand waits for the wheel speeds of its step.
        imu: whether a demand also waits for the IMU readings of its step.
        twist_period_ns: time between two samples of the twist [ns], 0 if each step has its own
            twist.
        imu_period_ns: time between two IMU readings [ns], 0 if each step has its own reading.
        imu_timeout: gap between two IMU readings over which they are not integrated [s].
    """

    def __init__(
        self,
        *,
        fault_detection: bool = False,
        imu: bool = False,
        twist_period_ns: int = 0,
        imu_period_ns: int = 0,
        imu_timeout: float = BrakeAssistConfiguration.feedback_timeout,
    ) -> None:
        self._twist_period_ns, self._imu_period_ns = twist_period_ns, imu_period_ns
        self._imu = ImuIntegrator(imu_timeout)
        awaited: tuple[type[Any], ...] = (
            (signals.WheelSample, signals.ImuSample) if imu else (signals.WheelSample,)
        )
        self._awaited = awaited if fault_detection else ()
        self._newest: dict[type[Any], Any] = {}
        self._answered_ns = -1  # stamp of the newest answered demand

    def newest(self, kind: type[_S]) -> _S | None:
        """Return the last received sample of a given type; None before the first sample."""
        return self._newest.get(kind)

    @property
    def newest_ns(self) -> int:
        """Largest stamp among the newest pedal, twist and IMU samples [ns]."""
        kinds = (signals.PedalSample, signals.TwistSample, signals.ImuSample)
        samples = [self._newest[kind] for kind in kinds if kind in self._newest]
        return int(max(sample.stamp_ns for sample in samples))

    def take(self, sample: Sample) -> BrakeDemand | None:
        """Store a sample; return the demand of its step if all inputs of this step are now known.

        Each demand is returned once; in all other cases, the result is None.
        """
        self._newest[type(sample)] = sample
        if isinstance(sample, signals.ImuSample):
            self._imu.add(sample)
        pedal, twist = self.newest(signals.PedalSample), self.newest(signals.TwistSample)
        if pedal is None or twist is None:
            return None
        stamp_ns = pedal.stamp_ns
        if stamp_ns <= self._answered_ns or not self._is_of(twist.stamp_ns, stamp_ns):
            return None
        for kind in self._awaited:
            signal = self.newest(kind)
            period_ns = self._imu_period_ns if kind is signals.ImuSample else 0
            if signal is None or not _is_in_period(signal.stamp_ns, stamp_ns, period_ns):
                return None
        self._answered_ns = stamp_ns
        return self._demand(pedal)

    def newest_demand(self, pedal: signals.PedalSample) -> BrakeDemand:
        """Return a demand with a pedal position and the newest samples, and end the step."""
        return self._demand(pedal._replace(stamp_ns=self.newest_ns))

    def _demand(self, pedal: signals.PedalSample) -> BrakeDemand:
        twist, wheels = self.newest(signals.TwistSample), self.newest(signals.WheelSample)
        return BrakeDemand(*pedal, twist, wheels, self._imu.end_step(pedal.stamp_ns))

    def _is_of(self, twist_ns: int, stamp_ns: int) -> bool:
        """Return whether a twist at `twist_ns` [ns] belongs to the demand at `stamp_ns` [ns]."""
        if self._twist_period_ns == 0:
            return twist_ns > self._answered_ns
        return _is_in_period(twist_ns, stamp_ns, self._twist_period_ns)


def _is_in_period(sample_ns: int, stamp_ns: int, period_ns: int) -> bool:
    """Return whether a sample is not from an earlier sampling period than a stamp [ns].

    With a period of 0, the sample must not be earlier than the stamp.
    """
    period_ns = max(period_ns, 1)
    return sample_ns // period_ns >= stamp_ns // period_ns


class StepTimer:
    """Decides in real time which of the received messages are answered with a control step.

    Steps follow a grid of control periods, so that their mean rate does not depend on the rate of
    the messages. The first message near the time of a step triggers the step, without the delay of
    a clock of its own.

    Args:
        period: control period [s].
    """

    def __init__(self, period: float) -> None:
        self._period_ns = round(period * 1e9)
        self._due_ns = -(10**18)  # long ago

    def is_due(self, stamp_ns: int) -> bool:
        """Return whether a step is due at a stamp [ns]; if so, the next step is due later."""
        period_ns = self._period_ns
        late_ns = stamp_ns - self._due_ns
        if -2 * period_ns < late_ns < -period_ns / 4:  # tolerates jitter of a quarter of a period
            return False
        if abs(late_ns) > period_ns:  # messages had ceased, or stamps jumped
            self._due_ns = stamp_ns
        self._due_ns += period_ns
        return True


class TimingConfiguration(Configuration):
    """Parameters of the node: pairing of the driver's demand with the feedback, and timeouts."""

    lockstep: bool = parameter(False)
    """Whether the node works in lockstep: before it answers a pedal message, it waits for the
    feedback of the same step, without a time limit. Otherwise it answers in real time"""
    await_imu: bool = parameter(False)
    """In lockstep, whether the node waits for the IMU readings of a step before it publishes the
    enables"""
    imu_period: float = parameter(0.0, unit="s", minimum=0.0, maximum=10.0)
    """In lockstep, time between two IMU readings; 0 if every step has one reading"""
    twist_period: float = parameter(0.0, unit="s", minimum=0.0, maximum=10.0)
    """In lockstep, time between two samples of the twist; the node uses each sample until the next
    one arrives; 0 if every step has a sample"""
    demand_timeout: float = parameter(0.1, unit="s", above=0.0, maximum=10.0)
    """In real time, time without a pedal message after which all brakes are on"""
    base_frame: str = parameter(messages.BASE_FRAME)
    """Frame in which the twist must be given, after the parameter `frame_prefix`; empty for any
    frame. A twist whose frame_id is empty counts as given in this frame"""
    feedback_warning: str = parameter("")
    """Warning about the source of the twist, written by ./omni ros-params; the node logs it at
    start-up and publishes it on /diagnostics"""


class BrakeAssistNode(Node):
    """Publishes the brake enables of the wheels for each brake demand of the driver."""

    def __init__(self) -> None:
        super().__init__("brake_assist")
        self.startup = declare_configuration(self, StartupConfiguration)
        timing = declare_configuration(self, TimingConfiguration)
        self._lockstep = timing.lockstep
        self._prefix = declare_configuration(self, FrameConfiguration).frame_prefix
        self._base_frame = timing.base_frame
        self._demand_timeout = timing.demand_timeout
        if timing.feedback_warning:
            self.get_logger().warning(timing.feedback_warning)
        self._warning = timing.feedback_warning
        configuration = declare_configuration(self, BrakeAssistConfiguration, {_SWITCH, *TUNABLE})
        self._assist = BrakeAssist(configuration)
        self._rejections = RejectionTimers()
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._on_parameters_set)
        self._wheels = tuple(configuration.wheels)
        self._imu_received = -math.inf
        turned = configuration.imu_rotation_deg
        self._imu_axes = rotation_matrix(turned) if turned else None
        self._upwards: float | None = None  # specific force of the IMU, low-passed [m/s^2]
        self._rates = {name: ReceivedRate() for name in ("twist", "imu")}
        self._fault_detection = configuration.fault_detection
        self._inputs = StepPairing(
            fault_detection=configuration.fault_detection,
            imu=timing.await_imu,
            twist_period_ns=round(timing.twist_period * 1e9),
            imu_period_ns=round(timing.imu_period * 1e9),
            imu_timeout=configuration.feedback_timeout,
        )
        self._timer = StepTimer(configuration.control_period)
        self._feedback_timeout = configuration.feedback_timeout
        period = min(self._demand_timeout, self._feedback_timeout) / 2.0
        self._running = RunningClock(period)
        self._pedal_received = self._twist_received = self._running.now()
        self._decisions = {topic.name: advertise(self, topic) for topic in _DECISION}
        self._test_ratios = advertise(self, topics.TEST_RATIOS)
        words = "; ".join(filter(None, ["no pedal yet: all brakes on", self._warning]))
        self._status = StatusReporter(
            self, Status(AssistState.NO_DEMAND.level, words, _NOTHING_YET)
        )
        self.outputs = tuple(self._decisions.values())
        self.enables = (self._decisions[topics.ENABLE.name],)
        # In lockstep no message may be lost. In real time, this applies to the IMU only.
        qos = RELIABLE if self._lockstep else RECENT
        guarded = (
            subscribe(self, topics.PEDAL, self._on_pedal, qos),
            subscribe(self, topics.TWIST, self._on_twist, qos),
            subscribe(self, topics.WHEEL_STATES, self._on_wheel_states, qos),
            subscribe(self, topics.IMU, self._on_imu),
        )
        self._guard = PublisherGuard(self, guarded, self.enables)
        if not self._lockstep:
            self.create_timer(period, self._watch, clock=steady_clock())

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Reject invalid values, and any change of a tunable parameter while the pedal is down."""
        changes = _tuning(parameters)
        if changes and self._is_braking():
            return SetParametersResult(successful=False, reason="cannot be changed while braking")
        try:
            dataclasses.replace(self._assist.configuration, **changes)
        except ConfigurationError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _is_braking(self) -> bool:
        # A message with an invalid pedal value counts as full braking.
        threshold = self._assist.configuration.pedal_threshold
        pedal = self._inputs.newest(signals.PedalSample)
        return pedal is not None and not 0.0 <= pedal.position < threshold

    def _on_parameters_set(self, parameters: list[Parameter]) -> None:
        changes = _tuning(parameters)
        if changes:
            self._assist = BrakeAssist(dataclasses.replace(self._assist.configuration, **changes))
        for given in parameters:
            if given.name == _SWITCH:
                self._assist.switch(enabled=given.value)

    def _on_pedal(self, message: JointState) -> None:
        self._pedal_received = self._running.now()
        self._take(messages.pedal_of(message))

    def _on_twist(self, message: TwistWithCovarianceStamped) -> None:
        self._twist_received = self._running.now()
        frame, expected = message.header.frame_id, self._prefix + self._base_frame
        problem = frame_problem(frame, expected) if frame and self._base_frame else ""
        self._assist.check_twist_frame(problem)
        twist = messages.twist_of(message)
        self._rates["twist"].update(twist.stamp_ns)
        # A twist in another frame is no feedback, neither for the gate nor for the filters.
        self._take(twist._replace(value=np.full(3, math.nan)) if problem else twist)
        if not self._lockstep:
            self._answer()

    def _on_wheel_states(self, message: JointState) -> None:
        if self._assist.check_wheel_names(message.name) is not None:
            return
        speeds = messages.wheel_speeds_of(message, self._wheels)
        if speeds is not None:
            self._take(speeds)

    def _on_imu(self, message: Imu) -> None:
        if not self._fault_detection:
            return
        self._imu_received = self._running.now()
        sample, upwards = messages.imu_vectors_of(message, self._imu_axes)
        share = self._rates["imu"].update(sample.stamp_ns)
        last = upwards if self._upwards is None else self._upwards
        if math.isfinite(upwards):
            self._upwards = last + share * (upwards - last)
        self._take(sample)
        if not self._lockstep:
            self._answer()

    def _take(self, sample: Sample) -> None:
        """Store a sample; in lockstep, publish the decision once its inputs are complete."""
        demand = self._inputs.take(sample)
        if demand is None or not self._lockstep:
            return
        fault = self._second_publisher()
        if fault is not None:
            self._publish(self._assist.timeout(demand.stamp_ns, fault))
        else:
            self._publish(self._assist.update(demand))

    def _watch(self) -> bool:
        """Return whether an input is silent or has two publishers; if so, put all brakes on."""
        fault = self._second_publisher() or self._silence()
        if fault is not None and self._inputs.newest(signals.PedalSample) is not None:
            self._publish(self._assist.timeout(self._inputs.newest_ns, fault))
        return fault is not None

    def _second_publisher(self) -> Fault | None:
        rival = self._guard.second()
        return Fault(AssistState.SECOND_PUBLISHER, rival) if rival is not None else None

    def _silence(self) -> Fault | None:
        now = self._running.now()
        no_pedal, no_twist = now - self._pedal_received, now - self._twist_received
        if no_pedal > self._demand_timeout:
            return Fault(
                AssistState.NO_DEMAND,
                f"no pedal for {no_pedal:.2f} s, more than {self._demand_timeout:g} s",
            )
        # With an IMU the assistant continues by dead reckoning as long as its estimate is valid.
        if no_twist > self._feedback_timeout < now - self._imu_received:
            never = self._inputs.newest(signals.TwistSample) is None
            return Fault(
                AssistState.NO_FEEDBACK if never else AssistState.STALE_FEEDBACK,
                f"no twist for {no_twist:.2f} s, more than {self._feedback_timeout:g} s",
            )
        return None

    def _answer(self) -> None:
        """Publish the decision for the newest inputs if a control step is due.

        An IMU reading does not wait for the odometry of its step: that twist corrects the filters
        in the next step, at its own stamp.
        """
        pedal = self._inputs.newest(signals.PedalSample)
        if pedal is not None and not self._watch() and self._timer.is_due(self._inputs.newest_ns):
            self._publish(self._assist.update(self._inputs.newest_demand(pedal)))

    def _publish(self, decision: Decision) -> None:
        stamp_ns = decision.stamp_ns
        for topic, message in decision_messages(decision, self._wheels).items():
            self._decisions[topic].publish(message)
        sources = self._rejections.update(stamp_ns, self._assist.sources())
        names, ratios, *_ = zip(*sources, strict=True)
        self._test_ratios.publish(messages.joint_state(stamp_ns, names, position=np.array(ratios)))
        self._report(decision, sources)

    def _report(self, decision: Decision, sources: Sequence[Source]) -> None:
        fault = decision.fault.state if decision.fault is not None else None
        level, words = summary(decision, sources)
        if self._upwards is not None and (problem := signals.upwards_problem(self._upwards)):
            level, words = max(level, WARNING), f"{words}; {': '.join(problem)}"
        if self._warning:
            level, words = max(level, WARNING), f"{words}; {self._warning}"
        status = Status(
            level,
            words,
            {
                "state": decision.state.value,
                "fault": fault.value if fault else "",
                **{
                    f"rate.{name}": rate.words(decision.stamp_ns)
                    for name, rate in self._rates.items()
                },
                **{
                    f"test_ratio.{source.name}": f"{source.test_ratio:.3g} {source.words}"
                    for source in sources
                },
            },
        )
        self._status.update(decision.stamp_ns, (decision.state, fault, level), status)


def _tuning(parameters: list[Parameter]) -> dict[str, Any]:
    return {given.name: given.value for given in parameters if given.name in TUNABLE}


def decision_messages(decision: Decision, wheels: Sequence[str]) -> dict[str, Any]:
    """Return the messages of a decision, such as enables and errors, keyed by topic name."""
    return {topic.name: messages.packed(topic, decision, wheels) for topic in _DECISION}


def run(node: BrakeAssistNode, spinner: Spinner) -> None:
    """Spin the node until a signal requests shutdown."""
    # In lockstep the vehicle waits for the first enables, but only a recorder for other outputs.
    node.startup.await_subscribers(node.enables, spinner)
    recorders = max(0, node.startup.subscribers - 1)
    node.startup.await_subscribers(node.outputs, spinner, recorders)
    # Exclude all objects that exist at this point from garbage collection, so that a collection
    # during a stop does not delay the enables.
    gc.collect()
    gc.freeze()
    spin_until_stopped(node, spinner)


main = partial(run_process, BrakeAssistNode, run)


if __name__ == "__main__":
    raise SystemExit(main())
