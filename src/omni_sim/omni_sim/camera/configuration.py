"""Exposure, optics and noise of the line cameras (section 4.4)."""

from omni_platform.configuration import Configuration, ConfigurationError, parameter

TELECENTRIC, ORDINARY = "telecentric", "ordinary"

FULL_SCALE = 255.0
"""The brightest of the 8-bit gray levels."""
_MOST_WIDENING = 1.25  # largest factor on a view by the camera's heave: beyond, it is not sharp


class CameraConfiguration(Configuration):
    """Exposure and optics of the line cameras."""

    noise: float = parameter(1.0, minimum=0.0, maximum=100.0)
    """Standard deviation of white noise, in gray levels of an 8-bit scale"""
    signal_to_noise_db: float = parameter(0.0, unit="dB", minimum=0.0, maximum=200.0)
    """Full scale over the standard deviation of white noise, instead of noise; 0 to use noise"""
    bit_depth: int = parameter(8, unit="bit", minimum=8, maximum=16)
    """Bits of a pixel, 8 or 16"""
    gain: float = parameter(1.0, above=0.0)
    """Factor from the ground's gray level to the camera's"""
    offset: float = parameter(0.0)
    """Brightness added to every pixel, in gray levels of an 8-bit scale"""
    exposure_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=1.0)
    """Time over which a line is exposed, half before and half after its stamp; motion blurs the
    line"""
    lens: str = parameter(TELECENTRIC, choices=(TELECENTRIC, ORDINARY))
    """Whether the magnification is the same at every height (telecentric) or depends on the
    height"""
    working_distance: float = parameter(0.1, unit="m", above=0.0, maximum=10.0)
    """Distance of an ordinary lens from the ground at which the field of view is as configured"""
    height_error: float = parameter(0.0, unit="m", minimum=-10.0, maximum=10.0)
    """Mounting height minus the working distance"""
    shading: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Share of the brightness lost at both ends of a line, by the square of the distance from its
    middle"""
    dirt_spots: int = parameter(0, minimum=0, maximum=1000)
    """Specks of dirt on the optics, at random places"""
    dirt_size: float = parameter(0.002, unit="m", above=0.0, maximum=1.0)
    """Mean diameter of the blurred shadows of the specks, measured on the ground"""
    dirt_opacity: float = parameter(0.5, minimum=0.0, maximum=1.0)
    """Share of the light lost in the middle of a shadow"""
    photo_response: float = parameter(0.0, minimum=0.0, maximum=0.5)
    """Standard deviation of the pixels' gains (PRNU)"""
    dark_signal: float = parameter(0.0, minimum=0.0, maximum=100.0)
    """Standard deviation of the pixels' offsets (DSNU), in gray levels of an 8-bit scale"""
    dark_steps: float = parameter(0.0, minimum=0.0, maximum=100.0)
    """Difference of the offsets of neighboring eighths of a line, which are read out by different
    amplifiers, in gray levels of an 8-bit scale"""
    stuck_pixels: int = parameter(0, minimum=0, maximum=1000)
    """Pixels that are always black or always white"""
    hot_pixels: int = parameter(0, minimum=0, maximum=1000)
    """Pixels with 20 to 120 gray levels of dark signal"""
    mud: float = parameter(0.0, minimum=0.0, maximum=0.9)
    """Share of the view, from the end of the line, hidden by mud on the optics"""
    shadow: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Share of the light lost in a shadow that does not move with the ground"""
    shadow_speed: float = parameter(0.0, unit="m/s", minimum=0.0, maximum=100.0)
    """Frequency at which the shadow's edge oscillates along the line; 0 for an edge fixed in the
    view"""

    @property
    def noise_deviation(self) -> float:
        """Standard deviation of the noise [gray levels of an 8-bit scale]."""
        if self.signal_to_noise_db > 0.0:
            return float(FULL_SCALE / 10.0 ** (self.signal_to_noise_db / 20.0))
        return self.noise

    @property
    def magnification(self) -> float:
        """Visible length of ground over the configured one [1]: 1 + h / d of an ordinary lens."""
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
