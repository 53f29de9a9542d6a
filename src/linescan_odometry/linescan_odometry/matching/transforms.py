"""Fourier transforms in compiled kernels."""

import sys

from omni_core.kernels import lean


def load_transforms() -> None:
    """Enable numpy.fft in kernels; must be called before the first kernel that uses it.

    rocket_fft would also enable scipy.fft, whose import takes 0.1 s, so scipy.fft is hidden while
    rocket_fft is imported.
    """
    hidden = "scipy.fft" not in sys.modules
    if hidden:
        sys.modules["scipy.fft"] = None  # type: ignore[assignment]
    try:
        import rocket_fft  # noqa: F401
    finally:
        if hidden:
            del sys.modules["scipy.fft"]


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
