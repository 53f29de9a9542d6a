"""Fourier transforms in compiled kernels."""


def load_transforms() -> None:
    """Enable scipy.fft in kernels; must be called before the first kernel that uses it."""
    import rocket_fft  # noqa: F401
