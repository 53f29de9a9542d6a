"""Parameters of a wheel's brake: true values in the simulator, nominal ones in the assistant."""

from collections.abc import Mapping

from omni_platform.configuration import Configuration, parameter

ON_OFF, PROPORTIONAL, VELOCITY = KINDS = ("on_off", "proportional", "velocity")
SPRING, TORQUE = "spring", "torque"

TYPICAL: Mapping[str, Mapping[str, str | float]] = {
    ON_OFF: {"kind": ON_OFF},
    SPRING: {"kind": ON_OFF, "dead_time": 0.06, "release_time": 0.1},
    PROPORTIONAL: {"kind": PROPORTIONAL},
    TORQUE: {"kind": PROPORTIONAL},
    VELOCITY: {"kind": VELOCITY},
}
"""Typical values of a section `brake`: on-off valves; spring-applied electromagnetic brakes, whose
data sheets state 40 to 120 ms; proportional brakes; drives with a torque or a speed command"""


def typical_changes(brakes: str) -> tuple[str, ...]:
    """Return the overrides that give a vehicle the brakes with this name in `TYPICAL`."""
    return tuple(f"vehicle.brake.{key}={value}" for key, value in TYPICAL[brakes].items())


class BrakeConfiguration(Configuration):
    """The brake of each wheel."""

    kind: str = parameter(ON_OFF, choices=KINDS)
    """Kind of the brake: 'on_off' valves, which are open if the enable is at least one half;
    'proportional' brakes, electric or with servo valves, that follow any enable; or
    'velocity' drives, whose speed command falls along a ramp"""
    resolution: float = parameter(0.0, minimum=0.0, maximum=0.5)
    """Step of the enable that a proportional brake resolves (0: any)"""
    max_torque: float = parameter(2000.0, unit="N m", minimum=0.0, maximum=1.0e6)
    """Torque of a wheel's brake with the pedal fully down"""
    max_power: float = parameter(0.0, unit="W", minimum=0.0, maximum=1.0e9)
    """Largest power of a wheel's brake, above which its torque falls with the speed, as with a
    braking electric drive (0: no limit)"""
    ramp: float = parameter(3.0, unit="m/s^2", above=0.0, maximum=1000.0)
    """Deceleration that a velocity drive commands the rim of its wheel with the pedal fully down"""
    dead_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=1.0)
    """Time until the pressure in a brake begins to follow pedal and valve"""
    release_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=1.0)
    """Time until the pressure begins to fall after a release, if that is longer than dead_time,
    as with spring-applied brakes (0: dead_time)"""
    time_constant: float = parameter(0.0, unit="s", minimum=0.0, maximum=10.0)
    """Time constant with which the pressure builds up and falls after the dead time"""

    @property
    def pressure_step(self) -> float:
        """Smallest step of the brake pressure [1], 0 for a continuous brake."""
        return 1.0 if self.kind == ON_OFF else self.resolution
