"""Exposure, optics and noise of the line cameras (section 4.4)."""

from __future__ import annotations

import dataclasses

from omni_platform.configuration import Configuration, ConfigurationError, parameter

TELECENTRIC, ORDINARY = "telecentric", "ordinary"

_FULL_SCALE = 255.0  # gray levels
_MOST_WIDENING = 1.25  # of a view by the heave of the camera, beyond which it is no sharp one


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraConfiguration(Configuration):
    """Exposure and optics of the line cameras."""

    noise: float = parameter(
        1.0,
        description="Standard deviation of white noise, in gray levels of an 8-bit scale",
        minimum=0.0,
        maximum=100.0,
    )
    signal_to_noise_db: float = parameter(
        0.0,
        description="Full scale over the standard deviation of white noise, instead of noise; 0 "
        "to use noise",
        unit="dB",
        minimum=0.0,
        maximum=200.0,
    )
    bit_depth: int = parameter(
        8, description="Bits of a pixel, 8 or 16", unit="bit", minimum=8, maximum=16
    )
    gain: float = parameter(
        1.0, description="Factor from the ground's gray level to the camera's", above=0.0
    )
    offset: float = parameter(
        0.0, description="Brightness added to every pixel, in gray levels of an 8-bit scale"
    )
    exposure_time: float = parameter(
        0.0,
        description="Time over which a line is exposed, half before and half after its stamp; "
        "motion blurs the line meanwhile",
        unit="s",
        minimum=0.0,
        maximum=1.0,
    )
    lens: str = parameter(
        TELECENTRIC,
        description="Whether the magnification is the same at every height or goes with it",
        choices=(TELECENTRIC, ORDINARY),
    )
    working_distance: float = parameter(
        0.1,
        description="Distance of an ordinary lens from the ground at which the field of view is "
        "as configured",
        unit="m",
        above=0.0,
        maximum=10.0,
    )
    height_error: float = parameter(
        0.0,
        description="Mounting height above that distance",
        unit="m",
        minimum=-10.0,
        maximum=10.0,
    )
    shading: float = parameter(
        0.0,
        description="Share of the brightness lost at both ends of a line, by the square of the "
        "distance from its middle",
        minimum=0.0,
        maximum=1.0,
    )
    dirt_spots: int = parameter(
        0, description="Specks of dirt on the optics, at random places", minimum=0, maximum=1000
    )
    dirt_size: float = parameter(
        0.002,
        description="Mean diameter of their blurred shadows, measured on the ground",
        unit="m",
        above=0.0,
        maximum=1.0,
    )
    dirt_opacity: float = parameter(
        0.5,
        description="Share of the light lost in the middle of a shadow",
        minimum=0.0,
        maximum=1.0,
    )
    photo_response: float = parameter(
        0.0,
        description="Standard deviation of the pixels' gains (PRNU)",
        minimum=0.0,
        maximum=0.5,
    )
    dark_signal: float = parameter(
        0.0,
        description="Standard deviation of the pixels' offsets (DSNU), in gray levels of an 8-bit "
        "scale",
        minimum=0.0,
        maximum=100.0,
    )
    dark_steps: float = parameter(
        0.0,
        description="Difference of the offsets of neighboring eighths of a line, which are read "
        "out by different amplifiers, in gray levels of an 8-bit scale",
        minimum=0.0,
        maximum=100.0,
    )
    stuck_pixels: int = parameter(
        0, description="Pixels that are always black or always white", minimum=0, maximum=1000
    )
    hot_pixels: int = parameter(
        0,
        description="Pixels with 20 to 120 gray levels of dark signal",
        minimum=0,
        maximum=1000,
    )
    mud: float = parameter(
        0.0,
        description="Share of the view, from the end of the line, hidden by mud on the optics",
        minimum=0.0,
        maximum=0.9,
    )
    shadow: float = parameter(
        0.0,
        description="Share of the light lost in a shadow that does not move with the ground",
        minimum=0.0,
        maximum=1.0,
    )
    shadow_speed: float = parameter(
        0.0,
        description="Frequency at which the shadow's edge oscillates along the line; 0 for an "
        "edge fixed in the view",
        unit="m/s",
        minimum=0.0,
        maximum=100.0,
    )

    @property
    def noise_deviation(self) -> float:
        """Standard deviation of the noise [gray levels of an 8-bit scale]."""
        if self.signal_to_noise_db > 0.0:
            return float(_FULL_SCALE / 10.0 ** (self.signal_to_noise_db / 20.0))
        return self.noise

    @property
    def magnification(self) -> float:
        """Seen length of ground over the configured one [1]: 1 + h / d of an ordinary lens."""
        if self.lens == TELECENTRIC:
            return 1.0
        return 1.0 + self.height_error / self.working_distance

    def widening(self, rise: float) -> float:
        """Return the factor on the field of view of a raised camera [m], within limits."""
        if self.lens == TELECENTRIC:
            return 1.0
        widened = 1.0 + rise / (self.working_distance + self.height_error)
        return min(max(widened, 1.0 / _MOST_WIDENING), _MOST_WIDENING)

    @property
    def most_widening(self) -> float:
        """Largest factor that `widening` returns."""
        return 1.0 if self.lens == TELECENTRIC else _MOST_WIDENING

    def check_consistency(self) -> None:
        """Refuse a bit depth without image encoding, and a camera under the ground.

        Raises:
            ConfigurationError: the bit depth or the height error is invalid.
        """
        if self.bit_depth not in {8, 16}:
            raise ConfigurationError("bit_depth", f"{self.bit_depth} bit is neither 8 nor 16 bit")
        if self.height_error <= -self.working_distance:
            raise ConfigurationError(
                "height_error",
                f"{self.height_error:g} m is below the ground, must be above "
                f"{-self.working_distance:g} m",
            )
