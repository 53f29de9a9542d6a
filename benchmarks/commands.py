"""Compare the CPU times of commands in two workspaces, such as worktrees of two commits.

Both workspaces run each command at the same time, so that the load of the machine affects both
equally. The CPU time is that of a control group (Linux, as root), because some processes of a run
have ended before any process could wait for them. Each workspace must have run the commands before.
Run with ``./omni exec python benchmarks/commands.py ../before .``.
"""

import argparse
import os
import statistics
import subprocess
import tempfile
from pathlib import Path

import output

_BAG = "bags/small_stop/assisted"
_COMMANDS = {
    "list": ["list"],
    "doctor": ["doctor"],
    "bag_check": ["bag", "check", _BAG],
    "report": ["report", _BAG, "--out", "results/report.html"],
    "run": ["run"],
}
_LONG = {"tests": ["test"], "fast_tests": ["test", "-m", "fast"]}
_GROUPS = Path("/sys/fs/cgroup")
_OF_LAUNCHER = ("OMNI_RUNNING", "OMNI_WORKSPACE", "PYTHONPATH", "LD_LIBRARY_PATH")


class Group:
    """Control group with one command; its CPU time includes that of all started processes."""

    def __init__(self, workspace: Path, words: list[str]) -> None:
        first_version = _GROUPS / "cpuacct"
        parent = first_version if first_version.is_dir() else _GROUPS
        self.folder = Path(tempfile.mkdtemp(dir=parent))
        # The shell joins the group before it becomes the command.
        script = 'echo $$ > "$0/cgroup.procs"; exec ./omni "$@"'
        self._process = subprocess.Popen(
            ["sh", "-c", script, str(self.folder), *words],
            cwd=workspace,
            env={name: text for name, text in os.environ.items() if name not in _OF_LAUNCHER},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def cpu_time(self) -> float:
        """Wait for the end of the command, and return the CPU time of the group [s]."""
        code = self._process.wait()
        if (file := self.folder / "cpuacct.usage").exists():
            used = int(file.read_text()) * 1e-9
        else:
            rows = (row.split() for row in (self.folder / "cpu.stat").read_text().splitlines())
            used = int(dict(rows)["usage_usec"]) * 1e-6
        if not (self.folder / "cgroup.procs").read_text():
            self.folder.rmdir()
        if code:
            raise SystemExit(f"{self._process.args!r} failed with exit code {code}")
        return used


def main() -> None:
    """Measure both workspaces, and print the median CPU times and their ratio."""
    commands = _COMMANDS | _LONG
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("workspaces", nargs=2, type=Path, help="the earlier and the later one")
    parser.add_argument("--commands", nargs="*", choices=commands, default=[*_COMMANDS])
    parser.add_argument("--repeats", type=int, default=5, help="default: 5")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args()
    metrics: output.Metrics = {}
    for name in options.commands:
        pairs = []
        for _ in range(options.repeats):
            groups = [Group(folder, commands[name]) for folder in options.workspaces]
            pairs.append([group.cpu_time() for group in groups])
        for side, times in zip(("before", "after"), zip(*pairs, strict=True), strict=True):
            metrics[f"cpu_time.{name}.{side}"] = (statistics.median(times), "s")
        ratios = [after / before for before, after in pairs]
        metrics[f"ratio.{name}"] = (statistics.median(ratios), "1")
    output.publish("commands", metrics, as_json=options.json)


if __name__ == "__main__":
    main()
