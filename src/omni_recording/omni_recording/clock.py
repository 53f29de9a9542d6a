"""Jumps of the clock during a recording, found in the times of one topic's messages.

The messages of a topic are recorded in the order in which they arrive, so their times increase if
the clock runs steadily. A single late message, messages of several publishers with different
delays, a pause of the recording, and a simulated time that runs at any rate are no jumps.
"""

import dataclasses

from omni_core.quantities import SECOND_NS

SHARED_TOPICS = frozenset({"/diagnostics", "/parameter_events", "/rosout", "/tf", "/tf_static"})
"""Topics on which several nodes may publish, so the stamps need not be in order"""

_STEP_NS = SECOND_NS // 8
"""Smallest step of a clock [ns]: NTP corrects smaller errors by the rate of the clock (STEPT of RFC
5905)."""

_START_NS = SECOND_NS
"""Time after the first message in which the delay may decrease: stored messages arrive late [ns]"""

_RETURN = 0.75
"""Time after which a clock that was set back has not reached its earlier time, as a share of the
change [1]; less than 1, because of the periods of the messages and the rate of the clock"""

_LONGEST_STALL_NS = 24 * 3600 * SECOND_NS
"""Longest plausible time for which messages are stored or a simulation is paused [ns]"""


@dataclasses.dataclass(frozen=True)
class Jump:
    """A jump of the clock between two messages of a topic.

    Attributes:
        number: number of the topic's messages before the jump.
        before_ns: time of the last message before the jump [ns].
        change_ns: change of the time from this message to the next [ns]; for a jump ahead, in
            addition to the change of the log time.
    """

    number: int
    before_ns: int
    change_ns: int

    def __str__(self) -> str:
        """Return a clause that names size and place."""
        way = "back" if self.change_ns < 0 else "ahead"
        return (
            f"the clock jumped {way} by {abs(self.change_ns) / SECOND_NS:.3f} s "
            f"after {self.before_ns / SECOND_NS:.3f} s (message {self.number} of the topic)"
        )


class ClockWatch:
    """Finds the jumps in the times of a topic, from message to message.

    A clock that was set back reaches its earlier time after as long as it was set back. The times
    after late messages reach it sooner, which distinguishes the two. A jump ahead is visible only
    relative to the log times; it is confirmed by the next message.
    """

    def __init__(self) -> None:
        self.log_jumps: list[Jump] = []
        """Jumps ahead of the log times by more than a day, relative to the times of the messages"""
        self.unset = 0
        """Number of messages without a time (0) that follow a message with a time"""
        self._jumps: list[Jump] = []
        self._number = 0
        self._first_log_ns = 0
        self._before = (0, 0)  # time and log time of the message before [ns]
        self._delay_step = 0  # change of the delay between the two messages before [ns]
        self._newest: list[int] = []  # the two largest times since the last jump [ns]
        self._delays: list[int] = []  # the two smallest delays since the last jump [ns]
        # A jump back that is not confirmed, and the log time that confirms it [ns].
        self._back: tuple[Jump, int] | None = None
        self._ahead: Jump | None = None  # not confirmed

    @property
    def jumps(self) -> tuple[Jump, ...]:
        """Jumps that were found so far; at the end, two messages are enough to confirm one."""
        back = [self._back[0]] if self._back and self._number - self._back[0].number > 1 else []
        return (*self._jumps, *back)

    def add(self, time_ns: int, log_ns: int) -> None:
        """Add the next message.

        Args:
            time_ns: time of the message, such as the stamp in its header [ns]; 0 for no time.
            log_ns: time at which the message was recorded [ns].
        """
        if time_ns == 0:
            self.unset += self._number > 0
            return
        if self._number == 0:
            self._first_log_ns = log_ns
        delay = log_ns - time_ns
        step = delay - (self._before[1] - self._before[0]) if self._number else 0
        # Equal times are those of a message that is published again.
        if step > _LONGEST_STALL_NS and time_ns > self._before[0]:
            self.log_jumps.append(Jump(self._number, self._before[1], step))
        self._look_back(time_ns, log_ns)
        self._look_ahead(delay, step, log_ns)
        if len(self._newest) < 2 or time_ns > self._newest[0]:
            self._newest = sorted((*self._newest, time_ns))[-2:]
        if len(self._delays) < 2 or delay < self._delays[1]:
            self._delays = sorted((*self._delays, delay))[:2]
        self._before, self._delay_step = (time_ns, log_ns), step
        self._number += 1

    def _look_back(self, time_ns: int, log_ns: int) -> None:
        behind = len(self._newest) == 2 and time_ns < self._newest[0]
        if self._back is None:
            late_ns = self._newest[0] - time_ns if behind else 0
            if late_ns > _STEP_NS:
                jump = Jump(self._number, self._before[0], time_ns - self._before[0])
                self._back = jump, log_ns + round(_RETURN * late_ns)
        elif log_ns >= self._back[1]:
            self._confirm(self._back[0])
        elif not behind:
            self._back = None

    def _look_ahead(self, delay: int, step: int, log_ns: int) -> None:
        if len(self._delays) < 2 or log_ns < self._before[1]:
            return
        least = self._delays[1]
        if self._ahead is not None:
            if delay < least - _STEP_NS:
                self._confirm(self._ahead)
            self._ahead = None
        elif (
            min(least, self._before[1] - self._before[0]) - delay > _STEP_NS + abs(self._delay_step)
        ) and log_ns - self._first_log_ns >= _START_NS:
            self._ahead = Jump(self._number, self._before[0], -step)

    def _confirm(self, jump: Jump) -> None:
        self._jumps.append(jump)
        self._newest, self._delays, self._back = [], [], None
