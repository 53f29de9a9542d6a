"""Number types of all packages: arrays of doubles in SI units, integer stamps in nanoseconds."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
Int32Array = NDArray[np.int32]
Int16Array = NDArray[np.int16]
Int8Array = NDArray[np.int8]
BoolArray = NDArray[np.bool_]

Pair = tuple[float, float]
Triple = tuple[float, float, float]

SECOND_NS = 1_000_000_000
"""One second [ns]."""

GRAVITY = 9.81
"""Acceleration of gravity [m/s^2]."""

CONTROL_PERIOD = 0.01
"""Default of all periods that equal the control period: simulator, assistant, brake adapter [s]."""

LARGEST_OFFSET = 100.0
"""Limit on the coordinates x and y of any part relative to base_link [m]; a larger
value is assumed to be a typing error."""


def plain(value: float, digits: int = 3) -> str:
    """Return a number as text with some significant digits; large ones without an exponent."""
    words = f"{value:.{digits}g}"
    return f"{float(words):.0f}" if "e+" in words else words
