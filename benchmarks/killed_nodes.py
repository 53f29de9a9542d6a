"""Disturb runs: kill, terminate or halt a node, or halt and resume it.

``./omni exec python benchmarks/killed_nodes.py`` disturbs every node at 20 random moments, in
lockstep and in real time. No such run may end with exit code 0, and no stop may be much longer, or
rotate the vehicle much more, than the worst of the undisturbed and unassisted stops. The program
prints the runs that violate this rule; if there are any, its exit code is 1.
"""

import argparse
import dataclasses
import itertools
import math
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path

from omni_recording.error import BagError
from omni_runs.metrics import run_metrics
from omni_runs.recorded_run import read_run

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
from omni_process import disturbed, omni_here, processes_of, recorded_bytes

EXPERIMENT = "small_stop"
NODES = {
    "simulator": "omni_sim",
    "linescan_odometry": "linescan_odometry",
    "brake_assist": "omni_brake_assist",
    "recorder": "omni_recording",
}
ACTIONS = ("kill", "halt", "resume", "terminate")
PAUSE = 0.3  # [s] from halt to resume
MARGIN = 1.05  # allowed ratio to the unassisted stop


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Result of a disturbed run.

    Attributes:
        returncode: exit code of the command.
        complaint: error output of the command.
        distance: distance from the pedal to rest [m]; NaN if the recording ends before rest.
        rotation: rotation of the vehicle from the pedal to rest [deg]; NaN if the recording ends
            before rest.
    """

    returncode: int
    complaint: str
    distance: float
    rotation: float


def trial(
    folder: Path, node: str, action: str, share: float, *, real_time: bool, size: float = 15e6
) -> Outcome | None:
    """Run an experiment, disturb a node during the run, and return the outcome.

    Args:
        folder: folder of the recording; must not exist.
        node: one of `NODES`.
        action: one of `ACTIONS`.
        share: progress of the run at which the node is disturbed, as a share of `size`, 0 to 1.
        real_time: whether the run is in real time instead of lockstep.
        size: approximate size of the recording of a whole run [B].

    Returns:
        Outcome of the run; None if the run had ended before the disturbance.
    """
    found: list[int] = []

    def act() -> None:
        found.extend(processes_of(NODES[node], os.getpid()))
        for pid in found:
            disturb(pid, action)

    words = command(folder, *(["--real-time"] if real_time else []))
    done = disturbed(words, folder, share * size, act)
    if done is None or not found:
        return None
    return Outcome(done.returncode, done.stderr.strip(), *stop_of(folder / "assisted"))


def command(folder: Path, *words: str) -> list[str]:
    """Return a command that runs `EXPERIMENT` into a folder; `words` are further options."""
    return ["run", EXPERIMENT, "--variant", "assisted", "--json", "--out", str(folder), *words]


def undisturbed(folder: Path, *words: str) -> tuple[float, float]:
    """Run `EXPERIMENT` to its end; return distance [m] and rotation [deg] of its stop."""
    if omni_here(command(folder, *words)).returncode != 0:
        raise RuntimeError(f"the undisturbed run {folder} failed")
    return stop_of(folder / "assisted")


def disturb(pid: int, action: str) -> None:
    """Apply one of `ACTIONS` to a process."""
    if action in ("kill", "terminate"):
        os.kill(pid, signal.SIGKILL if action == "kill" else signal.SIGTERM)
        return
    os.kill(pid, signal.SIGSTOP)
    if action == "resume":
        time.sleep(PAUSE)
        os.kill(pid, signal.SIGCONT)


def stop_of(bag: Path) -> tuple[float, float]:
    """Return distance [m] and rotation [deg] of a recorded stop; NaN without a complete stop."""
    try:
        history = read_run(bag)
    except BagError:
        return math.nan, math.nan
    if abs(history.twist[-1]).max() > 0.05:  # the recording ends during the run
        return math.nan, math.nan
    metrics = run_metrics(history)
    return metrics["stopping_distance"].value, metrics["orientation_change"].value


def main() -> None:
    """Disturb every node by every action at random moments, in both modes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moments", type=int, default=20, help="moments for each node and action")
    parser.add_argument("--seed", type=int, default=1, help="seed of the moments")
    words = "actions on each node at each moment"
    parser.add_argument("--actions", nargs="+", choices=ACTIONS, default=ACTIONS, help=words)
    options = parser.parse_args()
    generator = random.Random(options.seed)
    trials: list[tuple[str, Outcome]] = []
    with tempfile.TemporaryDirectory() as scratch:
        reference = Path(scratch) / "reference"
        stops = [
            undisturbed(reference),
            undisturbed(Path(scratch) / "unassisted", "--set", "brake_assist.enabled=false"),
        ]
        folder = Path(scratch) / "run"
        for _ in range(options.moments):
            # Real-time runs differ from each other, especially under changing load.
            shutil.rmtree(folder, ignore_errors=True)
            stops.append(undisturbed(folder, "--real-time"))
            for real_time, node, action in itertools.product((False, True), NODES, options.actions):
                found = None
                while found is None:  # the size of a recording varies
                    share = generator.random()
                    shutil.rmtree(folder, ignore_errors=True)
                    found = trial(
                        folder,
                        node,
                        action,
                        share,
                        real_time=real_time,
                        size=recorded_bytes(reference),
                    )
                mode = "real time" if real_time else "lockstep"
                trials.append((f"{mode}, {action} {node} at {share:.2f}", found))
                print(f"{len(trials)}: {trials[-1][0]}: exit code {found.returncode}", flush=True)
    distance, rotation = (max(values) for values in zip(*stops, strict=True))
    print(f"undisturbed and unassisted: at most {distance:.2f} m and {rotation:.1f} deg")
    bad = [
        (case, found)
        for case, found in trials
        if found.returncode == 0
        or found.distance > MARGIN * distance
        or found.rotation > MARGIN * rotation + 1.0
    ]
    for case, found in bad:
        print(f"{case}: {found}")
    print(f"{len(bad)} of {len(trials)} runs ended with exit code 0 or exceeded these limits")
    sys.exit(bool(bad))


if __name__ == "__main__":
    main()
