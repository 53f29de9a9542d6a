"""Mark the fast tests for work on the code (``./omni test -m fast``); order tests by duration.

Tests of the safety case have the mark ``safety(hazard, fault, caught_by, within=...)``, from which
``tests/safety_table.py`` generates the table of docs/safety.md. ``./omni test
--store-hazard-times`` measures the times of this table.
"""

import functools
import json
import math
import os
from collections import defaultdict
from collections.abc import Generator
from pathlib import Path

import hypothesis
import pytest

from omni_ros.start import start_lightly

start_lightly()  # before numpy and numba are imported

ROOT = Path(__file__).parent
SOURCES = ROOT / "src"
DURATIONS = ROOT / "tests" / "durations.json"
"""File with the CPU times [s] of the test files that take a second or more.

``./omni test --store-durations`` writes this file."""

HAZARD_TIMES = ROOT / "tests" / "hazard_times.json"
"""File with the measured times [s] of the safety case, keyed by fault."""

_SHARES = 30  # limits that a measurement tries, as equal parts of the limit of the safety case [1]
_STEP = 0.01  # time between two decisions of the assistant [s]

# A busy machine may take any time for an example, and the first one compiles kernels.
hypothesis.settings.register_profile(
    "any_duration", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("any_duration")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options that measure the durations of the test files, and the times of hazards."""
    words = f"measure the CPU times of the tests; write {DURATIONS.relative_to(ROOT)}"
    parser.addoption("--store-durations", action="store_true", help=words)
    words = f"measure the times of the safety case; write {HAZARD_TIMES.relative_to(ROOT)}"
    parser.addoption("--store-hazard-times", action="store_true", help=words)


def pytest_configure(config: pytest.Config) -> None:
    """Name the log folder of ROS, and measure the tests if this is requested."""
    from omni_ros.environment import name_log_folder  # which imports numpy

    name_log_folder(os.environ)  # for tests that use ROS in their own process
    if config.getoption("--store-durations"):
        config.pluginmanager.register(_Stopwatch())
    if config.getoption("--store-hazard-times"):
        config.pluginmanager.register(_HazardTimes())


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out the slow files if only fast tests run, as importing them takes long."""
    only_fast = config.getoption("markexpr") == "fast" and collection_path.is_file()
    return True if only_fast and not _is_fast(collection_path) else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of short files below `src` as fast; put the longest files first."""
    # The longest file first: if it began last, all cores but one would wait for it.
    items.sort(key=lambda item: -_durations().get(item.path, 0))
    for item in items:
        if _is_fast(item.path):
            item.add_marker(pytest.mark.fast)


def _is_fast(file: Path) -> bool:
    return SOURCES in file.parents and not _durations().get(file)


@functools.cache
def _durations() -> dict[Path, int]:
    return {ROOT / name: seconds for name, seconds in json.loads(DURATIONS.read_text()).items()}


class _Stopwatch:
    """Measures CPU time: a test takes longer by the clock while others compute beside it."""

    def __init__(self) -> None:
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._begun = 0.0

    def pytest_runtest_logstart(self) -> None:
        self._begun = _cpu_time()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        now = _cpu_time()
        report.duration, self._begun = now - self._begun, now
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._seconds[report.location[0]] += report.duration

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if hasattr(session.config, "workerinput"):
            return  # the process that receives all results writes them
        known = json.loads(DURATIONS.read_text())
        known |= {file: int(seconds) for file, seconds in self._seconds.items()}
        slow = {f: s for f, s in sorted(known.items()) if s and (ROOT / f).exists()}
        DURATIONS.write_text(json.dumps(slow, indent=1) + "\n")


def _cpu_time() -> float:
    """Return the CPU time [s] of this process and of its children that have ended."""
    return sum(os.times()[:4])


class _HazardTimes:
    """Repeats each test of the safety case with shorter limits, to find the shortest it meets."""

    def __init__(self) -> None:
        self._tried: defaultdict[str, set[float]] = defaultdict(set)
        self._failed: defaultdict[str, set[float]] = defaultdict(set)

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        if "within" in metafunc.fixturenames:
            metafunc.parametrize("within", range(_SHARES + 1), indirect=True)

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        functions = (item for item in items if isinstance(item, pytest.Function))
        timed = [item for item in functions if "within" in item.fixturenames]
        items[:] = timed
        for item in timed:
            if item.callspec.params["within"] != _SHARES:
                item.add_marker(pytest.mark.xfail)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        for fault, limit in report.user_properties if report.when == "call" else ():
            self._tried[fault].add(float(str(limit)))
            if not report.passed:
                self._failed[fault].add(float(str(limit)))

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if hasattr(session.config, "workerinput"):
            return
        times = {
            fault: min(limit for limit in tried if limit > max(self._failed[fault], default=-1.0))
            for fault, tried in self._tried.items()
        }
        known = json.loads(HAZARD_TIMES.read_text()) | times
        HAZARD_TIMES.write_text(json.dumps(dict(sorted(known.items())), indent=1) + "\n")


@pytest.fixture
def within(request: pytest.FixtureRequest) -> float:
    """Return the time within which the safety case requires the tested effect [s]."""
    mark = request.node.get_closest_marker("safety")
    if mark is None:
        return math.inf
    limit = float(mark.kwargs["within"])
    if hasattr(request, "param"):
        limit = round(_STEP * math.ceil(limit * request.param / _SHARES / _STEP - 1e-9), 3)
        request.node.user_properties.append((mark.args[1], limit))
    return limit
