"""Replays of the sample recording with the instructions of other processors.

Every setting runs in a process of its own and compiles odometry and assistant into a folder of its
own. The results must agree with the recording within the tolerances of their signals.
"""

import hashlib
import json
import os
import pickle
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import llvmlite.binding
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

SAMPLE = "bags/small_stop/assisted"
KERNELS = Path(".cache/replays").resolve()
MARGIN = "replay_margin."
HASWELL = (
    *("64bit", "cmov", "cx8", "cx16", "fxsr", "mmx", "sse", "sse2", "sse3", "ssse3", "sse4.1"),
    *("sse4.2", "popcnt", "avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"),
)
DISPATCH = "NPY_DISABLE_CPU_FEATURES"
SETTINGS = {
    "host": {},
    "numpy_baseline": {DISPATCH: " ".join(__cpu_dispatch__)},
    "generic": {"NUMBA_CPU_NAME": "generic"},
    # With the name alone, numba would use the instructions of the processor at hand.
    "haswell": {
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": ",".join(f"+{name}" for name in HASWELL),
    },
}


def replay(folder: Path) -> None:
    """Replay the sample in this process, and store a digest of the compiled code."""
    from linescan_odometry.joint.estimator import _estimate
    from omni_bringup import cli
    from omni_core.compilation.cache import KernelCache

    if DISPATCH in os.environ:
        assert not any(__cpu_features__[name] for name in __cpu_dispatch__)
    nodes = ["--nodes", "linescan_odometry", "brake_assist"]
    try:
        cli.main(["replay", SAMPLE, *nodes, "--check", "--json", "--out", str(folder)])
    finally:
        (signature,) = _estimate.overloads
        stored = pickle.loads(KernelCache(_estimate).file(signature).read_bytes())
        _, _, ((_, _, (code, _)), *_) = stored
        sections = llvmlite.binding.ObjectFileRef.from_data(code).sections()
        instructions = b"".join(section.data() for section in sections if section.is_text())
        (folder / "code").write_text(hashlib.sha256(instructions).hexdigest())


def compiles(name: str) -> bool:
    """Return whether a setting changes the instructions for which numba compiles."""
    return any(variable.startswith("NUMBA_") for variable in SETTINGS[name])


def unsuitable(name: str) -> str:
    """Return the reason why a setting cannot be used on this processor; empty if it can."""
    if name == "haswell":
        present = llvmlite.binding.get_host_cpu_features()
        missing = [feature for feature in HASWELL if not present.get(feature)]
        if missing:
            return f"the processor lacks {', '.join(missing)}"
        if llvmlite.binding.get_host_cpu_name() == name:
            return "it is the processor at hand"
    if name == "numpy_baseline" and not any(__cpu_features__[one] for one in __cpu_dispatch__):
        return "NumPy uses no further instructions of the processor"
    return ""


def replayed(name: str, folder: Path) -> tuple[bool, str]:
    """Replay with a setting, and print the share of each tolerance that is used.

    Returns:
        Whether the results agree with the recording; digest of the compiled code.
    """
    environment = {**os.environ, **SETTINGS[name]}
    if compiles(name):
        environment["NUMBA_CACHE_DIR"] = str(KERNELS / name)
    command = [sys.executable, __file__, str(folder)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    used = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
    if done.returncode != 0:
        print(done.stdout, done.stderr, file=sys.stderr)
        return False, ""
    margins = {
        metric.removeprefix(MARGIN): entry["value"]
        for metric, entry in json.loads(done.stdout)["metrics"].items()
        if metric.startswith(MARGIN)
    }
    shares = ", ".join(f"{topic} {margin:.2g}" for topic, margin in margins.items())
    print(f"{name}: shares of the tolerances: {shares}; CPU time {used:.0f} s")
    return len(margins) == 3, (folder / "code").read_text()


def main() -> int:
    """Replay with every setting that this processor can use; return 1 if a result is wrong."""
    failed, codes = False, {}
    for name in SETTINGS:
        if reason := unsuitable(name):
            print(f"{name}: skipped, because {reason}")
            continue
        with tempfile.TemporaryDirectory() as scratch:
            agrees, codes[name] = replayed(name, Path(scratch))
        if not agrees:
            print(f"{name}: the results are not those of the recording", file=sys.stderr)
            failed = True
        elif compiles(name) and codes[name] == codes["host"]:
            print(f"{name}: the compiled code is that of the host", file=sys.stderr)
            failed = True
    return int(failed)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        replay(Path(sys.argv[1]))
    else:
        sys.exit(main())
