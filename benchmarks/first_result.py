"""Compare two commits: time, CPU time and disk space from a clone to the first result.

Each commit is cloned into a new folder, and ``./omni run`` is started there with empty caches, so
that all packages are downloaded. The CPU time also contains the compilation in the background.
Run with ``./omni exec python benchmarks/first_result.py a41be7f2 HEAD``.
"""

import argparse
import ctypes
import os
import resource
import subprocess
import tempfile
import time
from pathlib import Path

import output

_WORKSPACE = Path(__file__).resolve().parents[1]
_PR_SET_CHILD_SUBREAPER = 36  # <linux/prctl.h>
_READY = "omni: ready after"  # the line with which set-up ends
_MEGABYTE = 1e6  # [B]


def cpu_time() -> float:
    """Return the CPU time of all ended processes that this process has started [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def disk_space(folder: Path) -> float:
    """Return the size of the files of a folder [B]; a file with several links counts once."""
    files = {path.lstat().st_ino: path.lstat().st_size for path in folder.rglob("*")}
    return float(sum(files.values()))


def first_result(commit: str, place: Path) -> output.Metrics:
    """Clone a commit into an empty folder, run it, and return times and sizes."""
    clone, caches = place / "clone", place / "caches"
    begun, spent = time.monotonic(), cpu_time()
    subprocess.run(["git", "clone", "-q", str(_WORKSPACE), str(clone)], check=True)
    subprocess.run(["git", "-C", str(clone), "checkout", "-q", commit], check=True)
    environment = {**os.environ, "XDG_CACHE_HOME": str(caches), "OMNI_ROS": "wheels"}
    for name in ("OMNI_RUNNING", "PYTHONPATH", "LD_LIBRARY_PATH", "NUMBA_CACHE_DIR"):
        environment.pop(name, None)
    seen: list[float] = []
    line = ""
    setup = float("nan")
    with subprocess.Popen(
        ["python3", str(clone / "omni"), "run"],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as run:
        for line in run.stderr or ():
            seen.append(time.monotonic() - begun)
            if line.startswith(_READY):
                setup = seen[-1]
    if run.returncode:
        raise SystemExit(f"./omni run of {commit} failed: {line.rstrip()}")
    result = time.monotonic() - begun
    while True:  # the compilation in the background
        try:
            os.wait()
        except ChildProcessError:
            break
    pauses = [later - earlier for earlier, later in zip([0.0, *seen], [*seen, result], strict=True)]
    return {
        "setup": (setup, "s"),
        "first_result": (result, "s"),
        "cpu_time": (cpu_time() - spent, "s"),
        "first_line": (pauses[0], "s"),
        "longest_silence": (max(pauses), "s"),
        "environment": (disk_space(clone / ".venv") / _MEGABYTE, "MB"),
    }


def main() -> None:
    """Measure both commits, and print their values and ratios."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("commits", nargs=2, help="the earlier and the later commit")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args()
    # Processes that a finished launcher leaves behind become children of this one.
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1)
    metrics: output.Metrics = {}
    sides = []
    for side, commit in zip(("before", "after"), options.commits, strict=True):
        with tempfile.TemporaryDirectory() as place:
            sides.append(first_result(commit, Path(place)))
        metrics |= {f"{name}.{side}": entry for name, entry in sides[-1].items()}
    for name, (value, _) in sides[1].items():
        metrics[f"{name}.ratio"] = (value / sides[0][name][0], "1")
    output.publish("first_result", metrics, as_json=options.json)


if __name__ == "__main__":
    main()
