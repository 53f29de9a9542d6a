"""Results of a run over the ROS graph: each stop has the metrics of a recording with only it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import WITHOUT_CAMERAS, ExperimentConfiguration, ExperimentLibrary
from omni_runs.graph import run_variant
from omni_runs.metrics import run_metrics
from omni_runs.run import command
from omni_runs.stops import stops_of

CONFIG = Path(__file__).resolve().parents[4] / "config"
REPORT = {"time": 8.0, "wall": 4.0, "limits": {"tipping": (0.1, "it tips")}}
ONE_STOP = {
    "time": [0.0, 1.0, 1.01, 3.0], "forward": [3.0, 3.0, 0.0, 0.0], "pedal": [0.0, 0.0, 1.0, 1.0],
}  # fmt: skip
TWO_STOPS = {
    "time": [0.0, 1.0, 1.01, 3.0, 3.01, 4.5, 4.51, 6.5],
    "forward": [3.0, 3.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0],
    "pedal": [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0],
}


def load(demands: dict[str, list[float]]) -> ExperimentConfiguration:
    still = [0.0] * len(demands["time"])
    given = json.dumps({**demands, "left": still, "turn": still})
    overrides = [*WITHOUT_CAMERAS, f"maneuver.demands={given}"]
    return ExperimentLibrary(CONFIG).load("small_stop", "assisted", overrides)


@pytest.mark.parametrize(("demands", "stops"), [(ONE_STOP, 1), (TWO_STOPS, 2)])
def test_each_stop_of_a_run_has_its_own_metrics_and_panels(
    demands: dict[str, list[float]], stops: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    configuration = load(demands)
    history = run_fast_loop(configuration)
    monkeypatch.setattr(run_variant, "read_run", lambda _: history)
    result = run_variant.measured(REPORT, "assisted", tmp_path, configuration)
    report = command._report("small_stop", {"assisted": configuration}, [result], tmp_path)
    metrics = {name: entry["value"] for name, entry in report.metrics.items()}
    names = ["assisted"] if stops == 1 else [f"assisted/stop_{n}" for n in range(1, stops + 1)]
    for name, stop in zip(names, stops_of(history), strict=True):
        for quantity in ("stopping_distance", "stopping_time", "orientation_change"):
            assert metrics[f"{quantity}.{name}"] == run_metrics(stop)[quantity].value
        # A deceleration v / t over a distance of v t / 2: the stops are not joined.
        distance, time = metrics[f"stopping_distance.{name}"], metrics[f"stopping_time.{name}"]
        start = stop.brake_start
        assert start is not None
        assert distance == pytest.approx(0.5 * stop.twist[start, 0] * time, rel=0.2)
        assert 0.0 < metrics[f"limit_share.{name}"] <= 1.0
    assert metrics["real_time_factor.assisted"] == 2.0
    assert metrics["tipping_time.assisted"] == 0.1
    assert ("stopping_distance.assisted" in metrics) == (stops == 1)
    assert metrics.get("stops.assisted", 1) == stops
    assert sorted(path.name for path in tmp_path.iterdir()) == ["time_series.png", "top_view.png"]
