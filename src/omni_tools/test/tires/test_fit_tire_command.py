"""``./omni fit-tire``: written files, output, rejected data, and imports needed for help."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from omni_bringup.cli import main
from omni_runs.experiment import ExperimentLibrary
from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.tire.tire import Tire

CONFIG = Path(__file__).parents[4] / "config"


def measured(path: Path, scale: float = 1.0) -> Path:
    """Write noisy forces of the tire of Table 1, with loads and forces times `scale`."""
    random = np.random.default_rng(7)
    slip = random.uniform(-0.8, 0.8, 300)
    load = random.choice([2000.0, 3500.0, 5000.0], 300)
    force = Tire(TireConfiguration()).force(slip, load) + random.normal(0.0, 30.0, 300)
    load, force = scale * load, scale * force
    rows = (f"{s:.6f},{fz:g},{f:.3f}" for s, fz, f in zip(slip, load, force, strict=True))
    path.write_text("slip,load,force\n" + "\n".join(rows) + "\n")
    return path


@pytest.fixture
def measurements(tmp_path: Path) -> Path:
    return measured(tmp_path / "rig.csv")


def omni(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["fit-tire", *map(str, arguments)])
    assert isinstance(ended.value.code, int)
    return ended.value.code


@pytest.mark.parametrize("model", ["linear", "magic_formula", "tmeasy"])
def test_fitted_tire_is_one_that_a_vehicle_can_use(
    model: str, measurements: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert omni(measurements, "--model", model, "--out", out) == 0
    printed = capsys.readouterr().out
    assert "standard error" in printed
    # The loads to which the parameters belong are stated, and no error has an exponent.
    assert "load 5000 N" in printed or "load 2 5000 N" in printed
    assert "e+" not in printed
    assert (out / "rig.png").read_bytes().startswith(b"\x89PNG")
    overrides = [f"vehicle.tire={out / 'rig.yaml'}"]
    tire = ExperimentLibrary(CONFIG).load("straight_line", "assisted", overrides).vehicle.tire
    assert tire.model == model
    assert tire.largest_load == 5000.0
    assert float(Tire(tire).force(0.6, 3500.0)) == pytest.approx(
        float(Tire(TireConfiguration()).force(0.6, 3500.0)), rel=0.1
    )


@pytest.mark.parametrize("scale", [0.003, 1.0, 10.0])
def test_the_printed_commands_work_with_a_tire_for_any_load(
    scale: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = measured(tmp_path / "my tire.csv", scale)
    assert omni(data, "--wheel-radius", 0.05 if scale < 1.0 else 0.2, "--out", tmp_path) == 0
    *_, draw, use = capsys.readouterr().out.splitlines()
    program, *command = shlex.split(draw.removeprefix("draw it: "))
    assert program == "./omni"
    with pytest.raises(SystemExit) as ended:
        main([*command, "--out", str(tmp_path / "tire.png")])
    assert ended.value.code == 0
    vehicle = yaml.safe_load((CONFIG / "vehicles" / "mecanum_forklift.yaml").read_text())
    vehicle["body"]["mass"] *= scale
    line = use.removeprefix("use it: write ").removesuffix(" in the file of a vehicle")
    path = tmp_path / "vehicle.yaml"
    path.write_text(
        yaml.safe_dump(vehicle | {"load": {"mass": 0.0, "height": 0.0}} | yaml.safe_load(line))
    )
    assert ExperimentLibrary(CONFIG).vehicle(str(path)).tire.largest_load == 5000.0 * scale


def test_json_is_one_document_with_values_units_and_errors(
    measurements: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert omni(measurements, "--json", "--out", tmp_path / "out") == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((tmp_path / "out" / "summary.json").read_text())
    entry = document["metrics"]["x_peak_force_1.tmeasy"]
    expected = Tire(TireConfiguration()).curve(2500.0).peak_force  # half of the largest load
    assert entry["unit"] == "N"
    assert abs(entry["value"] - expected) < 4.0 * entry["standard_error"]


def test_what_cannot_be_fitted_is_refused_and_nothing_is_written(
    measurements: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    broken = tmp_path / "broken.csv"
    broken.write_text(measurements.read_text() + "0.1,nan,200\n")
    lost = tmp_path / "lost.csv"
    lost.write_text(measurements.read_text().replace("load", "weight", 1))
    for path, model, reason in (
        (broken, "tmeasy", "line 302: the load 'nan' is not finite"),
        (lost, "tmeasy", "no column 'load'"),
        (measurements, "brush", "'brush' is not one of linear, magic_formula, tmeasy"),
        (tmp_path / "none.csv", "tmeasy", "cannot read"),
    ):
        assert omni(path, "--model", model, "--json", "--out", out) == 2
        captured = capsys.readouterr()
        assert reason in captured.err
        assert reason in json.loads(captured.out)["error"]
    assert not out.exists()


def test_a_folder_that_cannot_be_written_is_a_failure(
    measurements: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert omni(measurements, "--model", "linear", "--out", measurements) == 1
    assert "cannot access" in capsys.readouterr().err


def test_help_loads_nothing_heavy() -> None:
    program = """
import sys
from omni_bringup.cli import main
try:
    main(["run", "--help"])
except SystemExit:
    pass
print([name for name in ("scipy", "numba", "matplotlib", "rclpy") if name in sys.modules])
"""
    answer = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert answer.stdout.splitlines()[-1] == "[]"
