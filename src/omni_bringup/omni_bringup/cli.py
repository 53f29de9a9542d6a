"""The command line: ``./omni COMMAND``.

Every command that measures takes ``--json`` and then prints one document on standard output and
nothing else there. Exit codes: 0 done, 1 failed, 2 refused before anything started, 130 ended by
Ctrl-C (143 by SIGTERM).
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from omni_analysis.loop.override_option import add_override_option
from omni_bringup.commands.bag import add_arguments as add_bag_arguments
from omni_bringup.commands.design_sensors import add_arguments as add_design_arguments
from omni_bringup.commands.drive import add_arguments as add_drive_arguments
from omni_bringup.commands.replay import add_arguments as add_replay_arguments
from omni_bringup.commands.report import add_arguments as add_report_arguments
from omni_bringup.exit_codes import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_TERMINATED

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command and exit with its code."""
    _leave_at_once_on_signals()
    options = _parser().parse_args(arguments)
    try:
        code = _run(options)
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


def _run(options: argparse.Namespace) -> int:  # noqa: PLR0911
    # Imported late: help and a mistyped option answer at once.
    if options.command == "study":
        from omni_bringup.commands.study import study

        return study(options, workspace())
    if options.command == "fit-tire":
        from omni_bringup.commands.fit_tire import fit_tire_command

        return fit_tire_command(options, workspace())
    if options.command == "design-sensors":
        from omni_bringup.commands.design_sensors import design_sensors

        return design_sensors(options, workspace())
    if options.command == "bag":
        from omni_bringup.commands.bag import bag

        return bag(options)
    if options.command == "replay":
        from omni_bringup.commands.replay import replay

        return replay(options, workspace())
    if options.command == "report":
        from omni_bringup.commands.report import report

        return report(options)
    if options.command == "drive":
        from omni_bringup.commands.drive import drive

        _clean_up_on_signals()
        return drive(options, workspace())
    from omni_bringup.commands.run import run

    _clean_up_on_signals()
    return run(options, workspace())


def _leave_at_once_on_signals() -> None:
    """End without a word of Python's while there is nothing to clean up.

    An exception out of a signal handler would meet an import half way, and not every extension
    module passes it on as what it is.
    """
    for number in _SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:  # as a shell has it for background jobs
            signal.signal(number, _leave)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)  # the launcher holds them back


def _clean_up_on_signals() -> None:
    if signal.getsignal(signal.SIGINT) == _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGTERM) == _leave:
        signal.signal(signal.SIGTERM, _terminate)


def _leave(number: int, _: object) -> None:
    if number == signal.SIGINT:
        os.write(2, b"interrupted\n")
    os._exit(128 + number)


def _terminate(*_: object) -> None:
    raise SystemExit(EXIT_TERMINATED)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="omni",
        description="Simulate, measure and tune the braking of omnidirectional vehicles.",
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    run = commands.add_parser(
        "run",
        help="run an experiment over the ROS graph, record it and measure it",
        description="Run every variant of an experiment over real ROS processes, record it to a "
        "rosbag2 folder, print the results and draw the figures.",
    )
    run.add_argument(
        "experiment",
        nargs="?",
        default="straight_line",
        metavar="EXPERIMENT",
        help="a file of config/experiments/, or a path that ends in .yaml (default: %(default)s)",
    )
    run.add_argument(
        "--variant",
        action="append",
        default=[],
        metavar="NAME",
        help="run only this variant; may be repeated",
    )
    run.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder of the recordings and figures (default: bags/EXPERIMENT/TIME)",
    )
    add_override_option(run)
    run.add_argument(
        "--ground",
        metavar="NAME|PICTURE",
        help="a file of config/grounds/, or your own scan or photo (PNG, TIFF, JPEG) with --dpi",
    )
    run.add_argument(
        "--dpi",
        type=float,
        metavar="X",
        help="dots per inch of the picture on the ground, or to draw the ground in",
    )
    run.add_argument(
        "--real-time",
        action="store_true",
        help="pace the simulation to the wall clock instead of waiting for every reply",
    )
    run.add_argument(
        "--compression",
        choices=("none", "zstd", "lz4"),
        default="none",
        help="of the recording (%(default)s); noisy lines shrink by about an eighth",
    )
    run.add_argument(
        "--fsync",
        action="store_true",
        help="wait for the disk at every flush, so that a power cut too loses at most a second",
    )
    run.add_argument("--json", action="store_true", help="print the results as JSON")
    _add_studies(
        commands.add_parser("study", help="compute figures and numbers that answer one question")
    )
    _add_fit_tire(commands.add_parser("fit-tire", help="fit a tire model to measured forces"))
    add_design_arguments(
        commands.add_parser(
            "design-sensors",
            help="place line cameras under a chassis so that the twist errs least",
            description="Search the places of line cameras with the smallest mean twist error, "
            "draw them, and judge given and classical placements beside them.",
        )
    )
    add_bag_arguments(commands.add_parser("bag", help="show, check, export or recover a recording"))
    add_replay_arguments(
        commands.add_parser(
            "replay",
            help="run nodes on the recorded inputs once more",
            description="Publish the recorded inputs with /clock to the real nodes, record what "
            "they answer beside the recording, and compare it with what was recorded.",
        )
    )
    add_report_arguments(
        commands.add_parser(
            "report",
            help="show recordings as a page for a browser",
            description="Write one HTML file that needs nothing else: the vehicle from above, the "
            "plots in step with it, the results, and the configuration with its differences.",
        )
    )
    add_drive_arguments(
        commands.add_parser(
            "drive",
            help="drive a vehicle in real time from a page in the browser",
            description="Run the nodes in real time for a person, who drives from a page in the "
            "browser or by cmd_vel. Ctrl-C ends it.",
        )
    )
    commands.add_parser("test", help="run the tests (arguments go to pytest)", add_help=False)
    return parser


def _add_studies(parser: argparse.ArgumentParser) -> None:
    if "study" not in sys.argv[1:2]:
        return  # their modules are many and heavy, and nobody asked
    from omni_analysis.studies import load_study, study_names

    studies = parser.add_subparsers(dest="study", required=True, metavar="STUDY")
    for name in study_names():
        module = load_study(name)
        words = module.__doc__.splitlines()[0]
        one = studies.add_parser(name, help=words, description=words)
        module.add_arguments(one)
        one.add_argument(
            "--out", type=Path, metavar="DIR", help="folder of the figures and data (results/STUDY)"
        )
        one.add_argument("--json", action="store_true", help="print the results as JSON")


def _add_fit_tire(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Estimate the parameters of a tire model from measured forces, and write a tire that a "
        "vehicle can use and a figure of data against curve."
    )
    parser.add_argument(
        "data",
        type=Path,
        metavar="DATA.csv",
        help="file whose first line names the columns slip [1], load [N] and force [N]",
    )
    parser.add_argument(
        "--model",
        default="tmeasy",
        metavar="NAME",
        help="tire model, such as tmeasy, linear, magic_formula (default: %(default)s)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder of the tire and the figure (default: results/fit-tire/DATA)",
    )
    parser.add_argument("--json", action="store_true", help="print the results as JSON")


if __name__ == "__main__":
    main()
