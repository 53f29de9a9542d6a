"""Measure the CPU time of compiling every kernel, starting with an empty cache, by module.

The kernels that a kernel calls are compiled before it, so their compilation does not count as its
time. If LLVM inlines their code, however, the optimization of the inlined code counts. Run with
``./omni exec python benchmarks/compile_kernels.py --json``. With two commits as arguments,
such as ``a41be7f2 HEAD``, it measures both with the installed packages and prints their ratio.
"""

import argparse
import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import output

_COLD = "OMNI_COLD_CACHE"  # set in the process with an empty cache
_RATIO = 0.7  # limit on the CPU time relative to that of commit a41be7f2 [1]


def compile_all() -> Counter[tuple[str, str]]:
    """Compile every kernel; return the CPU time of each [s], keyed by module and function name."""
    from omni_bringup import warm_up
    from omni_core.compilation.cache import KernelCache

    seconds: Counter[tuple[str, str]] = Counter()
    running: list[list[Any]] = [[0.0, 0.0]]  # begin of each compilation, time of nested ones
    load, save = KernelCache.load_overload, KernelCache.save_overload

    def begin(cache: KernelCache, *arguments: Any) -> Any:
        found = load(cache, *arguments)
        if found is None:
            running.append([time.process_time(), 0.0])
        return found

    def end(cache: KernelCache, *arguments: Any) -> None:
        save(cache, *arguments)
        began, nested = running.pop()
        took = time.process_time() - began
        kernel = cache.dispatcher.py_func
        seconds[kernel.__module__, kernel.__qualname__] += took - nested
        running[-1][1] += took

    watched: Any = KernelCache
    watched.load_overload, watched.save_overload = begin, end
    configuration = warm_up.standard_run()
    warm_up.compile_for_run(configuration)
    warm_up.compile_others(configuration)
    return seconds


def in_empty_cache(*, by_kernel: bool) -> output.Metrics:
    """Return the times of this process, whose cache must be empty."""
    times: Counter[str] = Counter()
    for (module, kernel), seconds in compile_all().items():
        times["cpu_time." + (f"{module}.{kernel}" if by_kernel else module)] += seconds
    metrics: output.Metrics = {name: (seconds, "s") for name, seconds in times.most_common()}
    metrics["cpu_time.all"] = times.total(), "s"
    return metrics


def of_commit(commit: str) -> float:
    """Return the CPU time of compiling all kernels of a commit with the installed packages [s]."""
    workspace = Path(__file__).resolve().parents[1]
    command = ["git", "-C", str(workspace), "archive", commit]
    archive = subprocess.run(command, check=True, capture_output=True).stdout
    with tempfile.TemporaryDirectory() as folder, tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        tar.extractall(folder, filter="data")
        path = os.pathsep.join([*map(str, Path(folder, "src").iterdir()), os.environ["PYTHONPATH"]])
        done = subprocess.run(
            [sys.executable, f"{folder}/benchmarks/{Path(__file__).name}", "--json"],
            env={**os.environ, "PYTHONPATH": path, "OMNI_WORKSPACE": folder},
            check=True,
            stdout=subprocess.PIPE,
        )
    value: float = json.loads(done.stdout)["metrics"]["cpu_time.all"]["value"]
    return value


def main() -> None:
    """Compile all kernels in a process with an empty cache and print the times."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("commits", nargs="*", help="the earlier and the later commit")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--kernels", action="store_true", help="list kernels, not modules")
    options = parser.parse_args()
    if options.commits:
        before, after = map(of_commit, options.commits)
        metrics: output.Metrics = {
            "cpu_time.before": (before, "s"),
            "cpu_time.all": (after, "s"),
            "cpu_time.ratio": (after / before, "1", _RATIO),
        }
    elif _COLD in os.environ:
        metrics = in_empty_cache(by_kernel=options.kernels)
    else:
        with tempfile.TemporaryDirectory() as cache:
            environment = {**os.environ, "NUMBA_CACHE_DIR": cache, _COLD: "1"}
            command = [sys.executable, *sys.argv]
            sys.exit(subprocess.run(command, env=environment, check=False).returncode)
    output.publish("compile_kernels", metrics, as_json=options.json)


if __name__ == "__main__":
    main()
