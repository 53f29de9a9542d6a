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

LARGEST_OFFSET = 100.0
"""Limit on the distance of a part from the platform's center, along x or y [m]; a
larger value is treated as a typing error."""
