"""The brake assistant: which brakes may act, at every control step. Eqs. (44)-(46), section 3.3.

From the moment the pedal goes down the brake of wheel i acts while its error ``s_i`` is negative.
A valve that has just switched stays as it is for the minimum dwell time (`valve_dwell`). All
brakes act at once

- while the pedal is up (nothing is held back from a driver who does not brake),
- if no error is negative, so that the vehicle never rolls unbraked,
- once the fastest wheel centre is slower than the speed threshold, until the pedal is released or
  the speed rises clearly above it (a slope that the brakes cannot hold),
- whenever demand, wheels, time or feedback cannot be trusted: see `fail_safe`.

The line of motion to keep is that of the first trusted feedback with the pedal down. Until there
is one all brakes act. A gap in the feedback that is too long to know the heading across starts it
anew. A vehicle that only spins at that moment has no line to keep, so ``s_perp = 0``.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist.braking_line import LINE_SIZE, forget_line
from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.control_law import (
    MEMORY_SIZE,
    NO_HELP,
    SLOW,
    control_law,
    control_step,
)
from omni_brake_assist.decision import AssistState, BrakeDemand, Decision, Fault, Feedback
from omni_brake_assist.fail_safe import FeedbackMonitor, TwistSample, checked_stamp
from omni_brake_assist.sliding_manifold import SlidingManifold
from omni_brake_assist.valve_dwell import VALVE_SIZE, open_valves
from omni_brake_assist.weighting import weighting_function
from omni_platform.geometry import PlatformGeometry

__all__ = [
    "AssistState",
    "BrakeAssist",
    "BrakeAssistConfiguration",
    "BrakeDemand",
    "Decision",
    "Fault",
    "Feedback",
]

FloatArray = NDArray[np.float64]


class BrakeAssist:
    """Sliding-mode brake assistant of one vehicle.

    Attributes:
        geometry: the wheels; the rows of `Decision.enable` and `Decision.error` are in its order.
        manifold: the error functions.
    """

    def __init__(self, configuration: BrakeAssistConfiguration) -> None:
        self.configuration = configuration
        self.geometry = PlatformGeometry.from_wheels(configuration.wheels)
        self.manifold = SlidingManifold(
            self.geometry, weighting_function(configuration.weighting, configuration.k)
        )
        reach = float(np.max(np.hypot(*self.geometry.position.T)))
        self._monitor = FeedbackMonitor(configuration, reach)
        self._law = control_law(configuration, self.manifold.constants)
        self._memory = np.zeros(MEMORY_SIZE)
        self._valves = np.zeros((len(self.geometry.names), VALVE_SIZE))
        self._switched_ns = 0
        self._followed_ns = 0
        self._wheels_fault: Fault | None = None
        self._stamp_ns = 0
        # Loads the kernel: the first real step is as fast as the others.
        self._step(TwistSample(0, 0.0, 0.0, 0.0), braking=False)

    def update(self, demand: BrakeDemand) -> Decision:
        """Decide which brakes may act.

        Total: whatever the demand holds, the decision is finite and its enables are 0 or 1.

        Args:
            demand: pedal and latest feedback, in order of their stamps.
        """
        try:
            return self._decide(demand)
        except Exception as error:  # a fault of the assistant must not cost a brake
            fault = Fault(AssistState.INTERNAL_ERROR, f"{type(error).__name__}: {error}")
            self._monitor.distrust(fault)
            return self._all_on(fault)

    def timeout(self, stamp_ns: int, silence: Fault) -> Decision:
        """Decide after messages have failed to arrive: all brakes on, trust is to be earned anew.

        Args:
            stamp_ns: time of the decision [ns].
            silence: NO_DEMAND, NO_FEEDBACK or STALE_FEEDBACK, and what has not come for how long.
        """
        self._monitor.distrust(silence)
        self._stamp_ns = stamp_ns
        return self._all_on(silence)

    def switch(self, *, enabled: bool) -> None:
        """Let the assistant release brakes from the next decision on, or no longer."""
        self.configuration = dataclasses.replace(self.configuration, enabled=enabled)

    def check_wheel_names(self, names: Iterable[str]) -> Fault | None:
        """Compare the wheels that the vehicle reports with those of the configuration.

        A difference keeps all brakes on until a later report fits. Without any report the
        configuration is believed.

        Args:
            names: reported wheels, in any order.

        Returns:
            What is wrong with them; None if nothing is.
        """
        self._wheels_fault = self._compare_wheels(names)
        return self._wheels_fault

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
        try:
            self._stamp_ns = checked_stamp(demand.stamp_ns)
        except ValueError as problem:
            fault = Fault(AssistState.INVALID_DEMAND, f"demand: {problem}")
            self._monitor.distrust(fault)
            return self._all_on(fault)
        pedal = _read_pedal(demand.pedal)
        # A pedal that nobody can read is taken for a full braking request.
        invalid = pedal if isinstance(pedal, Fault) else None
        braking = isinstance(pedal, Fault) or pedal >= self.configuration.pedal_threshold
        sample = self._monitor.judge(self._stamp_ns, demand.feedback, braking=braking)
        fault_now = invalid or self._wheels_fault or self._monitor.fault
        outcome, enable, error = self._step(sample, braking=braking)
        state, reason = self._state(braking, fault_now, outcome)
        if state is not AssistState.ASSISTING:
            enable = self._open_valves()
        return Decision(self._stamp_ns, enable, error, state, reason, fault_now)

    def _step(
        self, sample: TwistSample | None, *, braking: bool
    ) -> tuple[int, FloatArray, FloatArray]:
        """Apply the control law; return its outcome, the enables and the errors."""
        used = sample or TwistSample(self._followed_ns, 0.0, 0.0, 0.0)
        dt = (used.stamp_ns - self._followed_ns) * 1e-9
        if sample is not None:
            self._followed_ns = sample.stamp_ns
            if not 0.0 <= dt <= self.configuration.maximum_time_step:
                forget_line(self._memory[:LINE_SIZE])  # the heading is not known across the gap
                dt = 0.0
        wheels = len(self.geometry.names)
        error, enable = np.empty(wheels), np.empty(wheels)
        outcome = control_step(
            self._law,
            self._memory,
            self._valves,
            self._elapsed(),
            braking,
            sample is not None,
            self._monitor.fault is None,
            dt,
            used.v_x,
            used.v_y,
            used.yaw_rate,
            error,
            enable,
        )
        return outcome, enable, error

    def _elapsed(self) -> float:
        """Return the time since it was last asked for [ns]; time that runs back counts as none."""
        elapsed = max(self._stamp_ns - self._switched_ns, 0)
        self._switched_ns = self._stamp_ns
        return float(elapsed)

    def _open_valves(self) -> FloatArray:
        """Let all brakes act and return the enables."""
        open_valves(self._valves, self._law.dwell, self._elapsed())
        return np.ones(len(self._valves))

    def _state(self, braking: bool, fault: Fault | None, outcome: int) -> tuple[AssistState, str]:
        configuration = self.configuration
        if not configuration.enabled:
            return AssistState.DISABLED, "assistant is switched off"
        if not braking:
            return AssistState.INACTIVE, f"pedal below {configuration.pedal_threshold:g}"
        if fault is not None:
            return fault.state, fault.reason
        if outcome == SLOW:
            return (
                AssistState.BELOW_SPEED_THRESHOLD,
                f"wheel speed fell below {configuration.speed_threshold:g} m/s",
            )
        if outcome == NO_HELP:
            return AssistState.ALL_ERRORS_POSITIVE, "no error is negative"  # section 3.3
        dwell = configuration.minimum_dwell_time
        within = f", switched at most every {dwell:g} s" if dwell > 0.0 else ""
        return AssistState.ASSISTING, f"brakes with a negative error are on{within}"

    def _all_on(self, fault: Fault) -> Decision:
        enable = self._open_valves()
        return Decision(
            self._stamp_ns, enable, np.zeros(len(enable)), fault.state, fault.reason, fault
        )


def _read_pedal(pedal: Any) -> float | Fault:
    try:
        value = float(pedal)
    except (TypeError, ValueError, OverflowError):
        return Fault(AssistState.INVALID_DEMAND, f"pedal is {type(pedal).__name__}, not a number")
    if not 0.0 <= value <= 1.0:  # also where it is not a number
        return Fault(AssistState.INVALID_DEMAND, f"pedal is {value:.4g}, must be 0 to 1")
    return value
