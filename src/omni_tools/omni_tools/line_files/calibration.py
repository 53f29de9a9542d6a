"""Calibration of the mounting and pixel pitch of line cameras from drives of known motion.

In a motion (v_x, v_y, Omega), a camera of pitch p, whose axis points to phi and passes base_link at
the lever ``l = x sin phi - y cos phi``, measures by Eq. (23)

    pixels per second = (v_x cos phi + v_y sin phi + l Omega) / p = c . (v_x, v_y, Omega).

This is linear in c. A drive with straight, sideways and turning parts determines c, and thus ``p =
1 / |(c_1, c_2)|``, ``phi = atan2(c_2, c_1)`` and ``l = c_3 p``. The position along the axis has no
effect on the measurement and keeps its configured value. Mirrored lines (a mirror, a camera mounted
the other way round) turn phi by half a turn.

The configured values enter as one observation of each coefficient, with a standard deviation of a
third of 1 / p, or of 0.3 m for the lever. A coefficient that the drives do not determine better
than this observation keeps its configured value. The fit is robust (Huber). Its standard errors are
cluster-robust (Liang and Zeger 1986), because the errors of neighboring batches are not
independent.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.sensor import SensorOdometry
from omni_figures import style
from omni_platform import sensors, signals
from omni_platform.configuration import ConfigurationError
from omni_platform.quantities import FloatArray

QUANTITIES = ("pitch", "heading", "lever", "line_rate")
"""Calibrated quantities of a camera."""

_PRIOR = (0.33, 0.33, 0.3)  # standard deviations of c, in units of 1 / p and m / p


@dataclasses.dataclass(frozen=True)
class Drive:
    """Measurements of one camera and of the reference during a drive, by batch.

    Attributes:
        time: middle of each batch [s], shape (m,).
        pixels: displacement [px/s], shape (m,).
        twist: twist of the reference v_x, v_y [m/s] and yaw rate [rad/s], shape (m, 3).
        line_rate: line rate from the stamps [1/s].
        line_rate_error: standard error of the line rate [1/s].
    """

    time: FloatArray
    pixels: FloatArray
    twist: FloatArray
    line_rate: float
    line_rate_error: float


@dataclasses.dataclass(frozen=True)
class Calibration:
    """One calibrated camera.

    Attributes:
        nominal: the configured camera.
        sensor: the calibrated camera.
        error: standard errors of `QUANTITIES` [m, rad, m, 1/s].
        mirrored: whether the lines run against the configured axis.
        unseen: descriptions of the quantities that the drives do not determine.
        drives: the drives with this camera.
        residual: residuals of the velocity along the axis, by drive and batch [m/s].
        before: residuals with the configured values, by drive and batch [m/s].
    """

    nominal: sensors.LineSensor
    sensor: sensors.LineSensor
    error: Mapping[str, float]
    mirrored: bool
    unseen: tuple[str, ...]
    drives: tuple[Drive, ...]
    residual: tuple[FloatArray, ...]
    before: tuple[FloatArray, ...]


def observe(
    sensor: sensors.LineSensor,
    batches: Sequence[signals.LineBatch],
    reference_time: FloatArray,
    reference_twist: FloatArray,
    configuration: OdometryConfiguration,
) -> Drive:
    """Return the measurements of one camera during a drive.

    Args:
        sensor: the configured camera.
        batches: batches of the camera's lines, oldest first.
        reference_time: stamps of the reference [s], ascending, shape (k,).
        reference_twist: known motion at these stamps, NaN where unknown, shape (k, 3).
        configuration: configuration of the odometry that matches the lines.

    Raises:
        ConfigurationError: the stamps do not give a line rate.
    """
    rate, rate_error = _line_rate(batches)
    odometry = SensorOdometry(dataclasses.replace(sensor, line_rate=rate), configuration)
    scale = sensor.pixel_pitch * rate
    time, pixels = [], []
    for batch in batches:
        reading = odometry.update(batch)
        if reading.measured and len(batch.lines) > 1:
            time.append(1e-9 * batch.stamp_ns - 0.5 * len(batch.lines) / rate)
            pixels.append(reading.velocity / scale * rate)
    middle = np.array(time)
    twist = np.column_stack(
        [np.interp(middle, reference_time, column) for column in reference_twist.T]
    )
    inside = (middle >= reference_time[0]) & (middle <= reference_time[-1])
    known = inside & np.all(np.isfinite(twist), axis=1)
    return Drive(middle[known], np.array(pixels)[known], twist[known], rate, rate_error)


def _line_rate(batches: Sequence[signals.LineBatch]) -> tuple[float, float]:
    """Return the line rate [1/s] from the stamps, with its standard error."""
    number = np.cumsum([len(batch.lines) for batch in batches]).astype(np.float64)
    stamp = 1e-9 * np.array([batch.stamp_ns - batches[0].stamp_ns for batch in batches])
    if len(batches) < 3 or stamp[-1] <= 0.0:
        raise ConfigurationError("lines", "fewer than three batches, or all of one stamp")
    number -= number.mean()
    stamp -= stamp.mean()
    period = float(number @ stamp) / float(number @ number)
    left = stamp - period * number
    error = math.sqrt(float(left @ left) / max(len(left) - 2, 1) / float(number @ number))
    return 1.0 / period, error / period**2


def calibrate(
    nominal: sensors.LineSensor, drives: Sequence[Drive], fewest: int = 12, seen_below: float = 0.1
) -> Calibration:
    """Fit one camera to its drives.

    Args:
        nominal: the configured camera.
        drives: drives with this camera, at least one.
        fewest: smallest number of measured batches.
        seen_below: ratio of the standard error to the prior one below which a coefficient counts as
            determined [1].

    Raises:
        ConfigurationError: too few batches were measured.
    """
    twist = np.concatenate([drive.twist for drive in drives])
    pixels = np.concatenate([drive.pixels for drive in drives])
    if len(pixels) < fewest:
        raise ConfigurationError(
            "DRIVE", f"{len(pixels)} batches of a camera were measured, {fewest} are needed"
        )
    phi, pitch = nominal.heading, nominal.pixel_pitch
    start = np.array(sensors.velocity_row(nominal.x, nominal.y, phi)) / pitch
    prior = np.array(_PRIOR) / pitch
    coefficients, covariance = _fit(twist, pixels, start, prior)
    seen = np.sqrt(np.diag(covariance)) < seen_below * prior
    if not seen.all():
        # Unobservable parameters must not be fitted to the noise of the reference.
        coefficients, covariance = _fit(twist, pixels, start, np.where(seen, prior, 1e-6 * prior))
        covariance = covariance + np.diag(np.where(seen, 0.0, prior**2))
    found_pitch, heading, lever, errors = _mounting(coefficients, covariance)
    turned = math.remainder(heading - phi, 2.0 * math.pi)
    mirrored = abs(turned) > 0.5 * math.pi
    rates = np.array([drive.line_rate for drive in drives])
    rate = float(rates.mean())
    scatter = float(rates.std(ddof=1)) / math.sqrt(len(rates)) if len(rates) > 1 else 0.0
    rate_error = max(scatter, *(drive.line_rate_error for drive in drives))
    # Move the camera to the nearest point on the new axis, which has the fitted lever.
    off = lever - sensors.velocity_row(nominal.x, nominal.y, heading)[2]
    left = {
        "scale_error": math.hypot(errors[0] / found_pitch, rate_error / rate),
        "heading_error_deg": math.degrees(errors[1]),
        "lever_error": float(errors[2]),
    }
    known = errors < seen_below * np.array((_PRIOR[0] * found_pitch, *_PRIOR[1:]))
    stated: Any = {name: float(v) for (name, v), ok in zip(left.items(), known, strict=True) if ok}
    sensor = dataclasses.replace(
        nominal,
        # An undetermined quantity keeps its configured standard error.
        **stated,
        x=float(nominal.x + off * math.sin(heading)),
        y=float(nominal.y - off * math.cos(heading)),
        heading_deg=math.degrees(phi + turned),
        length=float(found_pitch * nominal.pixels),
        line_rate=rate,
    )
    words = ("forward motion", "sideways motion", "turning")
    unseen = tuple(word for word, ok in zip(words, seen, strict=True) if not ok)
    return Calibration(
        nominal,
        sensor,
        dict(zip(QUANTITIES, (*map(float, errors), rate_error), strict=True)),
        mirrored,
        unseen,
        tuple(drives),
        tuple((d.pixels - d.twist @ coefficients) * found_pitch for d in drives),
        tuple((d.pixels - d.twist @ start) * pitch for d in drives),
    )


def _mounting(
    coefficients: FloatArray, covariance: FloatArray
) -> tuple[float, float, float, FloatArray]:
    """Return pitch [m], heading [rad] and lever [m], and their standard errors, shape (3,)."""
    size = float(np.hypot(coefficients[0], coefficients[1]))
    pitch = 1.0 / size
    heading = math.atan2(coefficients[1], coefficients[0])
    lever = coefficients[2] * pitch
    # Derivatives of (pitch, heading, lever) with respect to c.
    c_1, c_2, c_3 = coefficients
    jacobian = np.array(
        [
            [-c_1 / size**3, -c_2 / size**3, 0.0],
            [-c_2 / size**2, c_1 / size**2, 0.0],
            [-c_3 * c_1 / size**3, -c_3 * c_2 / size**3, 1.0 / size],
        ]
    )
    errors = np.sqrt(np.diag(jacobian @ covariance @ jacobian.T))
    return pitch, heading, lever, errors


def _fit(
    twist: FloatArray,
    pixels: FloatArray,
    start: FloatArray,
    prior: FloatArray,
    huber: float = 2.5,
    stretches: int = 24,
) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients and their covariance, from a robust fit.

    Args:
        twist: twist of the reference, shape (m, 3).
        pixels: displacement [px/s], shape (m,).
        start: expected coefficients, shape (3,).
        prior: standard deviations of the expected coefficients, shape (3,).
        huber: residual above which a batch has less weight, in robust standard deviations [1].
        stretches: number of parts of the drives whose errors are assumed independent.
    """
    value: Any = start
    weight = np.ones(len(pixels))
    deviation = max(float(np.std(pixels)), 1e-9)
    for _ in range(20):
        information = twist.T @ (twist * weight[:, None]) / deviation**2 + np.diag(prior**-2)
        gain = twist.T @ (weight * pixels) / deviation**2 + start / prior**2
        new = np.linalg.solve(information, gain)
        left = pixels - twist @ new
        deviation = max(1.4826 * float(np.median(np.abs(left))), 1e-9 * float(np.abs(new).max()))
        weight = np.minimum(1.0, huber * deviation / np.maximum(np.abs(left), 1e-12))
        settled = np.allclose(new, value, rtol=1e-10)
        value = new
        if settled:
            break
    inverse = np.linalg.inv(information)
    scores = (weight * left / deviation**2)[:, None] * twist
    sums = np.array([part.sum(axis=0) for part in np.array_split(scores, stretches)])
    count = min(stretches, len(pixels))
    meat = sums.T @ sums * (count / max(count - 3.0, 1.0))
    covariance = inverse @ (meat + np.diag(prior**-2)) @ inverse
    return value, covariance


def draw_residuals(calibrations: Mapping[str, Calibration], title: str) -> Figure:
    """Draw the residuals of each camera's velocity with configured and calibrated values.

    Args:
        calibrations: calibrations by camera.
        title: title of the figure.
    """
    size = (12.0, 1.0 + 2.3 * len(calibrations))
    x = ("batch, drives one after the other (between orange lines)", "residual [mm/s]")
    figure, panels = style.panels(
        title, len(calibrations), 2, size=size, x=x, width_ratios=(2.2, 1.0)
    )
    for (line, spread), (name, calibration) in zip(panels, calibrations.items(), strict=True):
        after = np.concatenate(calibration.residual)
        before = np.concatenate(calibration.before)
        number = np.arange(len(after))
        line.plot(number, 1e3 * before, ".", ms=3.0, color=style.GRAY, label="configured")
        line.plot(number, 1e3 * after, ".", ms=3.0, color=style.BLUE, label="calibrated")
        for end in np.cumsum([len(part) for part in calibration.residual])[:-1]:
            line.axvline(end - 0.5, color=style.ORANGE, lw=0.8)
        line.set_ylabel(f"{name}: residual [mm/s]")
        widest = 4.0 * max(float(np.std(after)), 1e-6)
        spread.hist(1e3 * np.clip(after, -widest, widest), bins=40, color=style.BLUE)
        spread.set_title(
            f"calibrated: rms {1e3 * float(np.sqrt(np.mean(after**2))):.3g} mm/s, "
            f"configured {1e3 * float(np.sqrt(np.mean(before**2))):.3g} mm/s", loc="left",
        )  # fmt: skip
    panels[0][0].legend(loc="best", fontsize=8)
    return figure
