"""Command line ``./omni COMMAND``.

A command returns a `Report` or raises an error. This module prints the report or the error as text
or as JSON, and determines the exit code. With ``--json``, standard output contains exactly one JSON
document, even if a command is rejected or fails. Exit codes: 0 done, 1 failed, 2 rejected before
anything started, 130 ended by Ctrl-C (143 by SIGTERM).
"""

import argparse
import dataclasses
import errno
import json
import os
import re
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from typing import Any, NoReturn

from omni_core import commands, configuration
from omni_core.commands import command_options, command_report
from omni_core.commands.exit_codes import ExitCode
from omni_core.commands.interruption import leave_at_once_on_signals
from omni_core.commands.workspace import at_work, workspace_folder
from omni_ros.environment import check_threads, name_log_folder
from omni_runs.workspace import ExperimentWorkspace

_NARROWEST = 40
"""Smallest width of a table [letters]: one of 20 has no names, and one of 0 is empty"""

_DESCRIPTION = "Simulate, measure and tune the braking of omnidirectional vehicles."


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command and exit with the command's exit code.

    Args:
        arguments: words of the command line, for callers that handle signals themselves; by
            default, those of the process, which then ends at once on a signal.
    """
    if arguments is None:
        leave_at_once_on_signals()
    # Commands report implausible values as notes.
    warnings.simplefilter("ignore", configuration.ConfigurationWarning)
    os.environ.pop("MPLBACKEND", None)  # that of a notebook, which is not installed here
    name_log_folder(os.environ)  # also for commands that use ROS in their own process
    try:
        code = _run(list(sys.argv[1:] if arguments is None else arguments))
        sys.stdout.flush()
    except KeyboardInterrupt as interruption:
        print(": ".join(("interrupted", *map(str, interruption.args))), file=sys.stderr)
        code = ExitCode.INTERRUPTED
    except BrokenPipeError:  # the reading program has ended, as in `| head`
        _discard_output()
        code = ExitCode.FAILED
    sys.exit(code)


def parse_command_line(words: Sequence[str]) -> tuple[str, Any, Any]:
    """Return the program name (such as ``omni bag info``), the command and its parsed options.

    Raises:
        InputError: the value of an option is invalid.
        SystemExit: help was requested, or the command line is invalid.
    """
    command: Any = commands
    program, rest = "omni", list(words)
    while hasattr(command, "PACKAGE"):
        name = _chosen(program, command, rest)
        command = commands.load_command(command, name)
        program = f"{program} {name}"
        rest = rest[1:]
    parser = _Parser(prog=program, description=_introduction(command.__doc__))
    parser.as_json = "--json" in rest
    try:
        return program, command, command_options.parse_options(command.Options, rest, parser)
    except configuration.InputError as error:
        parser.exit(ExitCode.REFUSED, f"{program}: {error}\n")


def _run(words: Sequence[str]) -> int:
    program, command, options = parse_command_line(words)
    as_json = getattr(options, "json", False)
    work = at_work(program, command.WORK) if hasattr(command, "WORK") else nullcontext()
    try:
        check_threads(os.environ)
        with work, _output_to_standard_error() if as_json else nullcontext():
            report = command.run(options, ExperimentWorkspace(workspace_folder(), program))
            report = dataclasses.replace(report, name=report.name or _name(program))
        return _publish(report, program, as_json=as_json)
    except BrokenPipeError:
        raise
    except configuration.InputError as error:
        code, problem = ExitCode.REFUSED, str(error)
    except configuration.WorkError as error:
        code, problem = ExitCode.FAILED, str(error)
    except OSError as error:
        # No file can have such a name, so the error is in the user's input.
        refused = error.errno == errno.ENAMETOOLONG
        code = ExitCode.REFUSED if refused else ExitCode.FAILED
        problem = f"cannot access {error.filename or 'a file'}: {error.strerror or error}"
        problem = configuration.shortened(problem)
    _complain(program, problem)
    if as_json:
        _print_failure(program, problem, code)
    return code


@contextmanager
def _output_to_standard_error() -> Iterator[None]:
    """Redirect standard output to standard error inside the ``with`` block.

    Standard output therefore contains only the JSON document, which is printed after this block.
    """
    sys.stdout.flush()
    standard_output = os.dup(1)
    os.dup2(2, 1)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        os.dup2(standard_output, 1)
        os.close(standard_output)


def _publish(report: command_report.Report, program: str, *, as_json: bool) -> int:
    """Store and print the result of a command; return the exit code."""
    if report.summary is not None:
        document = json.dumps(report.document, indent=2, allow_nan=False)
        command_report.write_text(report.summary / "summary.json", document + "\n")
    with _checked_output():
        _print_report(report, as_json=as_json)
    for problem in report.problems:
        _complain(program, problem)
    return ExitCode.OK if report.ok and not report.problems else ExitCode.FAILED


@contextmanager
def _checked_output() -> Iterator[None]:
    """Raise `WorkError` if the output of the ``with`` block cannot be written.

    If the program that reads the output has ended, `BrokenPipeError` is raised.
    """
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:  # such as a full disk
        _discard_output()
        raise configuration.WorkError(f"cannot write the output: {error.strerror}") from None


def _print_report(report: command_report.Report, *, as_json: bool) -> None:
    if as_json:
        _print_json(report.document)
        return
    for part in report.text:
        _print_part(part)
    for path in report.files:
        print(f"wrote {path}")
    for line in report.hints:
        print(line)


def _print_part(part: Any) -> None:
    if isinstance(part, str):
        print(part)
        return
    from rich.console import Console

    console = Console()
    console.width = max(console.width, _NARROWEST)
    console.print(part)


def _discard_output() -> None:
    """Discard all further output, as it cannot be written."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _print_json(document: Mapping[str, Any]) -> None:
    print(json.dumps(document, indent=2, allow_nan=False))


def _complain(program: str, problem: str) -> None:
    for line in problem.splitlines():
        print(f"{program}: {command_report.printable(line)}", file=sys.stderr)


def _print_failure(program: str, problem: str, code: int) -> None:
    """Print the JSON document of a command that failed or was rejected, if it can be written."""
    with suppress(configuration.WorkError), _checked_output():
        _print_json({"name": _name(program), "error": problem, "exit_code": code})


def _name(program: str) -> str:
    """Return the name of a command's JSON document, such as ``bag_info``."""
    return program.removeprefix("omni ").replace(" ", "_")


def _chosen(program: str, group: Any, words: Sequence[str]) -> str:
    """Return the name of a command, which is the first word.

    If the first word is no command, print help or an error, and exit.

    Args:
        program: name of the program, for messages.
        group: module with the ``PACKAGE`` of the commands.
        words: remaining words of the command line.
    """
    what = "STUDY" if program == "omni study" else "ACTION" if program != "omni" else "COMMAND"
    known = commands.commands_of(group.PACKAGE)
    if words and words[0] in known:
        return words[0]
    top = program == "omni"
    parser = _Parser(prog=program, description=_DESCRIPTION if top else _introduction(group))
    parser.as_json = "--json" in words
    choices = parser.add_subparsers(metavar=what, required=True)
    shown = known | commands.OF_THE_LAUNCHER if top else known
    for name, line in sorted(shown.items()):
        choices.add_parser(name, help=line.replace("%", "%%"))
    if words and not words[0].startswith("-"):
        hint = configuration.did_you_mean(words[0], shown)
        parser.error(f"{words[0]!r} is not one of {', '.join(shown)}{hint}")
    if top:
        parser.add_argument("--version", action="version", version=_version())
    parser.parse_args(words[:1])
    parser.error(f"{what} is missing")


def _version() -> str:
    from importlib.metadata import version

    return f"omni {version('omni_bringup')}"


def _introduction(words: Any) -> str:
    """Return the introduction of a help text.

    The introduction is the second paragraph of a command's docstring, or the first line of any
    other docstring.

    Args:
        words: docstring, or a module with a docstring.
    """
    words = words if isinstance(words, str) else words.__doc__
    paragraphs = words.strip().split("\n\n")
    if words.startswith("``") and len(paragraphs) > 1:
        return str(paragraphs[1]).replace("%", "%%")
    return commands.first_line(words).replace("%", "%%")


class _Parser(argparse.ArgumentParser):
    """Parser that suggests similar options, and prints errors as JSON if JSON is requested."""

    as_json = False

    def error(self, message: str) -> NoReturn:
        found = re.match(r"unrecognized arguments: (--[^ =]+)", message)
        if found:
            options = re.findall(r"--[\w-]+", self.format_usage())
            hint = configuration.did_you_mean(found[1], options)
            if not hint and "--set" in options:
                hint = "; --set KEY=VALUE changes any value of the experiment"
            message += hint
        super().error(configuration.shortened(message))

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        if status and self.as_json:
            problem = (message or "").strip().removeprefix(f"{self.prog}: ")
            _print_failure(self.prog, problem.removeprefix("error: "), status)
        super().exit(status, message)

    def _print_message(self, message: str, file: Any = None) -> None:
        if file is not sys.stdout:
            super()._print_message(message, file)
            return
        try:
            with _checked_output():  # argparse would ignore an error
                file.write(message)
        except configuration.WorkError as error:
            super().exit(ExitCode.FAILED, f"{self.prog}: {error}\n")


if __name__ == "__main__":
    main()
