"""Options that studies of different kinds share."""

from __future__ import annotations

import argparse

from linescan_odometry.matching.search import METRICS
from omni_platform.configuration import ConfigurationError


def add_metric_option(parser: argparse.ArgumentParser) -> None:
    """Declare the distance between lines."""
    parser.add_argument(
        "--metric",
        default="pearson",
        choices=tuple(METRICS),
        help="distance between lines (default: %(default)s)",
    )


def add_noise_option(parser: argparse.ArgumentParser, noise: float = 1.0) -> None:
    """Declare the noise of the cameras.

    Args:
        parser: of the study.
        noise: default standard deviation [grey levels].
    """
    parser.add_argument(
        "--noise",
        type=float,
        default=noise,
        metavar="LEVELS",
        help="standard deviation in grey levels (default: %(default)s)",
    )


def add_seed_option(parser: argparse.ArgumentParser, of: str = "places and noise") -> None:
    """Declare the seed.

    Args:
        parser: of the study.
        of: what it is the seed of.
    """
    parser.add_argument(
        "--seed", type=int, default=1, metavar="N", help=f"of {of} (default: %(default)s)"
    )


def check_noise(options: argparse.Namespace) -> None:
    """Raise a `ConfigurationError` unless the noise is in 0 to 100 grey levels."""
    if not 0.0 <= options.noise <= 100.0:
        raise ConfigurationError("--noise", f"{options.noise:g} must be in 0 to 100")


def check_seed(options: argparse.Namespace) -> None:
    """Raise a `ConfigurationError` if the seed is negative."""
    if options.seed < 0:
        raise ConfigurationError("--seed", f"{options.seed} must not be negative")
