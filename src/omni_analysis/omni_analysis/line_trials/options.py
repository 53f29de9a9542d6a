"""Options that the studies of one line camera share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from linescan_odometry.matching.search import METRICS
from omni_analysis.line_trials.trials import Matches, Motion, ground, measure
from omni_platform.command_options import option
from omni_platform.configuration import Configuration, parameter
from omni_sim.texture.texture import KINDS


def grounds_option(*kinds: str) -> Any:
    """Declare the kinds of ground to look at; `kinds` is the default."""
    return option(kinds, metavar="KIND", choices=KINDS, description="kind of ground")


def pairs_option(pairs: int, fewest: int = 1) -> Any:
    """Declare the number of consecutive pairs of lines."""
    words = "consecutive pairs of lines that each value is the mean over"
    return parameter(pairs, description=words, minimum=fewest, maximum=10_000)


def noise_option(noise: float = 1.0) -> Any:
    """Declare the noise of the cameras; `noise` is the default [grey levels]."""
    words = "standard deviation in grey levels"
    return option(noise, metavar="LEVELS", description=words, minimum=0.0, maximum=100.0)


@dataclass(frozen=True, kw_only=True)
class LineOptions(Configuration):
    """Grounds, distance, number of pairs, noise and seed."""

    ground: tuple[str, ...] = grounds_option("cork")
    metric: str = parameter("pearson", choices=tuple(METRICS), description="distance between lines")
    pairs: int = pairs_option(20)
    noise: float = noise_option()
    texels: int = parameter(
        8192, description="resolution of the ground over 0.2 m", minimum=256, maximum=8192
    )
    seed: int = parameter(1, description="of places and noise", minimum=0)

    @property
    def kinds(self) -> list[str]:
        """The grounds, each once."""
        return list(dict.fromkeys(self.ground))


def measure_on(
    kinds: Sequence[str], motions: Sequence[Motion], options: LineOptions
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
