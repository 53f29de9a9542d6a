"""``./omni list``: list vehicles, grounds, sensors, experiments, tires, studies and laws.

Print names and descriptions; ./omni show NAME shows one of them.
"""

from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report
from omni_core.configuration import check_choice
from omni_runs.workspace import EVERY, ExperimentWorkspace, names_of


class Options(CommandOptions):
    """Options of ``omni list``."""

    kinds: tuple[str, ...] = option(
        (), positional=True, metavar="KIND", description=f"one of {', '.join(EVERY)} (default: all)"
    )


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
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
