"""Command-line options ``--ground NAME|PICTURE --dpi X`` of a run or a study."""

import json
from collections.abc import Iterable
from pathlib import Path

from omni_core.configuration import ConfigurationError
from omni_runs.experiment import ExperimentConfiguration
from omni_sim.texture.cache import TextureCache
from omni_sim.texture.configuration import PICTURE, TextureConfiguration

_SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".ppm", ".pgm", ".webp")


def ground_overrides(ground: str | None, dpi: float | None) -> tuple[str, ...]:
    """Return the experiment overrides that correspond to the options ``--ground`` and ``--dpi``.

    Args:
        ground: name of a ground, a YAML file or a picture; None keeps the experiment's ground.
        dpi: dots of the picture per inch of ground; None keeps the experiment's value.

    Raises:
        ConfigurationError: a picture is given without dots per inch.
    """
    if ground is None or not is_picture(ground):
        named = () if ground is None else (f"ground={json.dumps(ground)}",)
        return named if dpi is None else (*named, f"ground.texture.dpi={dpi!r}")
    if dpi is None:
        raise ConfigurationError(
            "--dpi", f"is required: dots per inch of {ground} on the ground, 2400 for a scan"
        )
    path = str(Path(ground).expanduser().absolute())
    texture = json.dumps({"kind": PICTURE, "picture": path, "dpi": dpi})
    return (f"ground.texture={texture}",)


def prepare_grounds(configurations: Iterable[ExperimentConfiguration], cache: TextureCache) -> None:
    """Render the grounds of a run before its nodes start, and check their pictures.

    This prevents timeouts: rendering a ground with 2400 dpi takes longer than nodes wait.

    Args:
        configurations: configurations of the run's variants.
        cache: folder from which the nodes load the rendered grounds.

    Raises:
        ConfigurationError: a picture cannot be read, or is smaller than a camera's field of view.
    """
    seen: set[TextureConfiguration] = set()
    for configuration in configurations:
        texture = configuration.ground.texture
        if texture in seen or not configuration.simulation.render_lines:
            continue
        seen.add(texture)
        if texture.kind != PICTURE and cache.path(texture).is_file():
            continue
        from omni_sim.camera.footprint.padding import check_footprints  # a slow import

        try:
            ground = cache.texture(texture)
        except ConfigurationError as error:
            raise error.below("ground.texture") from None
        try:
            check_footprints(configuration.sensors, ground)
        except ConfigurationError as error:
            if texture.kind != PICTURE:
                raise
            needed = max(sensor.length for sensor in configuration.sensors.values())
            raise ConfigurationError(
                "ground.texture.picture",
                f"{texture.picture} shows {ground.size:.3g} m of ground at {texture.dpi:g} dpi, "
                f"and {error}; use a picture of at least {needed:g} m, or check the dpi",
            ) from None


def is_picture(ground: str) -> bool:
    """Return whether a ground is given as a picture.

    A ground is a picture if its name has the suffix of an image file, or if it is an existing file
    that is not YAML.

    Args:
        ground: name of a ground or path of a file.
    """
    path = Path(ground)
    return path.suffix.lower() in _SUFFIXES or (path.suffix != ".yaml" and path.is_file())
