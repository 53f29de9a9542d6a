"""``./omni replay``: run nodes on recorded inputs.

Run the code of the nodes on the recorded inputs in one process without topics, record the outputs,
and compare them with the recorded outputs.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_core.commands.command_options import CommandOptions, option, overrides_option
from omni_core.commands.command_report import Report, entries
from omni_core.configuration import ConfigurationError, WorkError
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_recording.actions.compare import TopicComparison

WORK = "replaying the recorded inputs"
_NO_RATE = (
    "a replay runs without topics, as fast as possible; "
    "`ros2 bag play --rate {:g} BAG` publishes the recording to running nodes"
)
_OTHER_VERSION = "the recording was made by another version or processor: {}"


class Options(CommandOptions):
    """Options of ``omni replay``."""

    bag: Path = option(positional=True, metavar="BAG")
    """rosbag2 folder, or a single .mcap file"""
    nodes: tuple[str, ...] = option(("linescan_odometry",), many=True, metavar="NODE")
    """nodes to run: `linescan_odometry`, `brake_assist` or both"""
    overrides: tuple[str, ...] = overrides_option("odometry.median_lines=5")
    experiment: str | None = option(None)
    """use the configuration of this experiment's last variant instead of the recorded one"""
    rate: float | None = option(None, metavar="R", above=0.0, maximum=1000.0)
    """is refused; `ros2 bag play --rate R BAG` publishes a recording at this speed"""
    offline: bool = option(False)
    """has no effect: every replay runs in one process without topics"""
    check: bool = option(False)
    """exit code 1 if the results differ from the recorded outputs by more than their tolerance"""
    tolerance: float | None = option(None, minimum=0.0, maximum=1000.0)
    """limit on the difference of every value, in its SI unit (default: tolerances of the topics)"""
    out: Path | None = option(None, metavar="DIR")
    """new folder for the results (default: next to the recording, BAG_replayed_TIME)"""

    def check_consistency(self) -> None:
        """Refuse the speed of a replay over topics.

        Raises:
            ConfigurationError: a speed is given.
        """
        if self.rate is not None:
            raise ConfigurationError("--rate", _NO_RATE.format(self.rate))


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Check the recording, replay its inputs, and compare the results with its outputs."""
    from omni_recording.actions.compare import compare_topics
    from omni_recording.commands import beside
    from omni_recording.error import BagError
    from omni_recording.folder import open_vehicle
    from omni_runs.graph import run_folder
    from omni_runs.replay import plan as plans
    from omni_runs.replay.offline import replay_offline

    bag = open_vehicle(options.bag)
    if options.experiment is None:
        remedy = "name an experiment whose sensors and wheels are those of the recording"
        configuration = plans.recorded_configuration(bag, options.overrides, "--experiment", remedy)
    else:
        library = workspace.experiment_library()
        configuration = library.load(options.experiment, overrides=options.overrides)
    others = run_folder.other_versions(bag.path if bag.path.is_dir() else bag.path.parent)
    plan = plans.replay_plan(configuration, options.nodes)
    counts = plans.check_inputs(bag, plan)
    known = [topic for topic in plan.outputs if counts.get(topic)]
    if options.check and len(known) < len(plan.outputs):
        lacking = ", ".join(sorted(plan.outputs.keys() - known))
        raise BagError(bag.path, f"contains no recorded results on {lacking} to compare with")
    default = beside(options.bag, f"replayed_{run_folder.time_in_name()}")
    folder = run_folder.new_folder(options.out or default)
    try:
        replay_offline(bag, plan, folder)
        run_folder.write_configuration(configuration, folder)
        comparisons = compare_topics(bag.path, folder, known, options.tolerance).values()
    except BagError as error:  # damage to the recording that is found only during the replay
        raise WorkError(str(error)) from None
    hints = []
    if others and not all(one.identical == one.first == one.second for one in comparisons):
        hints.append(_OTHER_VERSION.format(", ".join(others)))
    return Report(
        metrics={key: entry for one in comparisons for key, entry in _entries(one).items()},
        details={"folder": str(folder)},
        text=(*(f"{one.topic}: {_in_words(one)}" for one in comparisons), f"recorded in {folder}"),
        hints=hints,
        ok=not options.check or all(one.agrees for one in comparisons),
    )


def _entries(one: TopicComparison) -> dict[str, dict[str, Any]]:
    counts = {
        "recorded": one.first,
        "replayed": one.second,
        "identical": one.identical,
        "unpaired": one.unpaired,
        "different_texts": one.different_texts,
        "outside": one.outside,
        "moved_switches": one.moved_switches,
    }
    found = entries({f"{name}.{one.topic}": (value, "1") for name, value in counts.items()})
    sizes = {"replay_margin": (one.margin, "1"), "largest_difference": (one.difference, "SI")}
    for name, (value, unit) in sizes.items():
        finite = value if math.isfinite(value) else None  # JSON has no infinite numbers
        found[f"{name}.{one.topic}"] = {"value": finite, "unit": unit}
    return found


def _in_words(one: TopicComparison) -> str:
    if one.identical == one.first == one.second:
        return f"all {one.first} messages are identical to the recorded ones"
    words = f"{one.identical} of {one.first} recorded messages are identical"
    if one.unpaired:
        words += (
            f", {one.unpaired} have no counterpart with the same stamp ({one.second} were replayed)"
        )
    if one.different_texts:
        words += f", {one.different_texts} differ in texts or names"
    if one.outside:
        words += f", {one.outside} differ by more than the tolerance"
    if one.moved_switches:
        words += f", {one.moved_switches} switches are one message earlier or later"
    if one.worst:
        words += (
            f", the largest difference is {one.difference:.3g} in {one.worst}, "
            f"{100.0 * one.margin:.2g} % of its tolerance"
        )
    return f"{words}: {'within' if one.agrees else 'not within'} the tolerance"
