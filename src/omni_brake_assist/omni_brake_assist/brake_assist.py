"""The brake assistant: which brakes may act, at every control step. Eqs. (44)-(46), section 3.3.

With the law `sliding_mode` and the pedal down, the brake of wheel i acts while its error ``s_i`` is
negative. A valve that has just switched stays as it is for the minimum dwell time (`valve_dwell`).
All brakes act at once

- while the pedal is up,
- if no error is negative, so that the vehicle never rolls unbraked,
- once the fastest wheel center is slower than the speed threshold, until the pedal is released or
  the speed rises clearly above it (a slope that the brakes cannot hold),
- whenever demand, wheels, time or feedback is invalid: see `fail_safe`.

The line of motion to keep is that of the first valid feedback with the pedal down. Until there is
one, all brakes act. After a gap in the feedback over which the heading is unknown, a new line is
stored. A vehicle that only spins at that moment has no line to keep, so ``s_perp = 0``.
"""

import dataclasses
from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np

from omni_brake_assist.assist_step import (
    Asked,
    Inputs,
    act,
    assist_step,
    make_constants,
    new_memory,
    receive,
)
from omni_brake_assist.conditions import (
    ASSISTING,
    CONDITIONS,
    DEAD_RECKONING,
    GOOD,
    INACTIVE,
    INTERNAL_ERROR,
    INVALID_DEMAND,
    INVALID_STAMP,
    NO_DEMAND,
    SECOND_PUBLISHER,
    SILENCE,
    SLOW,
    UNKNOWN_WHEEL,
    UNREADABLE,
    AssistState,
)
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.decision import BrakeDemand, Decision, Fault
from omni_brake_assist.fail_safe import (
    checked_stamp,
    close_gate,
    real_array,
)
from omni_brake_assist.laws.law import NO_HELP, ask
from omni_brake_assist.laws.registry import own_law
from omni_brake_assist.sliding_manifold import SlidingManifold
from omni_brake_assist.sources import Source, sources
from omni_brake_assist.valve_dwell import open_valves
from omni_brake_assist.weighting import weighting_function
from omni_platform.geometry import PlatformGeometry
from omni_platform.quantities import FloatArray
from omni_platform.signals import INVALID, MISSING, VALID, ImuSample, TwistSample, WheelSample

__all__ = [
    "AssistState",
    "BrakeAssist",
    "BrakeAssistConfiguration",
    "BrakeDemand",
    "Decision",
    "Fault",
]


class BrakeAssist:
    """Brake assistant of one vehicle.

    Attributes:
        geometry: the wheels, in the order of `Decision.enable` and `Decision.error`.
        manifold: the error functions of the sliding-mode law.
    """

    def __init__(self, configuration: BrakeAssistConfiguration) -> None:
        self.configuration = configuration
        self.geometry = PlatformGeometry.from_wheels(configuration.wheels)
        self.manifold = SlidingManifold(
            self.geometry, weighting_function(configuration.weighting, configuration.k)
        )
        self._wheels = len(self.geometry.names)
        self._constants = make_constants(configuration, self.geometry)
        self._law = own_law(configuration, self.geometry)  # None for one of the built-in laws
        self._memory = new_memory(self._wheels)
        self._said: dict[int, Fault] = {}  # words of conditions that have none in the table
        self._stamp_ns = 0
        # Loads the kernel: the first real step is as fast as the others.
        self._step(Inputs(0, 0.0, True, GOOD, *self._samples(BrakeDemand(0, 0.0, None))))

    def update(self, demand: BrakeDemand) -> Decision:
        """Decide which brakes may act.

        Raises no exception: for any demand the decision is finite and its enables are shares from 0
        to 1.

        Args:
            demand: pedal and latest feedback, in order of their stamps.
        """
        try:
            return self._decide(demand)
        except Exception as error:  # a fault of the assistant must not cost a brake
            fault = Fault(AssistState.INTERNAL_ERROR, f"{type(error).__name__}: {error}")
            return self._all_on(INTERNAL_ERROR, fault)

    def timeout(self, stamp_ns: int, silence: Fault) -> Decision:
        """Decide after a timeout: all brakes on, until enough valid twists have arrived again.

        Args:
            stamp_ns: time of the decision [ns].
            silence: NO_DEMAND, NO_FEEDBACK, STALE_FEEDBACK or SECOND_PUBLISHER with its reason.
        """
        self._stamp_ns = stamp_ns
        codes = {
            AssistState.NO_DEMAND: NO_DEMAND,
            AssistState.SECOND_PUBLISHER: SECOND_PUBLISHER,
        }
        return self._all_on(codes.get(silence.state, SILENCE), silence)

    def sources(self) -> tuple[Source, ...]:
        """Return test ratio and state of every measurement source after the last decision."""
        return sources(self._memory, self.geometry.names)

    def switch(self, *, enabled: bool) -> None:
        """Enable or disable the release of brakes, from the next decision on."""
        self.configuration = dataclasses.replace(self.configuration, enabled=enabled)

    def check_wheel_names(self, names: Iterable[str]) -> Fault | None:
        """Compare the wheels that the vehicle reports with those of the configuration.

        A difference keeps all brakes on until a later report fits. Without any report the
        configuration is assumed to be correct.

        Args:
            names: reported wheels, in any order.

        Returns:
            The fault of the input; None if there is none.
        """
        fault = self._compare_wheels(names)
        self._said.pop(UNKNOWN_WHEEL, None)
        if fault is not None:
            self._said[UNKNOWN_WHEEL] = fault
        return fault

    def _compare_wheels(self, names: Iterable[str]) -> Fault | None:
        reported, known = Counter(names), set(self.geometry.names)
        problems = [
            f"{word} {', '.join(map(str, wheels))}"
            for word, wheels in (
                ("unknown", [name for name in reported if name not in known]),
                ("missing", [name for name in self.geometry.names if name not in reported]),
                ("repeated", [name for name, count in reported.items() if count > 1]),
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
        self._said.pop(INVALID_DEMAND, None)
        try:
            self._stamp_ns = checked_stamp(demand.stamp_ns)
        except ValueError as problem:
            fault = Fault(AssistState.INVALID_DEMAND, f"demand: {problem}")
            return self._all_on(INVALID_STAMP, fault)
        pedal = self._read_pedal(demand.pedal)
        outside = next((c for c in (INVALID_DEMAND, UNKNOWN_WHEEL) if c in self._said), GOOD)
        enabled = self.configuration.enabled
        inputs = Inputs(self._stamp_ns, pedal, enabled, outside, *self._samples(demand))
        outcome, enable, error = self._step(inputs)
        code = int(self._memory.step["fault"][0])
        present = self._fault_in_words(code) if code != GOOD else None
        state, reason = CONDITIONS[outcome].state, self._reason(outcome, present)
        if present is not None and INACTIVE < outcome < SLOW:
            state = present.state
        return Decision(self._stamp_ns, enable, error, state, reason, present)

    def _step(self, inputs: Inputs) -> tuple[int, FloatArray, FloatArray]:
        """Take a step; return its outcome, the enables and the errors."""
        constants, memory = self._constants, self._memory
        error, enable = np.zeros(self._wheels), np.ones(self._wheels)
        if self._law is None:
            return assist_step(constants, memory, inputs, error, enable), enable, error
        ready, motion = receive(constants, memory, inputs)
        answer, problem = NO_HELP, ""
        if ready:
            answer, problem = ask(self._law, motion, error, enable, enabled=inputs.enabled)
        if problem:
            self._said[INTERNAL_ERROR] = Fault(AssistState.INTERNAL_ERROR, problem)
        outcome = act(constants, memory, inputs, Asked(ready, motion, answer), error, enable)
        return outcome, enable, error

    def _samples(self, demand: BrakeDemand) -> tuple[TwistSample, WheelSample, ImuSample]:
        """Return the checked samples of a demand."""
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
        """Return the validity of a sample, its stamp [ns] and copies of its arrays."""
        missing = [np.full(shape, np.nan) for shape in shapes.values()]
        if signal is None:
            return MISSING, 0, missing
        try:
            arrays = [
                real_array(getattr(signal, name), shape, words.get(name, name))
                for name, shape in shapes.items()
            ]
            return VALID, checked_stamp(signal.stamp_ns), arrays
        except ValueError as problem:
            if isinstance(signal, TwistSample):
                self._said[UNREADABLE] = Fault(AssistState.NON_FINITE_FEEDBACK, str(problem))
            return INVALID, 0, missing

    def _read_pedal(self, pedal: Any) -> float:
        """Return the demand; an unreadable one counts as full braking."""
        try:
            value = float(pedal)
        except (TypeError, ValueError, OverflowError):
            problem = f"pedal is {type(pedal).__name__}, not a number"
        else:
            if 0.0 <= value <= 1.0:  # not where it is not a number
                return value
            problem = f"pedal is {value:.4g}, must be 0 to 1"
        self._said[INVALID_DEMAND] = Fault(AssistState.INVALID_DEMAND, problem)
        return 1.0

    def _fault_in_words(self, code: int) -> Fault:
        """Return the fault of a condition, with the progress of recovery."""
        gate, wheel = self._memory.gate[0], int(self._memory.step[0]["dead"]) - 1
        row = CONDITIONS[code]
        values = {name: float(gate[name]) for name in ("value", "limit", "within")}
        fault = self._said.get(code) or Fault(
            row.state, row.words.format(wheel=self.geometry.names[wheel], **values)
        )
        if code != gate["cause"] or gate["good"] == 0:
            return fault
        progress = f"{gate['good']} of {self.configuration.recovery_count} good feedbacks since"
        return Fault(fault.state, f"{progress}: {fault.reason}")

    def _reason(self, outcome: int, fault: Fault | None) -> str:
        """Return the description of a condition."""
        if fault is not None and INACTIVE < outcome < SLOW:
            return fault.reason
        configuration = self.configuration
        limit = configuration.speed_threshold if outcome == SLOW else configuration.pedal_threshold
        words = CONDITIONS[outcome].words.format(limit=limit)
        dwell = configuration.minimum_dwell_time
        if outcome in (ASSISTING, DEAD_RECKONING) and dwell > 0.0:
            words += f", switched at most every {dwell:g} s"
        return words

    def _all_on(self, check: int, fault: Fault) -> Decision:
        """Put all brakes on for a fault; recovery starts again."""
        self._said[check] = fault
        memory = self._memory
        close_gate(memory.gate[0], check, 0.0, 0.0, 0.0)
        elapsed = max(self._stamp_ns - int(memory.step["switched_ns"][0]), 0)
        memory.step["switched_ns"] = self._stamp_ns
        memory.commanded[:] = 1.0
        open_valves(memory.valves, self._constants.dwell, float(elapsed))
        ones, zeros = np.ones(self._wheels), np.zeros(self._wheels)
        return Decision(self._stamp_ns, ones, zeros, fault.state, fault.reason, fault)
