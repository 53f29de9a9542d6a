"""The dissertation's velocity sensor: sampled, noisy, with an offset, Eqs. (60), (61).

It can be told to fail for a while, in one of the ways in which real ones do: it repeats its last
reading, reads zero, or says that it has no value.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from omni_platform.configuration import Configuration, parameter

FloatArray = NDArray[np.float64]

FAILURES = ("none", "frozen", "zero", "invalid")
"""What the sensor may do while it fails: hold its last reading, read 0, or read no number."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class VelocitySensorConfiguration(Configuration):
    """Sampling and errors of the velocity sensor; without noise or offset by default."""

    sample_time: float = parameter(
        0.01,
        description="Time between samples; the last one is held in between",
        unit="s",
        minimum=1.0e-6,
        maximum=10.0,
    )
    linear_noise: float = parameter(
        0.0,
        description="Half width of the uniform noise on v_x and v_y, as a share of the true value",
        minimum=0.0,
        maximum=10.0,
    )
    yaw_rate_noise: float = parameter(
        0.0,
        description="Half width of the uniform noise on the yaw rate, as a share of the true value",
        minimum=0.0,
        maximum=10.0,
    )
    offset_x: float = parameter(0.0, description="Constant error of v_x", unit="m/s")
    offset_y: float = parameter(0.0, description="Constant error of v_y", unit="m/s")
    yaw_rate_offset: float = parameter(
        0.0, description="Constant error of the yaw rate", unit="rad/s"
    )
    failure: str = parameter(
        "none",
        description="What it does while it fails: 'frozen' holds the last reading, 'zero' reads 0, "
        "'invalid' reads no number",
        choices=FAILURES,
    )
    failure_time: float = parameter(
        0.0, description="Time at which it fails", unit="s", minimum=0.0, maximum=3600.0
    )
    failure_duration: float = parameter(
        3600.0, description="For how long it fails", unit="s", above=0.0, maximum=3600.0
    )

    @property
    def failure_ns(self) -> tuple[int, int]:
        """From when and until before when it fails [ns], the same where it never does."""
        start = round(self.failure_time * 1e9)
        fails = self.failure != "none"
        return start, start + (round(self.failure_duration * 1e9) if fails else 0)


class VelocitySensor:
    """A sensor of the body twist with zero-order hold.

    Attributes:
        configuration: sampling and errors.
    """

    def __init__(
        self, configuration: VelocitySensorConfiguration, random: np.random.Generator
    ) -> None:
        """Make a sensor that has not sampled yet.

        Args:
            configuration: sampling and errors.
            random: source of the noise.
        """
        self.configuration = configuration
        self._random = random
        self._period_ns = round(configuration.sample_time * 1e9)
        self._fails_from, self._fails_until = configuration.failure_ns
        self._sample = -1
        self._held: FloatArray = np.zeros(3)

    def measure(self, stamp_ns: int, twist: FloatArray) -> FloatArray:
        """Return what the sensor reads.

        Samples are due at multiples of the sample time; one is taken at the first call at or
        after that time, so repeated calls with one stamp return the same reading. A sensor that
        fails takes none.

        Args:
            stamp_ns: time since the start of the run [ns], not decreasing.
            twist: true body twist [m/s, m/s, rad/s], shape (3,).

        Returns:
            Measured body twist [m/s, m/s, rad/s], shape (3,).
        """
        if self._fails_from <= stamp_ns < self._fails_until:
            return self._failed_reading()
        sample = stamp_ns // self._period_ns
        if sample > self._sample:
            self._sample = sample
            c = self.configuration
            share = np.array([c.linear_noise, c.linear_noise, c.yaw_rate_noise])
            offset = np.array([c.offset_x, c.offset_y, c.yaw_rate_offset])
            noise = share * self._random.uniform(-1.0, 1.0, 3)
            self._held = twist * (1.0 + noise) + offset  # Eqs. (60), (61)
        return self._held.copy()

    def _failed_reading(self) -> FloatArray:
        if self.configuration.failure == "frozen":
            return self._held.copy()
        return np.full(3, np.nan if self.configuration.failure == "invalid" else 0.0)
