"""Brake assistant that decides at each control step which brakes act.

Source: dissertation, section 3.3, Eqs. (44)-(46).

With the law `sliding_mode` and the pedal down, the brake of wheel i acts while the error ``s_i`` of
the wheel is negative. A valve that has just switched keeps its state for the minimum dwell time
(`assist_step`). All brakes are enabled, without regard to the dwell time,

- while the pedal is up,
- while no error is negative, so that the vehicle never rolls unbraked,
- while the vehicle is slow: from the time when the fastest wheel center falls below the speed
  threshold until the pedal is released or the speed exceeds the threshold by a hysteresis (for
  example on a slope where the brakes cannot hold the vehicle),
- while a fault is present, for example an invalid input or an unknown motion; the module
  `conditions` lists all faults.

The assistant stores the line of motion when the motion is first known with the pedal down. All
brakes act until then. If the feedback is interrupted for too long to integrate the heading, the
assistant stores a new line afterward. A vehicle that only rotates when its line is to be stored has
no line of motion. The component ``s_perp`` of its errors, which keeps a vehicle on its line, is
then zero.
"""

import dataclasses
import operator
from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np

from omni_brake_assist import assist_state, assist_step, conditions, fail_safe, valves
from omni_brake_assist.assist_state import Inputs, LawCall
from omni_brake_assist.conditions import CONDITIONS, GOOD, UNREADABLE, AssistState, Decision, Fault
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.laws.law import NO_HELP, call_law
from omni_brake_assist.laws.own_law import own_law
from omni_brake_assist.sources import LOST, Source, sources
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import FloatArray
from omni_core.signals import INVALID, MISSING, VALID, ImuSample, TwistSample, WheelSample

_SHOWN = 12  # number of other joints in a message about wheel_states


@dataclasses.dataclass(frozen=True, eq=False)
class BrakeDemand:
    """Brake demand of the driver, with the latest measurements.

    Attributes:
        stamp_ns: time of the demand [ns from the start of the run].
        pedal: driver's brake demand [1], 0 to 1.
        feedback: latest received twist, repeated until a newer twist is received; None before the
            first twist.
        wheels: latest received wheel speeds; None before the first message.
        imu: IMU readings since the last demand, as `ImuIntegrator` returns them; None before the
            first reading.
    """

    stamp_ns: int
    pedal: float
    feedback: TwistSample | None
    wheels: WheelSample | None = None
    imu: ImuSample | None = None


class BrakeAssist:
    """Brake assistant of one vehicle.

    Attributes:
        geometry: wheel geometry; `Decision.enable` and `Decision.error` have the same order of
            wheels.
    """

    def __init__(self, configuration: BrakeAssistConfiguration) -> None:
        self.configuration = configuration
        self._kinematics = PlatformKinematics.of(configuration.wheels)
        self.geometry = self._kinematics.geometry
        self._wheels = len(self.geometry.names)
        self._constants = assist_state.make_constants(configuration, self.geometry)
        self._law = own_law(configuration, self.geometry)  # None if the law is built in
        self._memory = assist_state.new_memory(self._constants)
        self._faults: dict[int, Fault] = {}  # reasons for conditions that have no text in the table
        self._malformed: dict[type, str] = {}  # problem of the last IMU or wheel sample, by type
        self._stamp_ns = 0
        # Compile the kernel here, so that the first real step is as fast as all others. Afterwards
        # the memory is replaced, because it contains the stamp of this trial step.
        self._step(Inputs(0, 0.0, True, GOOD, *self._samples(BrakeDemand(0, 0.0, None))))
        self._memory = assist_state.new_memory(self._constants)

    def update(self, demand: BrakeDemand) -> Decision:
        """Return the brake enables for a demand of the driver.

        This method raises no exception. For any values of the demand, all numbers in the
        decision are finite, and the enables are between 0 and 1.

        Args:
            demand: pedal and latest feedback; successive demands must have increasing stamps.
        """
        try:
            return self._decide(demand)
        except Exception as error:  # an internal error must not release a brake
            fault = Fault(AssistState.INTERNAL_ERROR, f"{type(error).__name__}: {error}")
            return self._all_on(conditions.INTERNAL_ERROR, fault)

    def timeout(self, stamp_ns: int, silence: Fault) -> Decision:
        """Return a decision with all brakes on, because an input is silent or has two publishers.

        The recovery starts again: the number of consecutive valid twists is set to 0.

        Args:
            stamp_ns: time of the decision [ns].
            silence: fault with the state NO_DEMAND, NO_FEEDBACK, STALE_FEEDBACK or
                SECOND_PUBLISHER.
        """
        self._stamp_ns = stamp_ns
        codes = {
            AssistState.NO_DEMAND: conditions.NO_DEMAND,
            AssistState.SECOND_PUBLISHER: conditions.SECOND_PUBLISHER,
        }
        return self._all_on(codes.get(silence.state, conditions.SILENCE), silence)

    def sources(self) -> tuple[Source, ...]:
        """Return the test ratio and state of each measurement source after the last decision."""
        found = sources(self._memory, self._kinematics, self.configuration.fault_detection)
        if conditions.WRONG_FRAME in self._faults:
            found = (found[0]._replace(reason=AssistState.WRONG_FRAME.value), *found[1:])
        inertial, wheels = map(self._malformed.get, (ImuSample, WheelSample))
        problems = ["", *[inertial or ""] * 2, *[wheels or ""] * self._wheels]
        return tuple(
            one._replace(state=LOST, reason=problem) if problem else one
            for one, problem in zip(found, problems, strict=True)
        )

    def switch(self, *, enabled: bool) -> None:
        """Enable or disable the release of brakes, starting with the next decision."""
        self.configuration = dataclasses.replace(self.configuration, enabled=enabled)

    def check_wheel_names(self, names: Iterable[str]) -> Fault | None:
        """Return the fault if a message does not name each configured wheel exactly once.

        If so, all brakes stay on until a later message names them. Before the first message, the
        configuration is assumed to be correct.

        Args:
            names: names in the message, in any order; other joints are ignored.

        Returns:
            The fault UNKNOWN_WHEEL; None if the names agree.
        """
        fault = self._compare_wheels(names)
        self._faults.pop(conditions.UNKNOWN_WHEEL, None)
        if fault is not None:
            self._faults[conditions.UNKNOWN_WHEEL] = fault
        return fault

    def check_twist_frame(self, problem: str) -> None:
        """Keep all brakes on while the twist is given in another frame than the vehicle's.

        Args:
            problem: sentence that names both frames; empty if the twist has the vehicle's frame.
        """
        self._faults.pop(conditions.WRONG_FRAME, None)
        if problem:
            self._faults[conditions.WRONG_FRAME] = Fault(AssistState.WRONG_FRAME, problem)

    def _compare_wheels(self, names: Iterable[str]) -> Fault | None:
        reported, known = Counter(names), self.geometry.names
        missing = [name for name in known if name not in reported]
        others = [name for name in reported if name not in known] if missing else []
        problems = [
            f"{word} {', '.join(map(str, wheels))}"
            for word, wheels in (
                ("unknown", others[:_SHOWN]),
                ("missing", missing),
                ("repeated", [name for name in known if reported[name] > 1]),
            )
            if wheels
        ]
        if not problems:
            return None
        return Fault(
            AssistState.UNKNOWN_WHEEL,
            f"reported wheels: {'; '.join(problems)}; must be {', '.join(self.geometry.names)}",
        )

    def _decide(self, demand: BrakeDemand) -> Decision:
        self._faults.pop(conditions.INVALID_DEMAND, None)
        try:
            self._stamp_ns = _checked_stamp(demand.stamp_ns)
        except ValueError as problem:
            fault = Fault(AssistState.INVALID_DEMAND, f"demand: {problem}")
            return self._all_on(conditions.INVALID_STAMP, fault)
        self._malformed.clear()
        pedal = self._read_pedal(demand.pedal)
        input_faults = (
            conditions.INVALID_DEMAND,
            conditions.UNKNOWN_WHEEL,
            conditions.WRONG_FRAME,
        )
        outside = next((c for c in input_faults if c in self._faults), GOOD)
        enabled = self.configuration.enabled
        inputs = Inputs(self._stamp_ns, pedal, enabled, outside, *self._samples(demand))
        outcome, enable, error = self._step(inputs)
        code = int(self._memory.step["fault"][0])
        present = self._fault_in_words(code) if code != GOOD else None
        if present is not None and conditions.INACTIVE < outcome < conditions.SLOW:
            state, reason = present.state, present.reason
        else:
            state, reason = CONDITIONS[outcome].state, self._reason(outcome)
        return Decision(self._stamp_ns, enable, error, state, reason, present)

    def _step(self, inputs: Inputs) -> tuple[int, FloatArray, FloatArray]:
        """Run one step of the assistant.

        Returns:
            Row of `conditions.CONDITIONS`, enables [1] and errors [m/s], shape (N,) each.
        """
        constants, memory = self._constants, self._memory
        error, enable = np.zeros(self._wheels), np.ones(self._wheels)
        if self._law is None:
            return assist_step.assist_step(constants, memory, inputs, error, enable), enable, error
        ready, motion = assist_step.receive(constants, memory, inputs)
        answer, problem = NO_HELP, ""
        if ready:
            step = constants.laws.allocation.brake.pressure_step
            answer, problem = call_law(
                self._law, motion, error, enable, step, enabled=inputs.enabled
            )
        if problem:
            self._faults[conditions.INTERNAL_ERROR] = Fault(AssistState.INTERNAL_ERROR, problem)
        outcome = assist_step.act(
            constants, memory, inputs, LawCall(ready, motion, answer), error, enable
        )
        return outcome, enable, error

    def _samples(self, demand: BrakeDemand) -> tuple[TwistSample, WheelSample, ImuSample]:
        """Return twist, wheel speeds and IMU reading of a demand for the kernel.

        The field `validity` of each sample states whether the sample is missing or malformed.
        """
        twist = self._read(
            demand.feedback, {"value": (3,), "covariance": (3, 3)}, {"value": "twist"}
        )
        wheels = self._read(demand.wheels, {"speed": (self._wheels,)}, {})
        imu = self._read(demand.imu, {"yaw_rate": (), "acceleration": (2,)}, {})
        return (
            TwistSample(twist[1], twist[2][0], twist[2][1], twist[0]),
            WheelSample(wheels[1], wheels[2][0], wheels[0]),
            ImuSample(imu[1], float(imu[2][0]), imu[2][1], imu[0]),
        )

    def _read(
        self,
        signal: TwistSample | WheelSample | ImuSample | None,
        shapes: dict[str, tuple[int, ...]],
        words: dict[str, str],
    ) -> tuple[int, int, list[FloatArray]]:
        """Return the validity of a sample, its stamp [ns], and copies of its fields as arrays.

        Args:
            signal: the sample; None if none has been received.
            shapes: required shape of each field, keyed by the name of the field.
            words: names of fields in error messages, where they differ from those in `shapes`.

        Returns:
            VALID, MISSING or INVALID; stamp [ns]; one array for each field, which contains NaN
            unless the sample is valid.
        """
        missing = [np.full(shape, np.nan) for shape in shapes.values()]
        if signal is None:
            return MISSING, 0, missing
        try:
            arrays = [
                _real_array(getattr(signal, name), shape, words.get(name, name))
                for name, shape in shapes.items()
            ]
            return VALID, _checked_stamp(signal.stamp_ns), arrays
        except ValueError as problem:
            self._malformed[type(signal)] = str(problem)
            if isinstance(signal, TwistSample):
                self._faults[UNREADABLE] = Fault(AssistState.NON_FINITE_FEEDBACK, str(problem))
            return INVALID, 0, missing

    def _read_pedal(self, pedal: Any) -> float:
        """Return the pedal demand, 0 to 1; an invalid value counts as full braking."""
        try:
            value = float(pedal)
        except (TypeError, ValueError, OverflowError):
            problem = f"pedal is {type(pedal).__name__}, not a number"
        else:
            if 0.0 <= value <= 1.0:  # False for NaN
                return value
            problem = f"pedal is {value:.4g}, must be 0 to 1"
        self._faults[conditions.INVALID_DEMAND] = Fault(AssistState.INVALID_DEMAND, problem)
        return 1.0

    def _fault_in_words(self, code: int) -> Fault:
        """Return state and reason of a fault.

        During recovery, the reason begins with the number of valid twists since the fault.

        Args:
            code: row of `conditions.CONDITIONS`.
        """
        gate, row = self._memory.gate[0], CONDITIONS[code]
        values = {name: float(gate[name]) for name in ("value", "limit", "within")}
        fault = self._faults.get(code) or Fault(
            row.state, row.words.format(wheel=self._failed_wheel, **values)
        )
        if code != gate["cause"] or gate["good"] == 0:
            return fault
        progress = f"{gate['good']} of {self.configuration.recovery_count} valid twists since"
        return Fault(fault.state, f"{progress}: {fault.reason}")

    @property
    def _failed_wheel(self) -> str:
        return self.geometry.names[int(self._memory.step["dead"][0]) - 1]

    def _reason(self, outcome: int) -> str:
        """Return the reason for a row of `conditions.CONDITIONS`, as one line of text."""
        configuration = self.configuration
        if outcome == conditions.FAILED_BRAKE and self._constants.laws.replans:
            outcome = conditions.REPLANNED  # also in steps in which the law releases no brake
        slow = outcome == conditions.SLOW
        limit = configuration.speed_threshold if slow else configuration.pedal_threshold
        words = CONDITIONS[outcome].words.format(limit=limit, wheel=self._failed_wheel)
        dwell = configuration.minimum_dwell_time
        if outcome in (conditions.ASSISTING, conditions.DEAD_RECKONING) and dwell > 0.0:
            words += f", switched at most every {dwell:g} s"
        return words

    def _all_on(self, check: int, fault: Fault) -> Decision:
        """Return a decision with all brakes on because of a fault.

        The recovery starts again: the number of consecutive valid twists is set to 0.

        Args:
            check: condition of the fault, a row of `conditions.CONDITIONS`.
            fault: state and reason for the decision.
        """
        self._faults[check] = fault
        memory = self._memory
        fail_safe.close_gate(memory.gate[0], check, 0.0, 0.0, 0.0)
        elapsed = max(self._stamp_ns - int(memory.step["switched_ns"][0]), 0)
        memory.step["switched_ns"] = self._stamp_ns
        memory.commanded[:] = 1.0
        valves.open_valves(memory.valves, self._constants.dwell, float(elapsed))
        ones, zeros = np.ones(self._wheels), np.zeros(self._wheels)
        return Decision(self._stamp_ns, ones, zeros, fault.state, fault.reason, fault)


def _checked_stamp(value: Any) -> int:
    """Return a stamp [ns] as an integer.

    Raises:
        ValueError: the value is not a whole number, or does not fit into 64 bits.
    """
    try:
        stamp = operator.index(value)
    except TypeError:
        raise ValueError(f"stamp is {type(value).__name__}, must be a whole number") from None
    if not -(2**63) <= stamp < 2**63:
        raise ValueError("stamp does not fit into 64 bits")
    return stamp


def _real_array(value: Any, shape: tuple[int, ...], name: str) -> FloatArray:
    """Return a copy of a sequence of numbers as an array; error messages call it `name`.

    Raises:
        ValueError: the values are not real numbers or have another shape.
    """
    try:
        array = np.asarray(value)
    except ValueError:  # the rows have different lengths
        array = np.asarray(None)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} must contain real numbers")
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}, must be {shape}")
    return np.array(array, dtype=np.float64, order="C")
