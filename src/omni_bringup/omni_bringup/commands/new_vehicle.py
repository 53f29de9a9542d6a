"""``./omni new-vehicle``: write the files of your vehicle from a few measured numbers.

Write a vehicle, its line cameras and a stop into a folder, with estimates that say that they are
estimates, and say what does not fit together. Asks for what is not given, on a terminal.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from omni_bringup.exit_codes import EXIT_OK
from omni_platform.command_options import option
from omni_platform.configuration import Configuration, ConfigurationError, parameter

_NEEDED = {
    "length": ("length of the chassis", "m"),
    "width": ("width of the chassis", "m"),
    "mass": ("mass of the vehicle with its wheels", "kg"),
    "wheel_radius": ("radius of a wheel", "m"),
}


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Options of ``omni new-vehicle``."""

    name: str = option(
        positional=True, metavar="NAME", description="of the vehicle; its folder is called so"
    )
    length: float | None = parameter(None, unit="m", description="length of the chassis")
    width: float | None = parameter(None, unit="m", description="width of the chassis")
    mass: float | None = parameter(None, unit="kg", description="mass with the wheels")
    wheel_radius: float | None = parameter(None, unit="m", description="radius of a wheel")
    kind: str = parameter(
        "mecanum",
        choices=("mecanum", "omni"),
        description="mecanum wheels in pairs, or three omni-wheels on a circle",
    )
    wheels: int | None = parameter(
        None, description="how many (default: 4 mecanum or 3 omni-wheels)"
    )
    load: float = parameter(0.0, unit="kg", description="mass of a load, to the front left")
    out: Path | None = option(
        None, metavar="DIR", description="new folder of the files (default: NAME)"
    )


def run(options: Options, workspace: Path) -> int:
    """Write the files and return the exit code."""
    from omni_analysis.loop.experiment import ExperimentLibrary
    from omni_analysis.vehicles.estimates import Measured, new_vehicle
    from omni_analysis.vehicles.plausibility import remarks, wheel_facts
    from omni_bringup.graph.run_folder import check_unused
    from omni_platform.configuration import from_mapping

    folder = options.out or Path(options.name)
    check_unused(folder)
    values = {key: _asked(key, getattr(options, key)) for key in _NEEDED}
    wheels = options.wheels or (3 if options.kind == "omni" else 4)
    try:
        measured = from_mapping(
            Measured, {**values, "kind": options.kind, "wheels": wheels, "load": options.load}
        )
    except ConfigurationError as error:
        flag = "--" + error.key.replace("_", "-")
        raise ConfigurationError(flag, error.problem) from None
    paths = new_vehicle(options.name, measured).write(folder)
    library = ExperimentLibrary(workspace / "config")
    experiment = library.load(str(folder / "experiment.yaml"), "assisted")
    for path in paths:
        print(f"wrote {path}")
    facts = wheel_facts(experiment.vehicle, experiment.ground.friction)
    for name, fact in facts.items():
        print(
            f"{name}: carries {fact.load:.3g} N, the ground holds {fact.grip:.3g} N, the brake "
            f"{fact.brake_force:.3g} N"
        )
    for remark in remarks(experiment):
        print(f"note: {remark}")
    print("estimates are marked in vehicle.yaml; replace what you can measure")
    print(f"brake it: ./omni run {folder / 'experiment.yaml'}")
    return EXIT_OK


def _asked(key: str, given: float | None) -> float:
    """Return a value that was given, or that a person on a terminal gives."""
    if given is not None:
        return given
    words, unit = _NEEDED[key]
    option_words = "--" + key.replace("_", "-")
    if not sys.stdin.isatty():
        raise ConfigurationError(option_words, f"is required: the {words} [{unit}]")
    while True:
        print(f"{words} [{unit}]: ", end="", file=sys.stderr, flush=True)
        line = sys.stdin.readline()
        if not line:
            raise ConfigurationError(option_words, f"is required: the {words} [{unit}]")
        try:
            return float(line)
        except ValueError:
            print(f"{line.strip()!r} is not a number", file=sys.stderr)
