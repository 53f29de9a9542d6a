"""Options and grounds that the studies of line cameras have in common."""

from pathlib import Path
from typing import Any

from linescan_odometry.configuration import METRIC_NAMES
from omni_core.commands.command_options import option
from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_runs.experiment import ExperimentLibrary
from omni_runs.ground_choice import ground_overrides, is_picture
from omni_sim.texture.cache import TextureCache
from omni_sim.texture.configuration import KINDS
from omni_sim.texture.texture import GroundTexture

_EXPERIMENT = "straight_line"  # base of the experiment; only its ground is changed
_DPI = 1200.0


def kinds_option(*kinds: str) -> Any:
    """Declare the option for the kinds of ground, with the default `kinds`."""
    return option(kinds, metavar="KIND", choices=KINDS, description="kind of ground")


def pairs_option(pairs: int, fewest: int = 1) -> Any:
    """Declare the option for the number of consecutive line pairs."""
    words = "number of consecutive line pairs over which each value is averaged"
    return parameter(pairs, description=words, minimum=fewest, maximum=10_000)


def noise_option(noise: float = 1.0) -> Any:
    """Declare the option for the camera noise, with the default `noise` [gray levels]."""
    words = "standard deviation of the camera noise in gray levels"
    return option(noise, metavar="LEVELS", description=words, minimum=0.0, maximum=100.0)


class LineOptions(Configuration):
    """Options of a study: grounds, similarity metric, number of line pairs, noise and seed."""

    ground: tuple[str, ...] = kinds_option("cork")
    metric: str = parameter("pearson", choices=METRIC_NAMES)
    """similarity metric of the search for displacements"""
    pairs: int = pairs_option(20)
    noise: float = noise_option()
    texels: int = parameter(8192, minimum=256, maximum=8192)
    """number of texels of the ground per 0.2 m"""
    seed: int = parameter(1, minimum=0)
    """seed of positions and noise"""

    @property
    def kinds(self) -> list[str]:
        """Names of the grounds, each only once."""
        return list(dict.fromkeys(self.ground))


def grounds_option(*grounds: str, prefix: str = "") -> Any:
    """Declare the option for the grounds, with the default `grounds`."""
    words = f"{prefix}a file of config/grounds/, or your own scan or photo with --dpi"
    return option(grounds, metavar="NAME|PICTURE", description=words)


def runs_option(runs: int, run: str = ", with ten line pairs each") -> Any:
    """Declare the option for the number of random positions; `run` is added to the help text."""
    return parameter(runs, description=f"number of random positions{run}", minimum=1, maximum=1000)


class TextureOptions(Configuration):
    """Options of a study: grounds, their resolution, number of random positions, and seed."""

    ground: tuple[str, ...] = grounds_option("cork")
    dpi: float | None = parameter(
        None,
        description=f"dots per inch of the grounds (default: {_DPI:g}; a picture needs its own)",
        above=0.0,
        maximum=50000.0,
    )
    runs: int = runs_option(2)
    seed: int = parameter(1, minimum=0)
    """seed of positions and noise"""


def grounds_of(options: TextureOptions, library: ExperimentLibrary) -> dict[str, GroundTexture]:
    """Return the textures of the grounds of a study, keyed by name.

    Raises:
        ConfigurationError: a ground is invalid; the message names the ground and the reason.
    """
    cache = TextureCache.of_user()
    grounds: dict[str, GroundTexture] = {}
    for file in options.ground:
        name = Path(file).stem
        if name in grounds:
            raise ConfigurationError("--ground", f"two of the grounds are called {name!r}")
        dpi = _DPI if options.dpi is None and not is_picture(file) else options.dpi
        overrides = ground_overrides(file, dpi)
        texture = library.load(_EXPERIMENT, overrides=overrides).ground.texture
        try:
            grounds[name] = cache.texture(texture)
        except ConfigurationError as error:
            raise error.below("ground.texture") from None
    return grounds
