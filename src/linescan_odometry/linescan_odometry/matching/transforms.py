"""Fourier transforms within kernels."""


def load_transforms() -> None:
    """Enable scipy.fft in kernels; to be called before the first kernel that uses it."""
    import rocket_fft  # noqa: F401
