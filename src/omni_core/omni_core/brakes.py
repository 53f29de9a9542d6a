"""Parameters of a wheel's brake: true values in the simulator, nominal values in the assistant."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from omni_core.configuration import Configuration, parameter
from omni_core.quantities import FloatArray

ON_OFF, PROPORTIONAL, VELOCITY = KINDS = ("on_off", "proportional", "velocity")
SPRING, TORQUE = "spring", "torque"


class BrakeKind(NamedTuple):
    """Properties of a kind of brake that simulator, assistant, adapter and tools use.

    Attributes:
        words: name of such brakes in a sentence.
        typical: typical values of the section `brake`; `kind` is the model of pressure and torque
            in the simulator and in the law.
        is_drive: whether a motor drive brakes the wheel, so that its torque and power limit the
            brake, and its command depends on the wheel speed.
        is_coil: whether a coil releases the brake, so that its operations need a minimum time
            between them.
        law: control law for a new vehicle, empty for the default. Without fast valves, the law of
            2013 lengthens the stop far more than `allocation`.
    """

    words: str
    typical: Mapping[str, Any]
    is_drive: bool = False
    is_coil: bool = False
    law: str = "allocation"


# Spring-applied electromagnetic brakes need 40 to 120 ms to act according to data sheets.
_SPRING = {"kind": ON_OFF, "dead_time": 0.06, "release_time": 0.1}
BRAKES = {
    ON_OFF: BrakeKind("on-off valves", {"kind": ON_OFF}, law=""),
    SPRING: BrakeKind("spring-applied brakes", _SPRING, is_coil=True),
    PROPORTIONAL: BrakeKind("proportional brakes", {"kind": PROPORTIONAL}),
    TORQUE: BrakeKind("drives with a torque command", {"kind": PROPORTIONAL}, is_drive=True),
    VELOCITY: BrakeKind("drives with a velocity command", {"kind": VELOCITY}, is_drive=True),
}
"""All kinds of brakes. `omni_vehicle.brake_adapter` computes their commands."""

TYPICAL = {name: kind.typical for name, kind in BRAKES.items()}
"""Typical values of the section `brake`, for each kind of brake."""

BRAKES_IN_WORDS = "kind of brakes: " + ", ".join(
    f"`{name}` for {kind.words}" for name, kind in BRAKES.items()
)
"""Description of an option with the kind of brakes."""


def typical_changes(brakes: str) -> tuple[str, ...]:
    """Return configuration overrides, such as ``vehicle.brake.dead_time=0.06``, for typical brakes.

    The overrides replace the kind and the timing of the vehicle's brakes, but not torque, power and
    ramp.

    Args:
        brakes: kind of the brakes, a key of `TYPICAL`.
    """
    timing = ("dead_time", "release_time", "time_constant")
    values = {key: getattr(BrakeConfiguration, key) for key in timing}
    values.update(TYPICAL[brakes])
    return tuple(f"vehicle.brake.{key}={value}" for key, value in values.items())


class BrakeConfiguration(Configuration):
    """Kind, limits and timing of each wheel's brake."""

    kind: str = parameter(ON_OFF, choices=KINDS)
    """Kind of brake: `on_off` for valves that are open if the enable is at least one half;
    `proportional` for brakes that follow any enable; `velocity` for motor drives whose speed
    command decreases along a ramp"""
    resolution: float = parameter(0.0, minimum=0.0, maximum=0.5)
    """Resolution of the enable of a brake of the kind `proportional` (0: continuous)"""
    max_torque: float = parameter(2000.0, unit="N m", minimum=0.0, maximum=1.0e6)
    """Torque of a wheel's brake when the pedal is fully down"""
    max_power: float = parameter(0.0, unit="W", minimum=0.0, maximum=1.0e9)
    """Limit on the braking power of a wheel (0: no limit), at which the torque falls with the
    speed, as of a braking electric drive"""
    ramp: float = parameter(3.0, unit="m/s^2", above=0.0, maximum=1000.0)
    """Deceleration of the rim that a brake of the kind `velocity` commands when the pedal is fully
    down"""
    dead_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=1.0)
    """Time after which the pressure in a brake begins to follow pedal and valve"""
    release_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=1.0)
    """Dead time for releasing a brake, if it is longer than `dead_time`, as in spring-applied
    brakes; 0 if both are equal"""
    time_constant: float = parameter(0.0, unit="s", minimum=0.0, maximum=10.0)
    """Time constant with which the pressure rises and falls after the dead time"""

    @property
    def pressure_step(self) -> float:
        """Resolution of the brake pressure [1]: 1 for on-off valves, 0 for a continuous brake."""
        return 1.0 if self.is_switched else self.resolution

    @property
    def is_switched(self) -> bool:
        """Whether the brake is either on or off."""
        return self.kind == ON_OFF

    @property
    def is_ramped(self) -> bool:
        """Whether the brake is a drive whose speed command decreases along a ramp."""
        return self.kind == VELOCITY

    @property
    def settling_time(self) -> float:
        """Time until a pressure change is 86 % complete [s]: dead time plus two time constants."""
        return self.dead_time + 2.0 * self.time_constant

    @property
    def releasing_time(self) -> float:
        """Time from a release until the pressure has dropped by 86 % [s]."""
        return self.settling_time + max(self.release_time - self.dead_time, 0.0)

    def limited(self, torque: FloatArray, speed: FloatArray) -> FloatArray:
        """Return brake torques [N m] within the limit on the braking power.

        Args:
            torque: torques before the limitation [N m], shape (N,).
            speed: rotational speeds of the wheels [rad/s], shape (N,).
        """
        power = self.max_power or math.inf
        return np.asarray(np.minimum(torque, power / np.maximum(np.abs(speed), 1e-9)))
