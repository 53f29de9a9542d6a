"""Sizes of Fourier transforms."""

import rocket_fft  # noqa: F401  (numba compiles the transforms of NumPy through it)

from omni_core.kernels import lean


@lean
def transform_size(length: int) -> int:
    """Return the smallest even length >= `length` whose prime factors are only 2, 3 and 5."""
    size = length + length % 2
    while True:
        rest = size
        for factor in (2, 3, 5):
            while rest % factor == 0:
                rest //= factor
        if rest == 1:
            return size
        size += 2
