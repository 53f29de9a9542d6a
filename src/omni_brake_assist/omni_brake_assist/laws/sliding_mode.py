"""Sliding-mode law: a brake acts while the error of its wheel is negative.

Source: dissertation (2013), Eqs. (44)-(46).
"""

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.laws.law import ASSIST, NO_HELP, Motion
from omni_brake_assist.sliding_manifold import Manifold, SlidingManifold, wheel_error
from omni_brake_assist.weighting import weighting_function
from omni_platform.geometry import PlatformGeometry
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray


@lean
def step(manifold: Manifold, motion: Motion, error: FloatArray, enable: FloatArray) -> int:
    """Enable the brakes of wheels with a negative error; see `Law.step` for arguments."""
    outcome = NO_HELP
    for i in range(error.size):
        s_perp, s_omega, s_par = wheel_error(
            manifold, i, motion.v_x, motion.v_y, motion.yaw_rate, motion.across_x, motion.across_y
        )
        error[i] = s_perp + s_omega + s_par  # Eq. (44)
        enable[i] = 1.0 if error[i] < 0.0 else 0.0  # Eqs. (45), (46)
        if error[i] < 0.0:
            outcome = ASSIST
    return outcome


class SlidingMode:
    """The law `sliding_mode` with the interface `Law`, for use from Python.

    Attributes:
        manifold: error functions of the wheels.
    """

    def __init__(self, configuration: BrakeAssistConfiguration, geometry: PlatformGeometry) -> None:
        weighting = weighting_function(configuration.weighting, configuration.k)
        self.manifold = SlidingManifold(geometry, weighting)

    def step(self, motion: Motion, error: FloatArray, enable: FloatArray) -> int:
        """Enable the brakes of wheels with a negative error; implements `Law.step`."""
        return int(step(self.manifold.constants, motion, error, enable))
