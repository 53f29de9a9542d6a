"""``./omni lines show``: what the line cameras saw in a recording.

Draw the lines of a recording over time, beside the displacements and correlations of consecutive
lines and what the odometry makes of them.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omni_bringup.exit_codes import EXIT_FAILED, EXIT_OK, EXIT_REFUSED
from omni_platform.command_options import json_option, option, overrides_option
from omni_platform.configuration import Configuration, ConfigurationError, did_you_mean, parameter

WORK = "matching lines"


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Options of ``omni lines show``."""

    bag: Path = option(
        positional=True, metavar="BAG", description="rosbag2 folder, of a run or an import"
    )
    sensor: tuple[str, ...] = option((), metavar="NAME", description="camera to show; all without")
    start: float = parameter(
        0.0, minimum=0.0, unit="s", description="since the first line of the recording"
    )
    duration: float = parameter(0.2, above=0.0, maximum=60.0, unit="s", description="that is shown")
    overrides: tuple[str, ...] = overrides_option("odometry.median_lines=5")
    out: Path | None = option(
        None, metavar="FILE", description="figure, .png or .svg (default: results/lines/BAG.png)"
    )
    json: bool = json_option()


def run(options: Options, workspace: Path) -> int:
    """Draw what was seen and return the exit code."""
    from omni_analysis.figures.style import save_figure
    from omni_analysis.line_files.kymograph import draw_sights, see
    from omni_analysis.loop.experiment import ExperimentLibrary
    from omni_bringup.replay.lines import read_batches
    from omni_bringup.replay.plan import lines_topic, replay_configuration
    from omni_recording.error import BagError
    from omni_recording.folder import bag_summary, open_vehicle

    library = ExperimentLibrary(workspace / "config")
    target = options.out or workspace / "results" / "lines" / f"{options.bag.resolve().name}.png"
    if target.suffix not in {".png", ".svg"}:
        raise ConfigurationError("--out", f"{target.name} is neither .png nor .svg")
    try:
        bag = open_vehicle(options.bag)
        odometry = replay_configuration(bag, library, None, options.overrides).odometry
        for name in options.sensor:
            if name not in odometry.sensors:
                known = ", ".join(odometry.sensors)
                hint = did_you_mean(name, odometry.sensors)
                raise ConfigurationError("--sensor", f"{name!r} is none of {known}{hint}")
        counts = bag_summary(bag).counts
        names = options.sensor or [n for n in odometry.sensors if counts.get(lines_topic(n))]
        if not names:
            raise BagError(bag.path, "holds no lines of a camera of its configuration")
        batches = read_batches(bag, names, options.start, options.duration)
    except BagError as error:
        print(f"omni lines show: {error}", file=sys.stderr)
        return EXIT_REFUSED
    sights = {name: see(odometry.sensors[name], own, odometry) for name, own in batches.items()}
    try:
        picture = save_figure(draw_sights(sights, f"Lines of {options.bag.resolve().name}"), target)
    except OSError as error:
        print(f"omni lines show: cannot write {target}: {error.strerror}", file=sys.stderr)
        return EXIT_FAILED
    values = {}
    for name, sight in sights.items():
        matched = np.isfinite(sight.displacement)
        velocity = [reading.velocity for reading in sight.readings if reading.measured]
        values[name] = {
            "displacement": (float(np.median(sight.displacement[matched])), "px")
            if matched.any()
            else None,
            "correlation": (float(np.mean(sight.correlation)), "1"),
            "matched_share": (float(np.mean(matched)), "1"),
            "measured_share": (sight.measured, "1"),
            "velocity": (float(np.median(velocity)), "m/s") if velocity else None,
        }
    if options.json:
        metrics = {
            f"{quantity}.{name}": {"value": entry[0], "unit": entry[1]}
            for name, own in values.items()
            for quantity, entry in own.items()
            if entry is not None
        }
        document = {"name": "lines_show", "metrics": metrics, "figure": str(picture)}
        print(json.dumps(document, indent=2, allow_nan=False))
        return EXIT_OK
    for name, own in values.items():
        words = [f"{q.replace('_', ' ')} {e[0]:.4g} {e[1]}" for q, e in own.items() if e]
        print(f"{name}: {', '.join(words)}")
        reasons = {r.reason for r in sights[name].readings if not r.measured}
        for reason in sorted(reasons)[:3]:
            print(f"    not measured: {reason}")
    print(f"wrote {picture}")
    return EXIT_OK
