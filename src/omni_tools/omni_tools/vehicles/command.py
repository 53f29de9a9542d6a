"""``./omni new-vehicle``: write the files of your vehicle from a few measured numbers.

Write the files of a vehicle, its line cameras and an example stop into a folder. Estimated values
are marked, and implausible values are reported. On a terminal, the command asks for values that are
not given. With --from, the values are those of the files of a robot: its description, and the
parameters of its controller. Values that these files contradict or lack are listed.
"""

import contextlib
import dataclasses
import re
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_core.brakes import BRAKES, BRAKES_IN_WORDS
from omni_core.commands.command_options import CommandOptions, option, option_of
from omni_core.commands.command_report import Report, entries_by_case, make_folder
from omni_core.configuration import ConfigurationError, declared_parameters, from_mapping
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_runs.experiment import ExperimentConfiguration
    from omni_tools.robot_files.described import Described

_MECANUM, _OMNI, _KIWI = KINDS = ("mecanum", "omni", "kiwi")
_USUAL = {_MECANUM: 4, _OMNI: 4, _KIWI: 3}  # default number of wheels


class Options(CommandOptions):
    """Options of ``omni new-vehicle``."""

    name: str = option(positional=True, metavar="NAME")
    """name of the vehicle and of its folder"""
    length: float | None = option(None, unit="m")
    """length of the chassis"""
    width: float | None = option(None, unit="m")
    """width of the chassis"""
    mass: float | None = option(None, unit="kg")
    """mass of the chassis including wheels"""
    wheel_radius: float | None = option(None, unit="m")
    """radius of a wheel"""
    kind: str | None = option(None, choices=KINDS)
    """type of the wheels: `mecanum` in pairs (default), `omni` for omni-wheels on a circle, or
    `kiwi` for three omni-wheels"""
    wheels: int | None = option(None)
    """number of wheels (default: 4; 3 for a kiwi)"""
    load: float | None = option(None, unit="kg")
    """mass of a load at the front left (default: 0)"""
    drive_torque: float | None = option(None, unit="N m")
    """maximum torque of a drive at its wheel (default: an estimate)"""
    drive_power: float | None = option(None, unit="W")
    """maximum power with which a drive brakes its wheel (default: no limit)"""
    brakes: str | None = option(
        None, choices=tuple(BRAKES), description=f"{BRAKES_IN_WORDS} (default: on_off)"
    )
    files: tuple[str, ...] = option((), flag="--from", metavar="FILE", many=True)
    """URDF or xacro file of the robot, parameter files of its controllers, and values of arguments
    of the xacro file as ARGUMENT:=VALUE"""
    trust: bool = option(False)
    """evaluate any Python in the xacro files, which may then do anything that you may do"""
    skip_missing: bool = option(False)
    """leave out what the xacro files include from packages that are missing"""
    out: Path | None = option(None, metavar="DIR")
    """new folder for the files (default: NAME)"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Write the files, and report the loads and forces of each wheel."""
    from omni_core.quantities import plain
    from omni_runs.graph.run_folder import unused
    from omni_runs.plausibility import remarks
    from omni_sim.vehicle.plausibility import wheel_facts
    from omni_tools.vehicles.estimates import KnownValues, Measured, MeasuredByFiles, write_vehicle
    from omni_tools.vehicles.from_files import described_vehicle, known_values

    folder = unused(options.out or Path(options.name))
    found = None
    if options.files:
        given = options.kind and (_OMNI if options.kind == _KIWI else options.kind)
        how = {"trust": options.trust, "skip_missing": options.skip_missing}
        found = described_vehicle(options.files, given, options.wheel_radius, **how)
        found.questions = [one for one in found.questions if not _answered(one, options)]
    answers = _answers(options, found)
    try:
        measured = from_mapping(Measured if found is None else MeasuredByFiles, answers)
    except ConfigurationError as error:
        raise ConfigurationError(option_of(Options, error.key), error.problem) from None
    known = KnownValues() if found is None else known_values(options.name, found, measured)
    existed = folder.exists()
    paths = write_vehicle(options.name, measured, make_folder(folder), known)
    experiment = _checked(paths, workspace, existed)
    facts = wheel_facts(experiment.vehicle, experiment.ground.friction)
    notes = list(remarks(experiment))
    return Report(
        metrics=entries_by_case(
            {
                name: {key: (value, "N") for key, value in dataclasses.asdict(fact).items()}
                for name, fact in facts.items()
            }
        ),
        details={
            "notes": notes,
            **({} if found is None else found.lists),
            "files": list(map(str, paths)),
        },
        files=paths,
        hints=(
            *(
                f"{name}: load {plain(fact.load)} N, friction limit {plain(fact.grip)} N, "
                f"brake force {plain(fact.brake_force)} N"
                for name, fact in facts.items()
            ),
            *(f"contradiction: {one}" for one in (found.contradictions if found else ())),
            *(f"missing: {one}" for one in (found.questions if found else ())),
            *(f"note: {note}" for note in notes),
            "estimates are marked in vehicle.yaml; replace what you can measure",
            f"run a stop: ./omni run {shlex.quote(str(folder / 'experiment.yaml'))}",
            f"compare speed sensors: ./omni study feedback --vehicle {shlex.quote(str(folder))}",
        ),
    )


def _checked(
    paths: Sequence[Path], workspace: ExperimentWorkspace, existed: bool
) -> "ExperimentConfiguration":
    """Return the experiment in new files; delete the files if they describe no vehicle.

    Args:
        paths: the new files of a folder; the last one is the experiment.
        workspace: workspace of the experiment.
        existed: whether the folder existed before; otherwise it is deleted with the files.

    Raises:
        ConfigurationError: an estimate is out of its range.
    """
    try:
        return workspace.experiment_library().load(str(paths[-1]), "assisted")
    except ConfigurationError as error:
        for path in paths:
            path.unlink()
        if not existed:
            paths[-1].parent.rmdir()
        remedy = "estimated from the given numbers: check them and their units (m, kg)"
        raise ConfigurationError(error.key, f"{error.problem}; {remedy}") from None


def _answered(question: str, options: Options) -> bool:
    """Return whether the user gives all options that a question ends with."""
    asked = re.fullmatch(r".*\((--[a-z, -]+)\)", question)
    names = asked[1].replace("--", "").replace("-", "_").split(", ") if asked else []
    return bool(names) and all(getattr(options, name, None) is not None for name in names)


def _answers(options: Options, found: "Described | None") -> dict[str, Any]:
    """Return the values of `Measured`; ask on the terminal for missing values.

    Args:
        options: options of the command, which come first.
        found: vehicle that the files of a robot describe, if any.

    Raises:
        ConfigurationError: a value is missing, and there is no terminal; all are named.
    """
    from omni_tools.vehicles.estimates import Measured

    values: dict[str, Any] = {}
    lacking: list[ConfigurationError] = []
    described = {} if found is None else found.measured
    for name, kind, info in declared_parameters(Measured):
        usual: Any = getattr(Measured, name, None)
        if name == "wheels":
            usual = _USUAL[values["kind"]]
        given = getattr(options, name)
        if given is None and described:  # only what the files lack is asked for
            given = described.get(name, usual)
        words = f"{info.description} [{info.unit}]" if info.unit else info.description
        choices = KINDS if name == "kind" else info.choices
        flag = f"--{name.replace('_', '-')}"
        try:
            values[name] = _entered(flag, words, kind, choices, usual) if given is None else given
        except ConfigurationError as error:
            lacking.append(error)
    if lacking:
        first, *others = lacking
        asked = () if found is None else found.questions
        reasons = [one for one in asked if any(error.key in one for error in lacking)]
        problems = (first.problem, *map(str, others), *reasons)
        raise ConfigurationError(first.key, "; ".join(problems))
    if values["kind"] == _KIWI:
        if values["wheels"] != _USUAL[_KIWI]:
            raise ConfigurationError("--wheels", f"{values['wheels']} must be 3 for a kiwi")
        values["kind"] = _OMNI
    return values


def _entered(flag: str, words: str, kind: Any, choices: Sequence[str] | None, usual: Any) -> Any:
    """Return the value that the user enters on the terminal, or the usual value if none is given.

    Args:
        flag: option for this value, for error messages.
        words: description of the value, with its unit.
        kind: type of the value.
        choices: permitted values; None for any value.
        usual: value if nothing is entered; None if a value must be entered.

    Raises:
        ConfigurationError: there is no terminal and no usual value.
    """
    from rich import console, markup, prompt

    dialog: Any = {float: prompt.FloatPrompt, int: prompt.IntPrompt}.get(kind, prompt.Prompt)
    if sys.stdin.isatty():
        with contextlib.suppress(EOFError):
            return dialog.ask(
                markup.escape(words),
                console=console.Console(stderr=True),
                choices=choices and list(choices),
                default=... if usual is None else usual,
            )
    if usual is None:
        raise ConfigurationError(flag, f"is required: the {words}")
    return usual
