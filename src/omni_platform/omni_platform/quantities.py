"""What numbers are in all packages: arrays of doubles in SI, stamps in whole nanoseconds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SECOND_NS = 1_000_000_000
"""A second of stamps [ns]."""
