"""Options that the studies of one line camera share."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from omni_analysis.line_trials.trials import Matches, Motion, ground, measure
from omni_analysis.options.studies import (
    add_metric_option,
    add_noise_option,
    add_seed_option,
    check_noise,
    check_seed,
)
from omni_platform.configuration import ConfigurationError
from omni_sim.texture.texture import KINDS

_MOST_PAIRS = 10_000


def add_line_options(
    parser: argparse.ArgumentParser, grounds: tuple[str, ...], pairs: int, noise: float
) -> None:
    """Declare grounds, distance, number of pairs, noise and seed.

    Args:
        parser: of the study.
        grounds: kinds of ground to look at by default; those that there are.
        pairs: default number of consecutive pairs of lines.
        noise: default standard deviation [grey levels].
    """
    available = [kind for kind in grounds if kind in KINDS]
    parser.set_defaults(default_grounds=available)
    parser.add_argument(
        "--ground",
        action="append",
        choices=KINDS,
        metavar="KIND",
        help=f"kind of ground, may be repeated (default: {', '.join(available)})",
    )
    add_metric_option(parser)
    parser.add_argument(
        "--pairs",
        type=int,
        default=pairs,
        metavar="N",
        help="consecutive pairs of lines that each value is the mean over (default: %(default)s)",
    )
    add_noise_option(parser, noise)
    parser.add_argument(
        "--texels",
        type=int,
        default=8192,
        metavar="N",
        help="resolution of the ground over 0.2 m (default: %(default)s)",
    )
    add_seed_option(parser)


def grounds_of(options: argparse.Namespace) -> list[str]:
    """Check the shared options and return the grounds to look at.

    Raises:
        ConfigurationError: names the option that is out of range.
    """
    if not 1 <= options.pairs <= _MOST_PAIRS:
        raise ConfigurationError("--pairs", f"{options.pairs} must be in 1 to {_MOST_PAIRS}")
    check_noise(options)
    if not 256 <= options.texels <= 8192:
        raise ConfigurationError("--texels", f"{options.texels} must be in 256 to 8192")
    check_seed(options)
    return list(dict.fromkeys(options.ground or options.default_grounds))


def measure_on(
    kinds: Sequence[str], motions: Sequence[Motion], options: argparse.Namespace
) -> dict[str, list[Matches]]:
    """Return the matches of each motion, by kind of ground, with the options as they are."""
    return {
        kind: measure(
            motions,
            ground(kind, options.texels),
            options.pairs,
            options.noise,
            options.seed,
            options.metric,
        )
        for kind in kinds
    }
