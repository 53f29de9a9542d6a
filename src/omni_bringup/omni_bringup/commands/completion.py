"""``./omni completion``: print a bash completion script for commands, options and names.

Enable it with: eval "$(./omni completion)"
"""

from collections.abc import Iterator
from importlib import resources
from typing import Any

from omni_core import commands, configuration
from omni_core.commands import command_options
from omni_core.commands.command_report import Report
from omni_runs.workspace import EVERY, ExperimentWorkspace, names_of

_VALUES = {"--vehicle": "vehicles", "--ground": "grounds", "--experiment": "experiments"}
_NAMED = {"run": "experiments", "limit": "experiments"}  # kind of name that follows a command


class Options(configuration.Configuration):
    """Options of ``omni completion``, which has none."""


def run(_options: Options, workspace: ExperimentWorkspace) -> Report:
    """Return the completion script for bash."""
    names = {kind: sorted(names_of(kind, workspace.folder)) for kind in EVERY}
    cases = list(_cases(commands, "", names))
    values = [f'    {flag}) choices="{" ".join(names[kind])}" ;;' for flag, kind in _VALUES.items()]
    # The shell uses the first match, so "study table2" must come before "study".
    cases.sort(key=lambda case: -len(case[0]))
    lines = [f'    "{path}"{"*" if path else ""}) choices="{words}" ;;' for path, words in cases]
    script = (resources.files(__package__) / "completion.bash").read_text(encoding="utf-8")
    script = script.replace("@CASES@", "\n".join(lines)).replace("@VALUES@", "\n".join(values))
    return Report(text=script.splitlines())


def _cases(group: Any, path: str, names: dict[str, list[str]]) -> Iterator[tuple[str, str]]:
    """Yield pairs of the words typed so far and the words that may follow.

    Args:
        group: module with a ``PACKAGE`` of commands.
        path: words of the command line before the name of a command; empty for all commands.
        names: names of the items of ``./omni list``, keyed by kind.
    """
    known = commands.commands_of(group.PACKAGE)
    yield path, " ".join([*known, *(() if path else commands.OF_THE_LAUNCHER)])
    for name in known:
        command = commands.load_command(group, name)
        words = f"{path} {name}".strip()
        if hasattr(command, "PACKAGE"):
            yield from _cases(command, words, names)
        else:
            first = names[_NAMED[name]] if name in _NAMED else []
            if name == "show":
                first = sorted({one for some in names.values() for one in some})
            yield words, " ".join([*command_options.flags_of(command.Options), "--help", *first])
