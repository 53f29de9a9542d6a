"""Options and grounds that the studies of textures share."""

from __future__ import annotations

import argparse
from pathlib import Path

from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.loop.ground_choice import ground_overrides, is_picture
from omni_analysis.options.studies import add_seed_option, check_seed
from omni_platform.configuration import ConfigurationError
from omni_sim.texture.cache import TextureCache
from omni_sim.texture.texture import GroundTexture

_EXPERIMENT = "straight_line"  # lends everything but its ground
_DPI = 1200.0


def add_texture_options(
    parser: argparse.ArgumentParser,
    grounds: tuple[str, ...],
    runs: int,
    run: str = "of ten pairs of lines each",
) -> None:
    """Declare grounds, their resolution, random places and the seed.

    Args:
        parser: of the study.
        grounds: looked at by default.
        runs: default number of random places.
        run: what is looked at from each of them.
    """
    parser.set_defaults(default_grounds=grounds)
    parser.add_argument(
        "--ground",
        action="append",
        metavar="NAME|PICTURE",
        help="a file of config/grounds/, or your own scan or photo with --dpi; may be repeated "
        f"(default: {', '.join(grounds)})",
    )
    parser.add_argument(
        "--dpi",
        type=float,
        metavar="X",
        help=f"dots per inch of the grounds (default: {_DPI:g}; a picture needs its own)",
    )
    parser.add_argument(
        "--runs",
        type=int,
        default=runs,
        metavar="N",
        help=f"random places {run} (default: %(default)s)",
    )
    add_seed_option(parser)


def grounds_of(options: argparse.Namespace, library: ExperimentLibrary) -> dict[str, GroundTexture]:
    """Check the options and return the grounds to look at, by name.

    Raises:
        ConfigurationError: names the option or the ground and what is wrong.
    """
    if not 1 <= options.runs <= 1000:
        raise ConfigurationError("--runs", f"{options.runs} must be in 1 to 1000")
    check_seed(options)
    cache = TextureCache.of_user()
    grounds: dict[str, GroundTexture] = {}
    for ground in options.ground or options.default_grounds:
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
