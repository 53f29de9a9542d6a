"""Optical-flow chips, which measure the ground velocity, read through their makers' libraries.

- PMW3901 and PAA5100JE (SPI) take images at a fixed rate, and count how far the ground has moved
  between two images; a register holds the counts since the last reading,
- the SparkFun OTOS (I2C) combines a PAA5160 with an IMU, and reports its pose and its velocities in
  the frame of this pose, with standard deviations.

The caller passes the time of a reading, and this module reads no clock. The libraries are imported
only when a chip is opened: ``pmw3901`` requires ``spidev``, ``gpiod`` and ``gpiodevice``, and
``qwiic_otos`` requires ``qwiic_i2c``.
"""

from __future__ import annotations

import enum
import importlib
import math
import struct
from functools import cache
from typing import Any, NamedTuple, Protocol

import numpy as np

from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_core.quantities import FloatArray
from omni_core.sensors import COUNT_DEVIATION

PMW3901, PAA5100, OTOS = CHIPS = ("pmw3901", "paa5100", "otos")


class _Pixart(enum.IntEnum):
    """Registers and values of the PMW3901 and the PAA5100."""

    PRODUCT = 0x49
    MOTION_REGISTER = 0x16
    ORIENTATION_REGISTER = 0x5B
    MOVED = 0x80
    """Bit of the motion register that is set if the ground has moved since the last reading"""
    DARK = 0x1F
    """Upper byte of the exposure time at its limit, which means that the ground is too dark"""


_REST = 1.5
"""Time without counts after an image with counts, after which the chip has certainly taken another
image [image periods]"""
_COUNTS_IN_EVERY_IMAGE = 2
"""Counts of one image from which on the next images have counts too, so that the counts show when
images are taken: the ground moves by more than one count per image"""


class _OtosStatus(enum.IntEnum):
    """Bits of the status register of an OTOS."""

    FAULTS = 0xC0
    """The optical chip or the IMU is defective"""
    WARNINGS = 0x03
    """The chip is tilted, or its optical tracking is poor"""


class FlowChipError(Exception):
    """A chip does not answer, or is not of the expected type; the message states the reason."""


class FlowSample(NamedTuple):
    """A reading of an optical-flow chip.

    Attributes:
        velocity: velocity v_x, v_y of the chip relative to the ground along the chip's axes, and
            its yaw rate [m/s, m/s, rad/s], shape (3,); NaN if not measured.
        deviation: standard deviations of `velocity` [m/s, m/s, rad/s], shape (3,); NaN if not
            measured.
        problem: reason why nothing was measured; empty for a valid measurement.
    """

    velocity: FloatArray
    deviation: FloatArray
    problem: str

    @classmethod
    def unmeasured(cls, problem: str) -> FlowSample:
        """Return a reading in which all values are NaN; `problem` is the reason for this."""
        return cls(np.full(3, math.nan), np.full(3, math.nan), problem)


class FlowChip(Protocol):
    """An opened optical-flow chip."""

    def read(self, time: float) -> FlowSample | None:
        """Read the chip.

        Args:
            time: present time [s].

        Returns:
            The reading; None if the chip has possibly taken no image since the last one.

        Raises:
            FlowChipError: the chip does not answer.
        """


class FlowChipConfiguration(Configuration):
    """Type, bus and calibration of an optical-flow chip."""

    chip: str = parameter(choices=CHIPS)
    """Type of the chip"""
    bus: int = parameter(0, minimum=0, maximum=9)
    """Number of the SPI port"""
    chip_select: int = parameter(1, minimum=0, maximum=9)
    """Chip select of the SPI port"""
    i2c_bus: int = parameter(1, minimum=0, maximum=99)
    """Number of the I2C bus of an OTOS; all OTOS boards have the same address, so each requires a
    separate bus"""
    counts_per_meter: float = parameter(0.0, unit="1/m", minimum=0.0, maximum=1.0e6)
    """Counts of a PMW3901 or PAA5100 per meter at its mounting height. To measure it, move the
    chip by one meter and read `counts` on /diagnostics"""
    invert_x: bool = parameter(False)
    """Whether the chip is set to negate its x counts"""
    invert_y: bool = parameter(False)
    """Whether the chip is set to negate its y counts"""
    swap_xy: bool = parameter(False)
    """Whether the chip is set to exchange its x and y counts, before it negates them"""
    minimum_quality: int = parameter(25, minimum=0, maximum=255)
    """Minimum surface quality (SQUAL) of a valid reading"""
    maximum_speed: float = parameter(0.0, unit="m/s", minimum=0.0, maximum=100.0)
    """Largest speed that the chip can measure at its height (0: any speed); faster readings are
    invalid"""
    image_rate: float = parameter(121.0, unit="1/s", above=0.0, maximum=1e4)
    """Images per second that a PMW3901 or PAA5100 takes; a relative error of this value causes the
    same relative error of the velocity"""
    longest_interval: float = parameter(0.1, unit="s", above=0.0, maximum=1.0)
    """Limit on the time between two readings of a PMW3901 or PAA5100; after a longer time, the
    counts are not converted to a velocity"""
    relative_deviation: float = parameter(0.03, minimum=0.0, maximum=1.0)
    """Standard deviation of the velocity due to errors of height and scale, divided by the speed"""
    linear_scalar: float = parameter(1.0, minimum=0.872, maximum=1.127)
    """Scale factor of an OTOS's distances"""
    angular_scalar: float = parameter(1.0, minimum=0.872, maximum=1.127)
    """Scale factor of an OTOS's angles"""
    offset_x: float = parameter(0.0, unit="m", minimum=-10.0, maximum=10.0)
    """Offset x that an OTOS itself subtracts; 0 if odometry or twist_adapter has the mounting"""
    offset_y: float = parameter(0.0, unit="m", minimum=-10.0, maximum=10.0)
    """Offset y that an OTOS itself subtracts; 0 if odometry or twist_adapter has the mounting"""
    offset_heading_deg: float = parameter(0.0, unit="deg", minimum=-180.0, maximum=180.0)
    """Heading that an OTOS itself subtracts"""

    def check_consistency(self) -> None:
        """Check that the configuration contains the calibration that the chip requires."""
        if self.chip != OTOS and self.counts_per_meter == 0.0:
            raise ConfigurationError(
                "counts_per_meter",
                "is needed: move the sensor by one meter and divide the change of 'counts' on "
                "/diagnostics by it; 1 publishes counts per second",
            )


def open_chip(configuration: FlowChipConfiguration) -> FlowChip:
    """Open an optical-flow chip, initialize it and return it.

    Raises:
        FlowChipError: the chip does not answer.
        ConfigurationError: the library of the chip is not installed.
    """
    kind = OtosChip if configuration.chip == OTOS else CountingChip
    try:
        return kind(configuration)
    except ImportError as error:
        install = f"./omni exec python -m pip install {kind.packages}"
        raise ConfigurationError("chip", f"{error}; {install} installs it") from None
    except (OSError, RuntimeError, TimeoutError) as error:
        raise FlowChipError(f"{configuration.chip} does not answer: {error}") from None


class CountingChip:
    """A PMW3901 or PAA5100JE, which counts how far the ground has moved since the last reading.

    The counts change only when the chip takes an image, but an image without counts cannot be
    observed. A reading is the mean velocity since the last reading:

    - If the ground moves by a count per image or more, the counts show when images are taken. A
      reading then ends at every image, and its counts are divided by the period of the images.
    - If the ground is slower, most images have no counts. A reading then ends at a time that does
      not depend on the counts, because readings that end at counts would be biased, and its counts,
      even if they are zero, are divided by the elapsed time.
    - If the time between two calls is longer than the period of the images, a reading ends at every
      call, and its counts are divided by the elapsed time.

    The sum of velocity times duration is therefore the distance. With the elapsed time, the number
    of images is uncertain by one.

    Attributes:
        counts: sums of all counts along x and along y since the chip was opened.
        packages: packages from PyPI that the chip requires.
    """

    packages = "pmw3901 spidev gpiod gpiodevice"

    def __init__(self, configuration: FlowChipConfiguration) -> None:
        self._configuration = configuration
        library = importlib.import_module("pmw3901")
        kind = library.PMW3901 if configuration.chip == PMW3901 else library.PAA5100
        self._chip: Any = kind(configuration.bus, configuration.chip_select)
        self._chip.set_orientation(
            invert_x=configuration.invert_x,
            invert_y=configuration.invert_y,
            swap_xy=configuration.swap_xy,
        )
        self._orientation = self._register(_Pixart.ORIENTATION_REGISTER)
        self._time: float | None = None
        self._are_images_known = False
        self._begin(-math.inf, -math.inf)
        self.counts = [0, 0]

    def _begin(self, time: float, due: float) -> None:
        """Begin a reading at a time [s]; it ends at the first call at `due` [s] or later."""
        self._began, self._due = time, due
        self._moved = np.zeros(2, int)
        self._images = 0  # number of calls with counts
        self._longest = 0.0  # longest time between two calls [s]
        self._ends_at_image = False

    def read(self, time: float) -> FlowSample | None:
        """Return the mean velocity since the last reading, without a yaw rate.

        While the reading has not ended, the result is None.
        """
        limits = self._configuration
        try:
            # A single transfer gives consistent values; the chip then counts from zero.
            burst = self._chip.spi_dev.xfer2([_Pixart.MOTION_REGISTER] + [0] * 12)
            _, motion, _, x, y, quality, *_, shutter, _ = struct.unpack(
                "<BBBhhBBBBBB", bytes(burst)
            )
            before, self._time = self._time, time
            if before is not None and time > before:
                self._count([x, y] if motion & _Pixart.MOVED else [0, 0], time - before)
                if time < self._due and not self._ends_at_image:
                    return None
            product, orientation = self._register(0), self._register(_Pixart.ORIENTATION_REGISTER)
        except OSError as error:
            raise FlowChipError(f"the bus failed: {error}") from None
        if product != _Pixart.PRODUCT or orientation != self._orientation:
            raise FlowChipError("the chip was lost or has been reset")
        if before is None or time <= before:
            self._begin(time, time + 1.0 / limits.image_rate)
            return FlowSample.unmeasured("first reading")
        moved, longest = self._moved, self._longest
        images = self._end_reading(time, time - before)
        if quality < limits.minimum_quality or shutter == _Pixart.DARK:
            return FlowSample.unmeasured(f"surface quality {quality}, exposure {shutter:#04x}")
        self.counts = [total + int(step) for total, step in zip(self.counts, moved, strict=True)]
        if longest > limits.longest_interval:
            return FlowSample.unmeasured(f"no reading for {longest:.2g} s")
        speed_of_count = limits.image_rate / (limits.counts_per_meter * images)
        velocity = moved * speed_of_count
        speed = math.hypot(*velocity)
        if speed > limits.maximum_speed > 0.0:
            return FlowSample.unmeasured(f"{speed:.2f} m/s exceeds maximum_speed")
        # The number of images is `images` rounded up or down, with the mean `images`.
        part = images % 1.0
        unknown_images = math.sqrt(part * (1.0 - part)) / images
        rounding = speed_of_count * COUNT_DEVIATION
        deviation = math.hypot(rounding, limits.relative_deviation * speed, unknown_images * speed)
        return FlowSample(
            np.array([*velocity, math.nan]), np.array([deviation, deviation, math.nan]), ""
        )

    def _count(self, moved: list[int], interval: float) -> None:
        """Add the counts along x and y in the time since the last call [s] to the reading."""
        self._longest = max(self._longest, interval)
        self._moved = self._moved + np.array(moved)
        largest = max(map(abs, moved))
        if largest == 0:
            return
        self._images += 1
        fast = self._are_images_known or largest >= _COUNTS_IN_EVERY_IMAGE
        period = 1.0 / self._configuration.image_rate
        self._ends_at_image = fast and self._longest < period  # the counts are from one image

    def _end_reading(self, time: float, interval: float) -> float:
        """Return the number of images of the reading, and begin the next one.

        Args:
            time: present time [s].
            interval: time since the last call [s].
        """
        period = 1.0 / self._configuration.image_rate
        has_gap = self._longest >= period
        self._are_images_known = self._ends_at_image
        if self._ends_at_image:
            images, due = float(self._images), time + _REST * period
        else:
            # Without a gap, the next reading ends at the call that is nearest to one period.
            images = (time - self._began) / period
            due = time + period - (0.0 if has_gap else 0.5 * interval)
        self._begin(time, due)
        return images

    def _register(self, address: int) -> int:
        return int(self._chip.spi_dev.xfer2([address, 0])[1])


@cache
def _i2c_driver(bus: int) -> Any:
    """Return the driver of an I2C bus from a cache, because the library never closes a driver.

    Raises:
        FlowChipError: the bus cannot be opened.
    """
    driver = importlib.import_module("qwiic_i2c").get_i2c_driver(iBus=bus)
    if driver is None or driver.i2cbus is None:
        raise FlowChipError(f"the I2C bus {bus} cannot be opened")
    return driver


class OtosChip:
    """A SparkFun Optical Tracking Odometry Sensor."""

    packages = "sparkfun-qwiic-otos"

    def __init__(self, configuration: FlowChipConfiguration) -> None:
        self._configuration = configuration
        library = importlib.import_module("qwiic_otos")
        self._chip: Any = library.QwiicOTOS(i2c_driver=_i2c_driver(configuration.i2c_bus))
        if getattr(self._chip, "_i2c", None) is None or not self._chip.begin():
            raise FlowChipError("no OTOS answers on the I2C bus")
        self._chip.setLinearUnit(self._chip.kLinearUnitMeters)
        self._chip.setAngularUnit(self._chip.kAngularUnitRadians)
        self._chip.setLinearScalar(configuration.linear_scalar)
        self._chip.setAngularScalar(configuration.angular_scalar)
        # The board keeps the offset of another program until its power is switched off.
        heading = math.radians(configuration.offset_heading_deg)
        offset = library.Pose2D(configuration.offset_x, configuration.offset_y, heading)
        self._chip.setOffset(offset)
        self._chip.resetTracking()

    def read(self, time: float) -> FlowSample:
        """Return the present velocity along the axes of the chip, and the yaw rate."""
        del time
        try:
            status = int(self._chip.getStatus())
            position, velocity, _, _, deviation, _ = self._chip.getPosVelAccAndStdDev()
        except OSError as error:
            raise FlowChipError(f"the bus failed: {error}") from None
        if status == 0xFF or status & _OtosStatus.FAULTS:
            raise FlowChipError(f"the board reports a failure, status {status:#04x}")
        if status & _OtosStatus.WARNINGS:
            return FlowSample.unmeasured(f"tilted or poor tracking, status {status:#04x}")
        # The board reports the velocity in the frame in which it tracks its pose.
        cos, sin = math.cos(position.h), math.sin(position.h)
        x, y = cos * velocity.x + sin * velocity.y, cos * velocity.y - sin * velocity.x
        speed = math.hypot(x, y)
        if speed > self._configuration.maximum_speed > 0.0:
            return FlowSample.unmeasured(f"{speed:.2f} m/s exceeds maximum_speed")
        stated = math.hypot(deviation.x, deviation.y)
        floor = max(self._configuration.relative_deviation * speed, 1e-3)
        linear = math.hypot(stated, floor)
        values = np.array([x, y, velocity.h])
        return FlowSample(values, np.array([linear, linear, max(deviation.h, 1e-3)]), "")
