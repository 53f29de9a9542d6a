"""Command-line options of stopping areas."""

import math

from omni_core.commands.command_options import option, overrides_option
from omni_core.configuration import ConfigurationError, parameter
from omni_tools.campaign.runner import CampaignOptions


class AreaOptions(CampaignOptions):
    """Command-line options: motions, ground, load, coverage and confidence of stopping areas."""

    vehicle: str = parameter("mecanum_forklift")
    """vehicle: a file of config/vehicles/, a path, or a vehicle's folder; the load in the file is
    used as the worst case: maximum mass at maximum offset"""
    unassisted: bool = parameter(False)
    """compute the areas for stops without the brake assistant"""
    speed: float = parameter(2.0, unit="m/s", above=0.0, maximum=20.0)
    """maximum speed, in every direction, unless --speed-x and --speed-y are given"""
    speed_x: float | None = option(None, unit="m/s", above=0.0, maximum=20.0)
    """limit on v_x forward and backward, if Nav2 limits v_x and v_y separately"""
    speed_y: float | None = option(None, unit="m/s", above=0.0, maximum=20.0)
    """limit on v_y to the left and to the right"""
    bands: int = parameter(1, minimum=1, maximum=20)
    """number of speed bands; more bands make the areas at low speeds smaller; a single band is
    right for every version of Nav2's collision monitor; several bands need Jazzy 1.3.12 or later,
    or Lyrical, because the monitors of Jazzy up to 1.3.11 and Kilted up to 1.4.2 compare v_x"""
    yaw_rate: float = parameter(0.5, unit="rad/s", above=0.0, maximum=10.0)
    """maximum yaw rate, in both directions"""
    turns: int = parameter(1, minimum=1, maximum=9)
    """number of yaw-rate bands; with 3 instead of 1, the areas of straight motion are smaller"""
    friction_min: float = parameter(0.6, minimum=0.05, maximum=2.0)
    """lowest friction factor of the ground"""
    friction_max: float = parameter(1.0, minimum=0.05, maximum=2.0)
    """highest friction factor of the ground"""
    reaction_time: float = parameter(0.2, unit="s", minimum=0.0, maximum=5.0)
    """time from an obstacle's entry into the area to the pedal: sensor, monitor, network"""
    padding: float = parameter(0.0, unit="m", minimum=0.0, maximum=5.0)
    """margin added around every area"""
    coverage: float = parameter(0.99, minimum=0.5, maximum=0.9999)
    """share of stops that stay within the area of their motion"""
    confidence: float = parameter(0.95, minimum=0.5, maximum=0.9999)
    """confidence with which each area has this coverage"""
    held_out: int = parameter(1000, minimum=0, maximum=10_000_000)
    """number of held-out stops with which the areas are checked"""
    seed: int = parameter(1, minimum=0)
    """seed of all random numbers"""
    overrides: tuple[str, ...] = overrides_option("vehicle.brake.max_torque=900")

    def check_consistency(self) -> None:
        """Check that options do not contradict each other."""
        super().check_consistency()
        if (self.speed_x is None) != (self.speed_y is None):
            given, other = ("x", "y") if self.speed_y is None else ("y", "x")
            raise ConfigurationError(f"--speed-{given}", f"needs --speed-{other}, too")
        if self.friction_min > self.friction_max:
            lowest, highest = self.friction_min, self.friction_max
            problem = f"{lowest:g} must not be above --friction-max, {highest:g}"
            raise ConfigurationError("--friction-min", problem)

    @property
    def limits(self) -> tuple[float, float] | None:
        """Limits on v_x and v_y [m/s]; None if only the speed is limited."""
        if self.speed_x is None or self.speed_y is None:
            return None
        return self.speed_x, self.speed_y

    @property
    def top_speed(self) -> float:
        """Highest speed of all motions [m/s]."""
        return self.speed if self.limits is None else math.hypot(*self.limits)

    @property
    def variant(self) -> str:
        """Name of the experiment's variant: ``assisted`` or ``unassisted``."""
        return "unassisted" if self.unassisted else "assisted"
