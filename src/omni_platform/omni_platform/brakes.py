"""Parameters of a wheel's brake, true for the simulator and nominal for the assistant."""

import dataclasses

from omni_platform.configuration import Configuration, parameter

ON_OFF, PROPORTIONAL = "on_off", "proportional"


@dataclasses.dataclass(frozen=True, kw_only=True)
class BrakeConfiguration(Configuration):
    """The brake of each wheel."""

    kind: str = parameter(ON_OFF, choices=(ON_OFF, PROPORTIONAL))
    """What lets pressure pass: 'on_off' valves, open from an enable of one half on, or
    'proportional' brakes, electric or by servo valves, that follow any enable"""
    resolution: float = parameter(0.0, minimum=0.0, maximum=0.5)
    """Step of the enable that a proportional brake resolves (0: any)"""
    max_torque: float = parameter(2000.0, unit="N m", minimum=0.0, maximum=1.0e6)
    """Torque of a wheel's brake with the pedal fully down"""
    max_power: float = parameter(0.0, unit="W", minimum=0.0, maximum=1.0e9)
    """Largest power of a wheel's brake, beyond which its torque falls with the speed, as of an
    electric drive that brakes (0: no limit)"""
    dead_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=1.0)
    """Time until the pressure in a brake begins to follow pedal and valve"""
    release_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=1.0)
    """Time until the pressure begins to fall after a release, where that is longer than dead_time,
    as of spring-applied brakes (0: dead_time)"""
    time_constant: float = parameter(0.0, unit="s", minimum=0.0, maximum=10.0)
    """Time constant with which the pressure then builds up and falls"""

    @property
    def grain(self) -> float:
        """Smallest step of the brake pressure [1], 0 for a continuous brake."""
        return 1.0 if self.kind == ON_OFF else self.resolution
