"""``./omni list``: list vehicles, grounds, sensors, experiments, tires, studies and laws.

Print names and descriptions; ./omni show NAME shows one of them.
"""

import re
from pathlib import Path

from omni_bringup.command_report import Report
from omni_bringup.commands import commands_of, first_line
from omni_bringup.workspace import Workspace
from omni_platform.command_options import CommandOptions, option
from omni_platform.configuration import check_choice
from omni_platform.plugins import described_modules

KINDS = ("vehicles", "grounds", "sensors", "experiments", "tires")
STUDIES, LAWS = "studies", "laws"
EVERY = (*KINDS, STUDIES, LAWS)


class Options(CommandOptions):
    """Options of ``omni list``."""

    kinds: tuple[str, ...] = option(
        (), positional=True, metavar="KIND", description=f"one of {', '.join(EVERY)} (default: all)"
    )


def run(options: Options, workspace: Workspace) -> Report:
    """Report the names and descriptions of the items of every kind."""
    for kind in options.kinds:
        check_choice("KIND", kind, EVERY)
    found = {kind: names_of(kind, workspace.folder) for kind in options.kinds or EVERY}
    width = max(len(name) for names in found.values() for name in names)
    lines = {
        kind: [f"  {name:<{width}}  {words}".rstrip() for name, words in names.items()]
        for kind, names in found.items()
    }
    text = [line for kind in found for line in (kind, *lines[kind])]
    return Report(details=found, text=text)


def names_of(kind: str, workspace: Path) -> dict[str, str]:
    """Return the descriptions of the items of a kind (one of `EVERY`), keyed by name."""
    if kind == STUDIES:
        return commands_of("omni_studies.studies")
    if kind == LAWS:
        from omni_brake_assist.configuration import LAWS as BUILT_IN

        described = described_modules("omni_brake_assist.laws")
        return {name: first_line(described[name][1]) for name in BUILT_IN}
    files = sorted((workspace / "config" / kind).glob("*.yaml"))
    return {path.stem: first_sentence(path) for path in files}


def first_sentence(path: Path) -> str:
    """Return the first sentence of the comment at the head of a configuration file."""
    words: list[str] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        words.append(line.lstrip("# "))
        if line.rstrip().endswith((".", ":")):
            break
    text = " ".join(words)
    return re.split(r"(?<!Eq)(?<!Eqs)\. ", text)[0].rstrip(".:")
