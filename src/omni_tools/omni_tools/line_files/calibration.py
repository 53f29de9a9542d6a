"""Calibration of the mounting and pixel pitch of line cameras from recordings of a known motion.

Let a camera have the pixel pitch p, and let its axis have the direction phi and the lever arm ``l =
x sin phi - y cos phi`` about base_link. In a motion (v_x, v_y, Omega), the camera measures by Eq.
(23)

    pixels per second = (v_x cos phi + v_y sin phi + l Omega) / p = c . (v_x, v_y, Omega).

This is linear in c. Straight, sideways and turning motions together determine c, and thus ``p =
1 / |(c_1, c_2)|``, ``phi = atan2(c_2, c_1)`` and ``l = c_3 p``. The position along the axis does
not affect the measurement and keeps its configured value. Mirrored lines, from a mirror or a camera
mounted the other way round, change phi by 180 deg.

The configured values are used as one observation of each coefficient. Its standard deviation is a
third of 1 / p for c_1 and c_2, and 0.3 m / p for c_3. A coefficient keeps its configured value
unless the recordings determine it much more accurately than this observation. The fit is robust
(Huber). Its standard errors are cluster-robust (Liang and Zeger 1986), because the errors of
neighboring batches are not independent.
"""

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.sensor import SensorOdometry
from omni_core import sensors, signals
from omni_core.configuration import ConfigurationError
from omni_core.quantities import BoolArray, FloatArray
from omni_runs.figures import style

QUANTITIES = ("pitch", "heading", "lever", "line_rate")
"""Calibrated quantities of a camera."""

_MOTIONS = ("forward motion", "sideways motion", "turning")  # that determine a coefficient each
_PRIOR = (0.33, 0.33, 0.3)  # standard deviations of the configured c, in units of 1 / p and m / p
_HUBER = 2.5  # residual above which a batch has a smaller weight, in robust standard deviations [1]
_STRETCHES = 24  # number of parts of the recordings whose errors are assumed to be independent


class CalibrationDrive(NamedTuple):
    """Measurements of one camera and of the reference for m batches of a recording.

    Attributes:
        time: middle of each batch [s], shape (m,).
        pixels: velocity measured by the camera [px/s], shape (m,).
        twist: twist of the reference v_x, v_y [m/s] and yaw rate [rad/s], shape (m, 3).
        line_rate: line rate from the stamps [1/s].
        line_rate_error: standard error of the line rate [1/s].
    """

    time: FloatArray
    pixels: FloatArray
    twist: FloatArray
    line_rate: float
    line_rate_error: float


class Calibration(NamedTuple):
    """Result of the calibration of one camera.

    Attributes:
        nominal: camera as configured.
        sensor: camera after calibration.
        error: standard errors [m, rad, m, 1/s], keyed by the names in `QUANTITIES`.
        mirrored: whether the direction of the lines is opposite to the configured axis.
        unseen: motions, such as ``turning``, that the recordings lack. Without such a motion, the
            corresponding coefficient c is not determined.
        drives: measurements of the recordings that contain this camera.
        residual: residuals of the velocity along the axis [m/s], an array of shape (m,) for each
            recording.
        before: residuals with the configured values [m/s], in the form of `residual`.
    """

    nominal: sensors.LineSensor
    sensor: sensors.LineSensor
    error: Mapping[str, float]
    mirrored: bool
    unseen: tuple[str, ...]
    drives: tuple[CalibrationDrive, ...]
    residual: tuple[FloatArray, ...]
    before: tuple[FloatArray, ...]


def observe(
    sensor: sensors.LineSensor,
    batches: Sequence[signals.LineBatch],
    reference_time: FloatArray,
    reference_twist: FloatArray,
    configuration: OdometryConfiguration,
) -> CalibrationDrive:
    """Return the measurements of one camera during a recording.

    Args:
        sensor: camera as configured.
        batches: batches of the camera's lines, oldest first.
        reference_time: stamps of the reference [s], ascending, shape (k,).
        reference_twist: known twist at these stamps [m/s, m/s, rad/s], NaN where unknown, shape (k,
            3).
        configuration: odometry with which the lines are matched.

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
    columns = [np.interp(middle, reference_time, column) for column in reference_twist.T]
    twist = np.column_stack(columns)
    inside = (middle >= reference_time[0]) & (middle <= reference_time[-1])
    known = inside & np.all(np.isfinite(twist), axis=1)
    return CalibrationDrive(middle[known], np.array(pixels)[known], twist[known], rate, rate_error)


def _line_rate(batches: Sequence[signals.LineBatch]) -> tuple[float, float]:
    """Return the line rate [1/s] from the stamps, with its standard error."""
    number = np.cumsum([len(batch.lines) for batch in batches])
    stamp = 1e-9 * np.array([batch.stamp_ns - batches[0].stamp_ns for batch in batches])
    if len(batches) < 3 or stamp[-1] <= 0.0:
        raise ConfigurationError(
            "lines", "there are fewer than three batches, or all have the same stamp"
        )
    (period, _), covariance = np.polyfit(number, stamp, 1, cov=True)
    return 1.0 / float(period), math.sqrt(covariance[0, 0]) / float(period) ** 2


def calibrate(
    nominal: sensors.LineSensor,
    drives: Sequence[CalibrationDrive],
    fewest: int = 12,
    seen_below: float = 0.1,
) -> Calibration:
    """Return the calibration of one camera, fitted to its recordings.

    Args:
        nominal: camera as configured.
        drives: measurements of the recordings that contain this camera, at least one.
        fewest: minimum number of measured batches.
        seen_below: a coefficient counts as determined if the ratio of its standard error to its
            prior standard deviation is less than this value [1].

    Raises:
        ConfigurationError: too few batches were measured.
    """
    twist = np.concatenate([drive.twist for drive in drives])
    pixels = np.concatenate([drive.pixels for drive in drives])
    if len(pixels) < fewest:
        problem = f"{len(pixels)} batches of a camera were measured, {fewest} are needed"
        raise ConfigurationError("DRIVE", problem)
    phi, pitch = nominal.heading, nominal.pixel_pitch
    start = np.array(sensors.velocity_row(nominal.x, nominal.y, phi)) / pitch
    prior = np.array(_PRIOR) / pitch
    coefficients, covariance, seen = _determined(twist, pixels, start, prior, seen_below)
    found_pitch, heading, lever, errors = _mounting(coefficients, covariance)
    turned = math.remainder(heading - phi, 2.0 * math.pi)
    rate, rate_error = _mean_rate(drives)
    # Move the camera to the nearest point of the new axis, which has the fitted lever arm.
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
        # A quantity that is not determined keeps its configured standard error.
        **stated,
        x=float(nominal.x + off * math.sin(heading)),
        y=float(nominal.y - off * math.cos(heading)),
        heading_deg=math.degrees(phi + turned),
        length=float(found_pitch * nominal.pixels),
        line_rate=rate,
    )
    return Calibration(
        nominal,
        sensor,
        dict(zip(QUANTITIES, (*map(float, errors), rate_error), strict=True)),
        abs(turned) > 0.5 * math.pi,
        tuple(itertools.compress(_MOTIONS, ~seen)),
        tuple(drives),
        tuple((d.pixels - d.twist @ coefficients) * found_pitch for d in drives),
        tuple((d.pixels - d.twist @ start) * pitch for d in drives),
    )


def _determined(
    twist: FloatArray, pixels: FloatArray, start: FloatArray, prior: FloatArray, seen_below: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the coefficients c and their covariance, and whether each coefficient is determined.

    The argument `seen_below` is that of `calibrate`; all others are those of `_fit`.
    """
    coefficients, covariance = _fit(twist, pixels, start, prior)
    seen = np.sqrt(np.diag(covariance)) < seen_below * prior
    if not seen.all():
        # Parameters that cannot be determined must not be fitted to the noise of the reference.
        coefficients, covariance = _fit(twist, pixels, start, np.where(seen, prior, 1e-6 * prior))
        covariance = covariance + np.diag(np.where(seen, 0.0, prior**2))
    return coefficients, covariance, seen


def _mean_rate(drives: Sequence[CalibrationDrive]) -> tuple[float, float]:
    """Return the mean line rate of the recordings and its standard error [1/s]."""
    rates = np.array([drive.line_rate for drive in drives])
    scatter = float(rates.std(ddof=1)) / math.sqrt(len(rates)) if len(rates) > 1 else 0.0
    return float(rates.mean()), max(scatter, *(drive.line_rate_error for drive in drives))


def _mounting(
    coefficients: FloatArray, covariance: FloatArray
) -> tuple[float, float, float, FloatArray]:
    """Return pitch [m], heading [rad] and lever [m], and the standard errors of these three values.

    Args:
        coefficients: coefficients c [1/m, 1/m, 1], shape (3,).
        covariance: covariance of the coefficients, shape (3, 3).
    """
    c_1, c_2, c_3 = coefficients.tolist()
    size = math.hypot(c_1, c_2)
    # Derivatives of (pitch, heading, lever) with respect to c.
    jacobian = np.array(
        [
            [-c_1 / size**3, -c_2 / size**3, 0.0],
            [-c_2 / size**2, c_1 / size**2, 0.0],
            [-c_3 * c_1 / size**3, -c_3 * c_2 / size**3, 1.0 / size],
        ]
    )
    errors = np.sqrt(np.diag(jacobian @ covariance @ jacobian.T))
    return 1.0 / size, math.atan2(c_2, c_1), c_3 / size, errors


def _fit(
    twist: FloatArray, pixels: FloatArray, start: FloatArray, prior: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients c and their covariance, from a robust fit.

    Args:
        twist: twist of the reference [m/s, m/s, rad/s], shape (m, 3).
        pixels: velocity measured by the camera [px/s], shape (m,).
        start: configured coefficients c [1/m, 1/m, 1], shape (3,).
        prior: standard deviations of `start` [1/m, 1/m, 1], shape (3,).
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
        weight = np.minimum(1.0, _HUBER * deviation / np.maximum(np.abs(left), 1e-12))
        settled = np.allclose(new, value, rtol=1e-10)
        value = new
        if settled:
            break
    inverse = np.linalg.inv(information)
    scores = (weight * left / deviation**2)[:, None] * twist
    sums = np.array([part.sum(axis=0) for part in np.array_split(scores, _STRETCHES)])
    count = min(_STRETCHES, len(pixels))
    meat = sums.T @ sums * (count / max(count - 3.0, 1.0))
    covariance = inverse @ (meat + np.diag(prior**-2)) @ inverse
    return value, covariance


def draw_residuals(calibrations: Mapping[str, Calibration], title: str) -> Figure:
    """Draw the residuals of each camera's velocity with configured and calibrated values.

    Args:
        calibrations: calibrations, keyed by camera name.
        title: title of the figure.
    """
    size = (12.0, 1.0 + 2.3 * len(calibrations))
    x = ("batch; recordings are separated by orange lines", "residual [mm/s]")
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
