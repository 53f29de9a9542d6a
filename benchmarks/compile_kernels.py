"""Measure the CPU time of compiling every kernel, starting with an empty cache, by module.

The kernels that a kernel calls are compiled before it, so their compilation does not count as its
time. If LLVM inlines their code, however, the optimization of the inlined code counts. Run with
``./omni exec python benchmarks/compile_kernels.py --json``.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from typing import Any

import output

_COLD = "OMNI_COLD_CACHE"  # set in the process with an empty cache


def compile_all() -> Counter[tuple[str, str]]:
    """Compile every kernel; return the CPU time of each [s], keyed by module and function name."""
    from numba.core import event

    from omni_bringup import warm_up

    seconds: Counter[tuple[str, str]] = Counter()
    callees = [0.0]  # CPU time of nested compilations, for each running compilation

    class Stopwatch(event.Listener):
        """Sums the CPU time of each kernel's compilation, without nested compilations."""

        def on_start(self, event: Any) -> None:
            callees.append(0.0)
            event.data["dispatcher"]._began = time.process_time()

        def on_end(self, event: Any) -> None:
            dispatcher = event.data["dispatcher"]
            took = time.process_time() - dispatcher._began
            kernel = dispatcher.py_func
            seconds[kernel.__module__, kernel.__qualname__] += took - callees.pop()
            callees[-1] += took

    with event.install_listener("numba:compile", Stopwatch()):
        configuration = warm_up.standard_run()
        warm_up.compile_for_run(configuration)
        warm_up.compile_others(configuration)
    return seconds


def main() -> None:
    """Compile all kernels in a process with an empty cache and print the times."""
    options = output.options(__doc__, kernels=False)  # --kernels lists kernels, not modules
    if _COLD not in os.environ:
        with tempfile.TemporaryDirectory() as cache:
            environment = {**os.environ, "NUMBA_CACHE_DIR": cache, _COLD: "1"}
            command = [sys.executable, *sys.argv]
            sys.exit(subprocess.run(command, env=environment, check=False).returncode)
    times: Counter[str] = Counter()
    for (module, kernel), seconds in compile_all().items():
        times["cpu_time." + (f"{module}.{kernel}" if options.kernels else module)] += seconds
    metrics: output.Metrics = {name: (seconds, "s") for name, seconds in times.most_common()}
    metrics["cpu_time.all"] = times.total(), "s"
    output.publish("compile_kernels", metrics, as_json=options.json)


if __name__ == "__main__":
    main()
