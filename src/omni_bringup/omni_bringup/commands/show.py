"""``./omni show``: see a vehicle, ground, tire, placement or experiment, in words and drawn.

Print what a name of ./omni list stands for, and draw it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from omni_bringup.commands.list import KINDS, first_sentence
from omni_bringup.exit_codes import EXIT_OK
from omni_platform.command_options import json_option, option
from omni_platform.configuration import Configuration, ConfigurationError, did_you_mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from omni_analysis.loop.experiment import ExperimentLibrary


_DPI = 300.0  # of a ground that is drawn


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Options of ``omni show``."""

    name: str = option(
        positional=True,
        metavar="NAME",
        description="one of ./omni list, or a path that ends in .yaml",
    )
    kind: str | None = option(
        None, metavar="KIND", choices=KINDS, description="where two kinds share a name, or a path"
    )
    out: Path | None = option(
        None, metavar="FILE", description="the picture (default: results/show/NAME.png)"
    )
    json: bool = json_option()


def run(options: Options, workspace: Path) -> int:
    """Print and draw it; return the exit code."""
    from omni_analysis.figures.style import save_figure
    from omni_analysis.loop.experiment import ExperimentLibrary

    kind, path = _find(options, workspace / "config")
    library = ExperimentLibrary(workspace / "config")
    facts, figure = _shown(kind, options.name, library)
    picture = options.out or workspace / "results" / "show" / f"{path.stem}.png"
    try:
        picture.parent.mkdir(parents=True, exist_ok=True)
        save_figure(figure, picture)
    except OSError as error:
        raise ConfigurationError("--out", f"cannot write {picture}: {error.strerror}") from None
    if options.json:
        document = {"name": path.stem, "kind": kind, "facts": facts, "picture": str(picture)}
        print(json.dumps(document, indent=2))
        return EXIT_OK
    print(f"{path.stem} ({path})")
    print(first_sentence(path))
    for key, words in facts.items():
        print(f"  {key}: {words}")
    print(f"figure {picture}")
    return EXIT_OK


def _find(options: Options, config: Path) -> tuple[str, Path]:
    """Return the kind of a name and its file."""
    if options.name.endswith(".yaml"):
        if options.kind is None:
            raise ConfigurationError("--kind", f"what is in {options.name}? {', '.join(KINDS)}")
        return options.kind, Path(options.name)
    kinds = (options.kind,) if options.kind else KINDS
    found = [
        (kind, path) for kind in kinds if (path := config / kind / f"{options.name}.yaml").is_file()
    ]
    if not found:
        known = sorted({path.stem for kind in kinds for path in (config / kind).glob("*.yaml")})
        raise ConfigurationError(
            "NAME",
            f"{options.name!r} is not known{did_you_mean(options.name, known) or ';'} ./omni list "
            "names all",
        )
    return found[0]


def _shown(kind: str, name: str, library: ExperimentLibrary) -> tuple[dict[str, str], Figure]:
    from omni_analysis.vehicles import drawings

    if kind == "vehicles":
        vehicle = library.vehicle(name)
        return drawings.vehicle_in_words(vehicle), drawings.draw_vehicle(vehicle)
    base = "straight_line"
    variant = library.variants(base)[0]
    if kind == "tires":
        tire = library.load(base, variant, [f"vehicle.tire={name}"]).vehicle.tire
        return drawings.tire_in_words(tire), drawings.draw_tire(tire, Path(name).stem)
    if kind == "grounds":
        ground = library.load(base, variant, [f"ground={name}"]).ground
        if ground.texture.kind != "picture":  # finer than a screen, which takes long to grow
            coarse = [f"ground={name}", f"ground.texture.dpi={_DPI}"]
            ground = library.load(base, variant, coarse).ground
        return drawings.ground_in_words(ground), drawings.draw_ground(ground, Path(name).stem)
    if kind == "sensors":
        sensors = library.sensors(name)
        return drawings.sensors_in_words(sensors), drawings.draw_sensors(sensors)
    experiment = library.load(name, library.variants(name)[-1])
    words = drawings.vehicle_in_words(experiment.vehicle)
    words = {"variants": ", ".join(library.variants(name)), **words}
    return words, drawings.draw_vehicle(experiment.vehicle, experiment.sensors)
