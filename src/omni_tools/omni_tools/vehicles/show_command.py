"""``./omni show``: describe and draw a vehicle, ground, tire, placement or experiment.

Describe and draw an item of ./omni list; for a study or law, print its purpose and options.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING

from omni_core import configuration
from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report
from omni_runs import workspace as items
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from omni_runs.experiment import ExperimentLibrary


WORK = "drawing"


class Options(CommandOptions):
    """Options of ``omni show``."""

    name: str = option(positional=True, metavar="NAME")
    """name from ./omni list, a path that ends in .yaml, or the folder of a vehicle"""
    kind: str | None = option(None, metavar="KIND", choices=items.EVERY)
    """kind of the item (default: that of the first item with this name; for a path, the kind to
    which the keys of the file belong)"""
    out: Path | None = option(None, metavar="FILE")
    """file of the figure (default: results/show/NAME.png)"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Describe an item, and draw it if possible."""
    kind, path = _find(options, workspace)
    if kind in (items.STUDIES, items.LAWS):
        return _described(kind, options)
    from omni_runs.experiment import short_name
    from omni_runs.figures.style import save_figure

    name = short_name(path)
    facts, figure = _shown(kind, options.name, workspace.checked_experiments())
    picture = options.out or workspace.results(None, "show") / f"{name}.png"
    save_figure(figure, picture)
    return Report(
        name=name,
        details={"kind": kind, "facts": facts, "picture": str(picture)},
        text=(
            f"{name} ({path})",
            items.first_sentence(path),
            *(f"  {key}: {words}" for key, words in facts.items()),
            f"figure {picture}",
        ),
    )


def _find(options: Options, workspace: ExperimentWorkspace) -> tuple[str, Path]:
    """Return the kind and the file of the item with the given name."""
    folder = workspace.experiment_library().located(options.kind or "vehicles", options.name)
    if folder != options.name:
        return options.kind or "vehicles", Path(folder)
    if options.name.endswith(".yaml"):
        return _kind_of(options), Path(options.name)
    kinds = [kind for kind in items.KINDS if options.kind in (None, kind)]
    found = [
        (kind, path)
        for kind in kinds
        if (path := workspace.config / kind / f"{options.name}.yaml").is_file()
    ]
    texts = [kind for kind in (items.STUDIES, items.LAWS) if options.kind in (None, kind)]
    found += [
        (kind, Path()) for kind in texts if options.name in items.names_of(kind, workspace.folder)
    ]
    if not found:
        looked_in = [kind for kind in items.EVERY if options.kind in (None, kind)]
        known = sorted(
            {name for kind in looked_in for name in items.names_of(kind, workspace.folder)}
        )
        raise configuration.ConfigurationError(
            "NAME",
            f"{options.name!r} is not known"
            f"{configuration.did_you_mean(options.name, known) or ';'} ./omni list shows all names,"
            " or give a path that ends in .yaml",
        )
    for kind, _ in found[1:]:
        workspace.note(f"--kind {kind} shows the other item of this name")
    return found[0]


def _kind_of(options: Options) -> str:
    """Return the kind of a file: the given kind, or the one to which its keys belong."""
    from omni_runs.yaml_files import read_mapping
    from omni_tools.vehicles.file_kinds import possible_kinds

    if options.kind in items.KINDS:
        return options.kind
    values = read_mapping(Path(options.name), "NAME")
    kinds = possible_kinds(values)
    if "wheels" in values and "experiments" in kinds:
        problem = f"{options.name} describes nodes of a real vehicle, for ./omni ros-params"
        raise configuration.ConfigurationError("NAME", f"{problem}; give the file of the vehicle")
    if len(kinds) != 1:
        found = (
            f"its keys belong to {' and '.join(kinds)}" if kinds else "none of its keys is known"
        )
        problem = f"the kind of {options.name} is required, because {found}: one of"
        raise configuration.ConfigurationError("--kind", f"{problem} {', '.join(items.KINDS)}")
    return kinds[0]


def _described(kind: str, options: Options) -> Report:
    """Return the description of a study or law, with the options of a study."""
    import inspect

    facts: dict[str, str] = {}
    if kind == items.STUDIES:
        from omni_core import commands

        study = commands.load_command(commands.load_command(commands, "study"), options.name)
        words = study.__doc__
        for name, _, info in configuration.declared_parameters(study.Options):
            facts[f"--{name.replace('_', '-')}"] = info.description
    else:
        words = importlib.import_module(f"omni_brake_assist.laws.{options.name}").__doc__ or ""
    words = inspect.cleandoc(words).replace("``", "")
    use = f"study {options.name}" if kind == items.STUDIES else f"run --law {options.name}"
    return Report(
        name=options.name,
        details={"kind": kind, "words": words, "facts": facts},
        text=(
            f"{options.name} ({kind})\n\n{words}\n",
            *(f"  {key}: {what}" for key, what in facts.items()),
            f"try it: ./omni {use}",
        ),
    )


def _shown(kind: str, name: str, library: ExperimentLibrary) -> tuple[dict[str, str], Figure]:
    from omni_tools.vehicles import drawings

    if kind == "vehicles":
        vehicle = library.vehicle(name)
        return drawings.vehicle_in_words(vehicle), drawings.draw_vehicle(vehicle)
    if kind == "tires":
        tire = library.tire(name)
        return drawings.tire_in_words(tire), drawings.draw_tire(tire, Path(name).stem)
    if kind == "grounds":
        base = "straight_line"
        ground = library.load(base, overrides=[f"ground={name}"]).ground
        if ground.texture.kind != "picture":  # full resolution takes long and no screen shows it
            coarse = [f"ground={name}", "ground.texture.dpi=300"]
            ground = library.load(base, overrides=coarse).ground
        return drawings.ground_in_words(ground), drawings.draw_ground(ground, Path(name).stem)
    if kind == "sensors":
        sensors = library.sensors(name)
        return drawings.sensors_in_words(sensors), drawings.draw_sensors(sensors)
    experiment = library.load(name)
    words = drawings.vehicle_in_words(experiment.vehicle)
    words = {"variants": ", ".join(library.variants(name)), **words}
    return words, drawings.draw_vehicle(experiment.vehicle, experiment.sensors)
