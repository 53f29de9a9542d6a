"""Options and grounds that the studies of textures share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.loop.ground_choice import ground_overrides, is_picture
from omni_platform.command_options import option
from omni_platform.configuration import Configuration, ConfigurationError, parameter
from omni_sim.texture.cache import TextureCache
from omni_sim.texture.texture import GroundTexture

_EXPERIMENT = "straight_line"  # lends everything but its ground
_DPI = 1200.0


def grounds_option(*grounds: str) -> Any:
    """Declare the grounds to look at; `grounds` is the default."""
    words = "a file of config/grounds/, or your own scan or photo with --dpi"
    return option(grounds, metavar="NAME|PICTURE", description=words)


def runs_option(runs: int, run: str = "of ten pairs of lines each") -> Any:
    """Declare the number of random places; `run` says what is looked at from each of them."""
    return parameter(runs, description=f"random places {run}", minimum=1, maximum=1000)


@dataclass(frozen=True, kw_only=True)
class TextureOptions(Configuration):
    """Grounds, their resolution, random places and the seed."""

    ground: tuple[str, ...] = grounds_option("cork")
    dpi: float | None = parameter(
        None,
        description=f"dots per inch of the grounds (default: {_DPI:g}; a picture needs its own)",
    )
    runs: int = runs_option(2)
    seed: int = parameter(1, description="of places and noise", minimum=0)


def grounds_of(options: TextureOptions, library: ExperimentLibrary) -> dict[str, GroundTexture]:
    """Return the grounds to look at, by name.

    Raises:
        ConfigurationError: names the ground and what is wrong.
    """
    cache = TextureCache.of_user()
    grounds: dict[str, GroundTexture] = {}
    for ground in options.ground:
        name = Path(ground).stem
        if name in grounds:
            raise ConfigurationError("--ground", f"two of the grounds are called {name!r}")
        dpi = _DPI if options.dpi is None and not is_picture(ground) else options.dpi
        overrides = ground_overrides(ground, dpi)
        variant = library.variants(_EXPERIMENT)[0]
        texture = library.load(_EXPERIMENT, variant, overrides).ground.texture
        try:
            grounds[name] = cache.texture(texture)
        except ConfigurationError as error:
            raise error.below("ground.texture") from None
    return grounds
