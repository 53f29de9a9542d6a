"""Fourier transforms within kernels."""

from __future__ import annotations


def load_transforms() -> None:
    """Let kernels call scipy.fft; before the first that does is called."""
    import rocket_fft  # noqa: F401
