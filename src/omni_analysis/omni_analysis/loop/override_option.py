"""The option that overrides values of the configuration."""

from __future__ import annotations

import argparse


def add_override_option(
    parser: argparse.ArgumentParser, example: str = "vehicle.load.mass=400"
) -> None:
    """Declare ``--set KEY=VALUE``; `example` is shown in its help."""
    parser.add_argument(
        "--set",
        dest="overrides",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help=f"override a configuration value, such as {example}; may be repeated",
    )
