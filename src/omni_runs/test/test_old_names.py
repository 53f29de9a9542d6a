"""Packages can be imported by the names that they had before, with a warning."""

import subprocess
import sys

PROGRAM = """
import warnings

with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    from omni_platform import configuration
    from omni_platform.command_options import option
    from omni_loop.experiment import ExperimentLibrary
    from omni_loop.sweep import sweep
    from omni_loop.file_kinds import possible_kinds
    from omni_figures.tables.wrapped_table import WrappedTable
    from omni_figures.sweep_figure import sweep_figure

import omni_core.configuration, omni_runs.experiment, omni_core.commands.wrapped_table

assert configuration is omni_core.configuration
assert ExperimentLibrary is omni_runs.experiment.ExperimentLibrary
assert WrappedTable is omni_core.commands.wrapped_table.WrappedTable
print(*sorted(str(one.message) for one in caught if one.category is FutureWarning), sep="\\n")
"""


def test_old_names_give_the_modules_of_the_new_ones() -> None:
    command = [sys.executable, "-c", PROGRAM]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    figures, loop, platform = done.stdout.splitlines()
    assert figures.startswith("omni_figures is now omni_runs.figures")
    assert loop.startswith("omni_loop is now omni_runs")
    assert platform.startswith("omni_platform is now omni_core")
