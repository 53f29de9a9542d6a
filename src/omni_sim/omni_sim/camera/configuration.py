"""Exposure, optics and noise of the line cameras (dissertation, section 4.4)."""

from collections.abc import Mapping

from omni_core.configuration import Configuration, ConfigurationError, parameter, section

TELECENTRIC, ORDINARY = "telecentric", "ordinary"

FULL_SCALE = 255.0
"""Largest 8-bit gray level."""
BLUR_MARGIN = 0.25
"""Limit on the length of ground beyond the view that contributes to a blurred line, as a share of
the view [1]."""
_MOST_WIDENING = 1.25  # limit on the widening of a view by heave of the camera, because of focus


BUMP = "bump"
_KINDS = ("dirt", "cover", "light", "flicker", "shadow", BUMP)
_SHARES = ("cover", "light", "flicker", "shadow")  # kinds whose amplitude is a share


class CameraFault(Configuration):
    """One fault of one line camera, or of all of them."""

    kind: str = parameter(choices=_KINDS)
    """Kind of the fault; omni_sim/camera/faults.py contains the equation of each kind"""
    camera: str = parameter("")
    """Name of the faulty line camera; empty for all line cameras"""
    time: float = parameter(0.0, unit="s", minimum=0.0, maximum=3600.0)
    """Onset of the fault"""
    duration: float = parameter(3600.0, unit="s", above=0.0, maximum=3600.0)
    """Duration of the fault"""
    amplitude: float = parameter(minimum=-1000.0, maximum=1000.0)
    """Size ``a``: number of specks for the fault `dirt`, angle in rad for `bump`, and a share of 0
    to 1 for all others"""
    period: float = parameter(0.01, unit="s", above=0.0, maximum=3600.0)
    """Period ``T`` of the fault `flicker`, or time that the edge of a `shadow` takes to move over
    the line"""

    def check_consistency(self) -> None:
        """Check that the amplitude is a share or a number of specks if the kind requires it.

        Raises:
            ConfigurationError: the amplitude is invalid.
        """
        if self.kind in _SHARES and not 0.0 <= self.amplitude <= 1.0:
            raise ConfigurationError(
                "amplitude", f"{self.amplitude:g} is not a share of 0 to 1, which {self.kind} needs"
            )
        if self.kind == "dirt" and not (self.amplitude >= 0.0 and self.amplitude.is_integer()):
            raise ConfigurationError("amplitude", f"{self.amplitude:g} is no number of specks")


class CameraConfiguration(Configuration):
    """Exposure and optics of the line cameras."""

    noise: float = parameter(1.0, minimum=0.0, maximum=100.0)
    """Standard deviation of white noise, in gray levels of an 8-bit scale"""
    signal_to_noise_db: float = parameter(0.0, unit="dB", minimum=0.0, maximum=200.0)
    """Ratio of full scale to the standard deviation of white noise. A value above 0 replaces
    `noise`; with 0, `noise` is used"""
    bit_depth: int = parameter(8, unit="bit", minimum=8, maximum=16)
    """Bits per pixel, 8 or 16"""
    gain: float = parameter(1.0, above=0.0, maximum=FULL_SCALE)
    """Ratio of the camera's gray level to that of the ground"""
    offset: float = parameter(0.0, minimum=-1000.0, maximum=1000.0)
    """Offset added to every pixel, in gray levels of an 8-bit scale"""
    exposure_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=1.0)
    """Exposure time, centered on the stamp of the line; motion during this time blurs the line"""
    lens: str = parameter(TELECENTRIC, choices=(TELECENTRIC, ORDINARY))
    """Type of the lens: only with an ordinary lens, the magnification depends on the height"""
    working_distance: float = parameter(0.1, unit="m", above=0.0, maximum=10.0)
    """Distance between an ordinary lens and the ground at which the field of view has the
    configured size"""
    height_error: float = parameter(0.0, unit="m", minimum=-10.0, maximum=10.0)
    """Difference between mounting height and working distance"""
    numerical_aperture: float = parameter(0.0, minimum=0.0, maximum=0.5)
    """Numerical aperture of the lens on the side of the ground, with which the blur out of focus
    grows; 0 for an infinite depth of field"""
    shading: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Share of the brightness that is lost at each end of a line (shading), in proportion to the
    squared distance from the middle"""
    dirt_spots: int = parameter(0, minimum=0, maximum=1000)
    """Number of specks of dirt on the optics, at random positions"""
    dirt_size: float = parameter(0.002, unit="m", above=0.0, maximum=1.0)
    """Mean diameter of the blurred shadow of a speck, measured on the ground"""
    dirt_opacity: float = parameter(0.5, minimum=0.0, maximum=1.0)
    """Share of the light that is lost in the middle of a speck's shadow"""
    photo_response: float = parameter(0.0, minimum=0.0, maximum=0.5)
    """Standard deviation of the pixel gains (PRNU)"""
    dark_signal: float = parameter(0.0, minimum=0.0, maximum=100.0)
    """Standard deviation of the pixel offsets (DSNU), in gray levels of an 8-bit scale"""
    dark_steps: float = parameter(0.0, minimum=0.0, maximum=100.0)
    """Difference between the offsets of neighboring eighths of a line, each read out by an
    amplifier of its own, in gray levels of an 8-bit scale"""
    stuck_pixels: int = parameter(0, minimum=0, maximum=1000)
    """Number of pixels that are always black or always white"""
    hot_pixels: int = parameter(0, minimum=0, maximum=1000)
    """Number of pixels with a dark signal of 20 to 120 gray levels"""
    mud: float = parameter(0.0, minimum=0.0, maximum=0.9)
    """Share of a line, at the end with the highest pixel numbers, that mud on the optics hides"""
    shadow: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Share of the light that is lost in a shadow that does not move with the ground"""
    shadow_speed: float = parameter(0.0, unit="m/s", minimum=0.0, maximum=100.0)
    """Speed at which the edge of the shadow moves back and forth along the line; 0 for an edge
    that is fixed in the view"""
    faults: Mapping[str, CameraFault] = section(dict)
    """Faults that begin and end during a run, keyed by name"""

    def focus(self, rise: float) -> tuple[float, float]:
        """Return how a view changes if the camera rises.

        The rays of a point form a disk of the radius ``N.A. |z|`` at the distance z from the focal
        plane. The blur is a Gaussian with the variance of this disk along a line, ``radius^2 / 4``.

        Args:
            rise: height of the camera above its mounting height [m].

        Returns:
            Factor [1] by which the view widens, limited to the widening that `most_widening`
            allows and its inverse; standard deviation of the blur on the ground by defocus [m].
        """
        blur = 0.5 * self.numerical_aperture * abs(self.height_error + rise)
        if self.lens == TELECENTRIC:
            return 1.0, blur
        widened = 1.0 + rise / (self.working_distance + self.height_error)
        return min(max(widened, 1.0 / _MOST_WIDENING), _MOST_WIDENING), blur

    @property
    def most_widening(self) -> float:
        """Largest factor by which a view is longer than configured, by widening and defocus [1].

        Defocus needs light from beyond the ends of the view.
        """
        widest = 1.0 if self.lens == TELECENTRIC else _MOST_WIDENING
        return widest if self.numerical_aperture == 0.0 else widest * (1.0 + BLUR_MARGIN)

    def check_consistency(self) -> None:
        """Check that the bit depth has an image encoding and that the camera is above the ground.

        Raises:
            ConfigurationError: the bit depth or the height error is invalid.
        """
        if self.bit_depth not in {8, 16}:
            raise ConfigurationError("bit_depth", f"{self.bit_depth} bit is neither 8 nor 16 bit")
        if self.height_error <= -self.working_distance:
            raise ConfigurationError(
                "height_error",
                f"{self.height_error:g} m puts the camera below the ground; it must be above "
                f"{-self.working_distance:g} m",
            )
