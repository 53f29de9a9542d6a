"""Processes that launch files start and end as `omni run` and `omni drive` do."""

import dataclasses
import json
import shlex
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

from omni_bringup.graph import nodes as graph
from omni_bringup.graph import process_group, run_folder, run_variant
from omni_loop.experiment import ExperimentConfiguration, ExperimentLibrary, short_name
from omni_loop.metrics import results_document
from omni_platform.configuration import ConfigurationError

# Launch arguments: default and description.
ARGUMENTS = {
    "config": ("", "Folder of the configuration; if empty, that of this package"),
    "experiment": ("straight_line", "A file of config/experiments/"),
    "variant": ("", "Variant of the experiment; if empty, its last one"),
    "overrides": ("", "KEY=VALUE texts, as for --set of omni run"),
    "namespace": ("", "Namespace of the vehicle, such as robot1"),
    "out": ("", "Folder of the recording; must not exist"),
}
LOCKSTEP, REAL_TIME, DRIVE = "lockstep", "real_time", "drive"


@dataclasses.dataclass(frozen=True)
class LaunchPlan:
    """Processes that a launch file starts, and the data of the run.

    Attributes:
        nodes: processes in the order of their start; subscribers start before their publishers.
        scratch: folder of the nodes' parameter files and reports, to be removed at the end.
        experiment: name of the experiment.
        variant: name of the variant.
        configuration: configuration of the whole loop.
        folder: folder of the recording; None for no recording.
        is_run: whether the simulation ends by itself and has results.
    """

    nodes: Sequence[process_group.NodeProcess]
    scratch: Path
    experiment: str
    variant: str
    configuration: ExperimentConfiguration
    folder: Path | None
    is_run: bool

    def reports(self, name: str) -> Path:
        """Return the path of the file to which a node writes its reports (`environment.report`)."""
        return self.scratch / f"{name}.reports"

    def finish(self) -> run_variant.VariantResult:
        """Write configuration, versions and results next to a finished recording.

        Raises:
            ProcessError: the run ended early.
            RunError: data were lost.
        """
        if self.folder is None:
            raise ConfigurationError("out", "is required: the folder of the recording")
        if self.folder.is_dir():  # also after an interruption
            run_folder.write_configuration(self.configuration, self.folder)
        report = self._last_report("simulator")
        run_variant.check_report(report)
        process_group.check_counts([self._last_report("recorder")], report["sent"])
        result = run_variant.measured(report, self.variant, self.folder, self.configuration)
        metrics = {self.variant: result.metrics}
        run_folder.write_summary(results_document(self.experiment, metrics), self.folder)
        return result

    def _last_report(self, name: str) -> dict[str, Any]:
        path = self.reports(name)
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        if not lines:
            raise process_group.ProcessError(f"{name} was stopped before it began")
        document: dict[str, Any] = json.loads(lines[-1])
        return document


def launch_plan(mode: str, given: Mapping[str, str]) -> LaunchPlan:
    """Return the processes that a launch file with this mode starts.

    Args:
        mode: `LOCKSTEP`, `REAL_TIME` or `DRIVE`.
        given: values of the launch arguments, keyed by name.

    Raises:
        ConfigurationError: an argument or a value of the configuration is invalid.
    """
    library = ExperimentLibrary(Path(given["config"]) if given["config"] else installed_config())
    experiment = given["experiment"]
    variant = given["variant"] or library.variants(experiment)[-1]
    configuration = library.load(experiment, variant, shlex.split(given["overrides"]))
    folder = Path(given["out"]).resolve() if given["out"] else None
    if folder is not None:
        run_folder.unused(folder, "out")
    elif mode != DRIVE:
        raise ConfigurationError("out", "is required: the folder of the recording")
    scratch = Path(tempfile.mkdtemp(prefix="omni-"))
    made = graph.Nodes(configuration, scratch, mode == LOCKSTEP)
    nodes = made.of_drive({}, folder) if mode == DRIVE or folder is None else made.of_run(folder)
    if given["namespace"]:
        words = ("-r", f"__ns:=/{given['namespace'].strip('/')}")
        nodes = [dataclasses.replace(node, arguments=(*node.arguments, *words)) for node in nodes]
    name = short_name(experiment)
    return LaunchPlan(nodes, scratch, name, variant, configuration, folder, mode != DRIVE)


def installed_config() -> Path:
    """Return the configuration folder that is installed with this package.

    Raises:
        ConfigurationError: this package is not installed.
    """
    try:
        return Path(get_package_share_directory("omni_bringup")) / "config"
    except PackageNotFoundError:
        raise ConfigurationError(
            "config", "is required, because omni_bringup is not installed"
        ) from None
