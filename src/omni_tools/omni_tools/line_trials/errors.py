"""Errors of displacements in pixels, millimeters and per cent.

Eq. (85) is printed with a division by the frame rate, which would give meters times seconds. A
velocity error is the displacement error *times* the rate, which is computed here.
"""

import math

import numpy as np

from omni_platform.quantities import BoolArray, FloatArray

ERROR_COLUMNS = ("mean_error_px", "rmse_px", "rmse_mm", "rmse_percent_of_speed")
"""Column names for the results of `error_values`."""


def within_95(ratio: FloatArray) -> BoolArray:
    """Return whether ratios of error to stated standard deviation are within the 95 % interval."""
    return np.abs(ratio) <= 1.96


def undetected(
    ratio: FloatArray, error: FloatArray, least: float = 0.05, deviations: float = 4.0
) -> BoolArray:
    """Return which velocity errors are larger than their stated standard deviations can explain.

    Args:
        ratio: ratio of error to stated standard deviation [1], NaN if unmeasured, shape (m,).
        error: error [m/s], shape (m,).
        least: smallest error that counts as undetected [m/s].
        deviations: largest ratio that the stated standard deviation explains [1].
    """
    return (np.abs(ratio) > deviations) & (np.abs(error) > least)


def error_values(
    pixel_error: FloatArray, error: FloatArray, pitch: float, line_rate: float, speed: float
) -> tuple[float, float, float, float]:
    """Return the mean error as defined in the dissertation, and the RMS error in three units.

    Args:
        pixel_error: pixel error in whole pixels, Eq. (84) [px], shape (m,).
        error: error of the refined displacements, not rounded [px], shape (m,).
        pitch: length of a pixel on the ground [m].
        line_rate: lines per second [1/s].
        speed: speed of the motion, to which the velocity error refers, Eq. (85) [m/s].

    Returns:
        Mean magnitude of `pixel_error` [px]; root mean square of `error` in px, mm and per cent.
    """
    rmse = math.sqrt(float(np.mean(np.square(error))))
    length = rmse * pitch
    percent = 100.0 * length * line_rate / speed if speed > 0.0 else math.nan
    return float(np.mean(np.abs(pixel_error))), rmse, 1e3 * length, percent
