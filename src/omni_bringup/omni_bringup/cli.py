"""The command line: ``./omni COMMAND``.

Every command that measures takes ``--json`` and then prints one document on standard output and
nothing else there. Exit codes: 0 done, 1 failed, 2 refused before anything started, 130 ended by
Ctrl-C (143 by SIGTERM).
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any, NoReturn

from omni_bringup import commands
from omni_bringup.exit_codes import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_REFUSED
from omni_bringup.interruption import leave_at_once_on_signals
from omni_bringup.progress_bar import at_work
from omni_platform.command_options import parse_options
from omni_platform.configuration import ConfigurationError, did_you_mean
from omni_ros.start import start_lightly

_DESCRIPTION = "Simulate, measure and tune the braking of omnidirectional vehicles."
_OF_THE_LAUNCHER = {"test": "run the tests (arguments go to pytest)"}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command and exit with its code."""
    leave_at_once_on_signals()
    start_lightly()
    try:
        code = _run(list(sys.argv[1:] if arguments is None else arguments))
        sys.stdout.flush()
    except KeyboardInterrupt as interruption:
        print(": ".join(("interrupted", *map(str, interruption.args))), file=sys.stderr)
        code = EXIT_INTERRUPTED
    except BrokenPipeError:  # the reader of our output has gone, as in `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = EXIT_FAILED
    sys.exit(code)


def workspace() -> Path:
    """Return the folder with `config` and `bags`: the launcher's, else the current one."""
    return Path(os.environ.get("OMNI_WORKSPACE", "."))


def understand(words: Sequence[str]) -> tuple[str, Any, Any]:
    """Return the program of a command line, as in ``omni bag info``, its module and its options.

    Raises:
        SystemExit: the words ask for help, or are no command line.
    """
    command: Any = commands
    program, rest = "omni", list(words)
    while hasattr(command, "PACKAGE"):
        name = _chosen(program, command, rest)
        command = commands.load_command(command, name)
        program = f"{program} {name}"
        rest = rest[1:]
    parser = _Parser(prog=program, description=_introduction(command.__doc__))
    try:
        return program, command, parse_options(command.Options, rest, parser)
    except ConfigurationError as error:
        parser.exit(EXIT_REFUSED, f"{program}: {error}\n")


def _run(words: Sequence[str]) -> int:
    program, command, options = understand(words)
    try:
        with at_work(program, command.WORK) if hasattr(command, "WORK") else nullcontext():
            code: int = command.run(options, workspace())
    except ConfigurationError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return EXIT_REFUSED
    return code


def _chosen(program: str, group: Any, words: Sequence[str]) -> str:
    """Return the command of a group that the first word names; help and errors end here."""
    what = "STUDY" if program == "omni study" else "ACTION" if program != "omni" else "COMMAND"
    known = commands.commands_of(group.PACKAGE)
    if words and words[0] in known:
        return words[0]
    top = program == "omni"
    parser = _Parser(prog=program, description=_DESCRIPTION if top else _introduction(group))
    choices = parser.add_subparsers(metavar=what, required=True)
    for name, line in sorted((known | (_OF_THE_LAUNCHER if top else {})).items()):
        choices.add_parser(name, help=line.replace("%", "%%"))
    if words and not words[0].startswith("-"):
        hint = did_you_mean(words[0], [*known, *(_OF_THE_LAUNCHER if top else ())])
        parser.error(f"{words[0]!r} is not one of {', '.join(known)}{hint}")
    if top:
        parser.add_argument("--version", action="version", version=_version())
    parser.parse_args(words[:1])
    parser.error(f"{what} is missing")


def _version() -> str:
    from importlib.metadata import version

    return f"omni {version('omni_bringup')}"


def _introduction(words: Any) -> str:
    """Return what a docstring says of a command: its second paragraph, else its first line."""
    words = words if isinstance(words, str) else words.__doc__
    paragraphs = words.strip().split("\n\n")
    if words.startswith("``") and len(paragraphs) > 1:
        return str(paragraphs[1]).replace("%", "%%")
    return commands.first_line(words).replace("%", "%%")


class _Parser(argparse.ArgumentParser):
    """Asks whether another option was meant."""

    def error(self, message: str) -> NoReturn:
        found = re.match(r"unrecognized arguments: (--[^ =]+)", message)
        if found:
            message += did_you_mean(found[1], self._option_string_actions)
        super().error(message)


if __name__ == "__main__":
    main()
