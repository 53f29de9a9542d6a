"""``--ground NAME|PICTURE --dpi X``: the ground of a run or a study by a word."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from omni_analysis.experiment import ExperimentConfiguration
from omni_platform.configuration import ConfigurationError
from omni_sim.ground_picture import read_picture
from omni_sim.ground_texture import PICTURE, TextureConfiguration
from omni_sim.padded_texture import check_footprints

_SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".ppm", ".pgm", ".webp")


def ground_overrides(ground: str | None, dpi: float | None) -> tuple[str, ...]:
    """Return the overrides of an experiment that two options stand for.

    Args:
        ground: a named ground, a YAML file, or a picture; None leaves the experiment's.
        dpi: dots per inch on the ground; None leaves them.

    Raises:
        ConfigurationError: a picture without dots per inch.
    """
    if ground is None or not is_picture(ground):
        named = () if ground is None else (f"ground={json.dumps(ground)}",)
        return named if dpi is None else (*named, f"ground.texture.dpi={dpi!r}")
    if dpi is None:
        raise ConfigurationError(
            "--dpi", f"how many dots per inch of the ground does {ground} have? 2400, for a scan"
        )
    path = str(Path(ground).expanduser().absolute())
    texture = json.dumps({"kind": PICTURE, "picture": path, "dpi": dpi})
    return (f"ground.texture={texture}",)


def check_ground(configurations: Iterable[ExperimentConfiguration]) -> None:
    """Refuse a picture that cannot be a ground before anything starts.

    Raises:
        ConfigurationError: it cannot be read, or a camera sees more than it shows.
    """
    seen: set[TextureConfiguration] = set()
    for configuration in configurations:
        texture = configuration.ground.texture
        if texture.kind != PICTURE or texture in seen:
            continue
        seen.add(texture)
        try:
            picture = read_picture(texture.picture, texture.dpi)
        except ConfigurationError as error:
            raise error.below("ground.texture") from None
        if configuration.simulation.render_lines:
            check_footprints(configuration.sensors, picture)


def is_picture(ground: str) -> bool:
    """Tell a picture from the name of a ground: by its suffix, or as a file that is no YAML.

    Args:
        ground: what stands for the ground.
    """
    path = Path(ground)
    return path.suffix.lower() in _SUFFIXES or (path.suffix != ".yaml" and path.is_file())
