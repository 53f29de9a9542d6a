"""Progress of a simulated run, and the conditions under which it ends."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_core.kernels import lean
from omni_core.quantities import SECOND_NS, FloatArray
from omni_sim.configuration import SimulatorConfiguration
from omni_sim.simulator import Observation

_NEWS = 0.01  # smallest change of the completed share that is reported [1]
_REACH = 1.0  # radius that converts a yaw rate to a speed [m]

# States of a run.
RUNNING, STOPPED, TIME_LIMIT = range(3)
_OUTCOMES = ("running", "stopped", "time limit")

_REST = np.dtype([("still", "?"), ("since", "f8")])  # whether at rest, and since which time [s]


class End(NamedTuple):
    """Conditions under which a run ends; all but `earliest` are from `SimulationConfiguration`.

    Attributes:
        rest_speed: speed below which the vehicle is at rest [m/s].
        settling_time: required time at rest [s].
        duration_limit: time at which a run ends at the latest [s].
        earliest: time before which a run does not end, even if the vehicle is at rest [s].
    """

    rest_speed: float
    settling_time: float
    duration_limit: float
    earliest: float


def run_end(configuration: SimulatorConfiguration) -> End:
    """Return the conditions under which a run ends."""
    given, earliest = configuration.simulation, configuration.maneuver.earliest_end
    return End(given.rest_speed, given.settling_time, given.duration_limit, earliest)


def rest_memory() -> NDArray[np.void]:
    """Return the initial value of the memory that `run_outcome` updates, shape (1,)."""
    return np.zeros(1, _REST)


@lean
def largest_speed(twist: FloatArray) -> float:
    """Return the largest speed among all points at a distance of 1 m from base_link [m/s].

    Args:
        twist: body twist (v_x, v_y [m/s], yaw rate [rad/s]), shape (3,).
    """
    speed: float = math.hypot(twist[0], twist[1]) + _REACH * abs(twist[2])
    return speed


@lean
def run_outcome(end: End, memory: Any, stamp_ns: int, pedal: float, speed: float) -> int:
    """Update the memory at a control stamp, and return RUNNING, STOPPED or TIME_LIMIT.

    Args:
        end: conditions for the end.
        memory: memory from `rest_memory`, changed in place.
        stamp_ns: time since the start of the run [ns].
        pedal: brake demand of the driver, 0 to 1.
        speed: result of `largest_speed` [m/s].
    """
    rest, time = memory[0], stamp_ns / SECOND_NS
    if pedal <= 0.0 or speed > end.rest_speed:
        rest.still = False
    elif not rest.still:
        rest.still = True
        rest.since = time
    if rest.still and time - rest.since >= end.settling_time and time >= end.earliest:
        return STOPPED
    return TIME_LIMIT if time >= end.duration_limit else RUNNING


class RunProgress:
    """Tracks progress and end of a run from the observations of the simulator.

    A run ends when the vehicle has been at rest for the settling time after the start of braking,
    or when the run reaches the limit on its duration.
    """

    def __init__(self, configuration: SimulatorConfiguration) -> None:
        self._end = run_end(configuration)
        self._rest = rest_memory()
        self._brake_time = configuration.maneuver.brake_time
        self._time = 0.0
        self._initial_speed = 0.0
        self._speed = 0.0
        self._share = 0.0
        self._reported_share = -1.0
        self.outcome = "running"

    @property
    def finished(self) -> bool:
        """Whether the run has ended."""
        return self.outcome != "running"

    @property
    def is_news(self) -> bool:
        """Whether the completed share has increased by at least 1 % since the last report."""
        return self._share - self._reported_share >= _NEWS

    def update(self, observation: Observation) -> None:
        """Update progress and outcome with the latest observation."""
        self._time = observation.stamp_ns / SECOND_NS
        self._speed = largest_speed(observation.twist)
        self._initial_speed = max(self._initial_speed, self._speed)
        self.outcome = _OUTCOMES[
            run_outcome(self._end, self._rest, observation.stamp_ns, observation.pedal, self._speed)
        ]
        self._share = max(self._share, self._share_now(observation.pedal))

    def report(self) -> dict[str, float]:
        """Return time [s], speed [m/s] and completed share (0 to 1) for a progress bar."""
        self._reported_share = self._share
        return {"time": self._time, "speed": self._speed, "share": self._share}

    def _share_now(self, pedal: float) -> float:
        if self.finished:
            return 1.0
        if self._end.earliest > 0.0:  # the demands have a known end
            return min(0.99, self._time / self._end.earliest)
        cruise = 0.2  # share of the bar for the time before braking
        if pedal <= 0.0:
            return cruise * min(1.0, self._time / max(self._brake_time, 1e-9))
        slowed = 1.0 - self._speed / self._initial_speed if self._initial_speed > 0.0 else 1.0
        return cruise + (0.99 - cruise) * max(0.0, slowed)
