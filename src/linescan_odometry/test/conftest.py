"""Lines of an artificial ground, integrated exactly over every pixel."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

FINENESS = 16  # samples of the ground per pixel
FIRST, LENGTH = -4096, 12288  # extent of the ground [px]


@functools.cache
def _integral(grain: float, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the edges of the ground's samples [px], and the integral up to each edge."""
    samples = LENGTH * FINENESS
    spectrum = np.fft.rfft(np.random.default_rng(seed).standard_normal(samples))
    frequency = np.fft.rfftfreq(samples) * FINENESS
    ground = np.fft.irfft(spectrum * np.exp(-0.5 * (2 * np.pi * frequency * grain) ** 2), samples)
    integral = np.concatenate(([0.0], np.cumsum(ground / ground.std()))) / FINENESS
    return FIRST + np.arange(samples + 1) / FINENESS, integral


def _profile(
    positions: Any, pixels: int, *, grain: float = 1.0, seed: int = 1, contrast: float = 30.0
) -> NDArray[np.float64]:
    """Return noise-free gray levels of lines whose first pixel starts at `positions` [px].

    The ground is white noise smoothed by a Gaussian of standard deviation `grain` [px]. The
    running sum, interpolated linearly, is its exact integral, so that the value of a pixel is exact
    at any position.
    """
    starts = np.asarray(positions, dtype=np.float64)
    if starts.min() < FIRST or starts.max() + pixels > FIRST + LENGTH:
        raise ValueError("the line leaves the ground")
    edges = np.arange(pixels + 1) + starts[:, None]
    return 128.0 + contrast * np.diff(np.interp(edges, *_integral(grain, seed)))


def _expose(
    positions: Any,
    pixels: int,
    *,
    noise: float = 1.0,
    grain: float = 1.0,
    seed: int = 1,
    noise_seed: int = 2,
    dtype: Any = np.uint8,
) -> Any:
    """Return lines of the ground with noise [gray levels of 8 bit] and quantization."""
    levels = _profile(positions, pixels, grain=grain, seed=seed)
    levels = levels + noise * np.random.default_rng(noise_seed).standard_normal(levels.shape)
    full = np.iinfo(dtype).max
    return np.clip(np.rint(levels * (full / 255.0)), 0, full).astype(dtype)


@pytest.fixture(scope="session")
def profile() -> Callable[..., NDArray[np.float64]]:
    """Noise-free lines of an artificial ground."""
    return _profile


@pytest.fixture(scope="session")
def expose() -> Callable[..., Any]:
    """Lines of an artificial ground as a camera delivers them."""
    return _expose
