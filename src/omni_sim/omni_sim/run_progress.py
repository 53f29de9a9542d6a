"""How far a run is, and when it is over."""

from __future__ import annotations

import numpy as np

from omni_sim.simulator import Observation, SimulatorConfiguration

_SECOND = 1e9
_NEWS = 0.01  # smallest change of the share worth telling


class RunProgress:
    """Follows a run from its observations.

    A run is over when the vehicle has stood still for the settling time after the pedal went
    down, or at the limit of its duration.
    """

    def __init__(self, configuration: SimulatorConfiguration) -> None:
        self._simulation = configuration.simulation
        self._brake_time = configuration.maneuver.brake_time
        self._time = 0.0
        self._initial_speed = 0.0
        self._speed = 0.0
        self._still_since: float | None = None
        self._share = 0.0
        self._told_share = -1.0
        self.outcome = "running"

    @property
    def finished(self) -> bool:
        """Whether the run is over."""
        return self.outcome != "running"

    @property
    def is_news(self) -> bool:
        """Whether the share done has visibly grown since the last report."""
        return self._share - self._told_share >= _NEWS

    def update(self, observation: Observation) -> None:
        """Take the newest observation into account."""
        self._time = observation.stamp_ns / _SECOND
        reach = 1.0  # [m] turns a yaw rate into a speed at the rim of the platform
        self._speed = float(np.hypot(*observation.twist[:2])) + reach * abs(observation.twist[2])
        self._initial_speed = max(self._initial_speed, self._speed)
        moving = self._speed > self._simulation.rest_speed
        if observation.pedal <= 0.0 or moving:
            self._still_since = None
        elif self._still_since is None:
            self._still_since = self._time
        if (
            self._still_since is not None
            and self._time - self._still_since >= self._simulation.settling_time
        ):
            self.outcome = "stopped"
        elif self._time >= self._simulation.duration_limit:
            self.outcome = "time limit"
        self._share = max(self._share, self._share_now(observation.pedal))

    def report(self) -> dict[str, float]:
        """Return time [s], speed [m/s] and the share done [0..1] for a progress bar."""
        self._told_share = self._share
        return {"time": self._time, "speed": self._speed, "share": self._share}

    def _share_now(self, pedal: float) -> float:
        if self.finished:
            return 1.0
        cruise = 0.2  # share of the bar given to the time before the pedal goes down
        if pedal <= 0.0:
            return cruise * min(1.0, self._time / max(self._brake_time, 1e-9))
        slowed = 1.0 - self._speed / self._initial_speed if self._initial_speed > 0.0 else 1.0
        return cruise + (0.99 - cruise) * max(0.0, slowed)
