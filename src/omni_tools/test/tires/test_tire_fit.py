"""Tire fits recover parameters and standard errors; poor data are rejected with the reason."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omni_core.configuration import WorkError, from_mapping
from omni_core.quantities import FloatArray
from omni_runs.yaml_files import read_mapping
from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.tire.tire import Tire
from omni_tools.tires.data import TireData, TireDataError, read_tire_data
from omni_tools.tires.fit import fit_figure, fit_tire

MODELS = ("linear", "magic_formula", "tmeasy")
LOADS = (1500.0, 3000.0, 4500.0, 6000.0)
CONFIG = Path(__file__).resolve().parents[4] / "config"
NOISE = 40.0  # [N]


def measure(
    tire: TireConfiguration,
    seed: int = 1,
    *,
    rows: int = 400,
    noise: float = NOISE,
    slips: tuple[float, float] = (-0.8, 0.8),
    loads: tuple[float, ...] = LOADS,
) -> TireData:
    random = np.random.default_rng(seed)
    slip, load = random.uniform(*slips, rows), random.choice(loads, rows)
    return TireData(slip, load, Tire(tire).force(slip, load) + random.normal(0.0, noise, rows))


def truth(tire: TireConfiguration, keys: tuple[str, ...]) -> FloatArray:
    values = []
    for key in keys:
        value: Any = tire.model_parameters
        for part in key.split("."):
            value = getattr(value, part)
        values.append(float(value))
    return np.array(values)


@pytest.mark.parametrize("model", MODELS)
def test_parameters_come_back_and_standard_errors_cover_them(model: str) -> None:
    tire = TireConfiguration(model=model)
    off, sizes = [], []
    for seed in range(40):
        fit = fit_tire(measure(tire, seed), model)
        assert not fit.at_bound.any()
        true = truth(tire, fit.keys)
        off.append((fit.values - true) / fit.standard_errors)
        sizes.append(fit.residual)
    share = np.mean(np.abs(off) < 1.96)  # of all parameters and draws; 0.95 in theory
    assert 0.91 < share < 0.99
    assert np.std(off) == pytest.approx(1.0, abs=0.2)
    assert np.mean(sizes) == pytest.approx(NOISE, rel=0.02)


@pytest.mark.parametrize("model", MODELS)
def test_exact_data_give_the_exact_tire(model: str) -> None:
    tire = TireConfiguration(model=model)
    fit = fit_tire(measure(tire, noise=0.0), model)
    np.testing.assert_allclose(fit.values, truth(tire, fit.keys), rtol=1e-4)
    again = from_mapping(TireConfiguration, fit.mapping)
    assert again == fit.tire
    data = measure(tire, 2, noise=0.0)
    np.testing.assert_allclose(Tire(again).force(data.slip, data.load), data.force, atol=1.0)


def test_slip_of_one_sign_and_loads_in_between_suffice() -> None:
    tire = TireConfiguration()
    random = np.random.default_rng(4)
    slip, load = random.uniform(0.0, 1.0, 500), random.uniform(2000.0, 6000.0, 500)
    force = Tire(tire).force(slip, load) + random.normal(0.0, 20.0, 500)
    fit = fit_tire(TireData(slip, load, force), "tmeasy")
    at = np.linspace(0.0, 1.0, 50)
    for heavy in (2500.0, 5500.0):
        np.testing.assert_allclose(
            Tire(fit.tire).force(at, heavy), Tire(tire).force(at, heavy), atol=40.0
        )


def test_a_curve_that_never_falls_puts_the_shape_on_its_bound() -> None:
    data = measure(TireConfiguration(), rows=800, slips=(-4.0, 4.0))
    noise = np.random.default_rng(3).normal(0.0, 20.0, 800)
    # The Magic Formula with C = 1; a tire with a peak has a larger C.
    force = 0.9 * data.load * np.sin(np.arctan(15.0 / 0.9 * data.slip)) + noise
    fit = fit_tire(TireData(data.slip, data.load, force), "magic_formula")
    assert [key for key, at in zip(fit.keys, fit.at_bound, strict=True) if at] == ["shape"]
    assert fit.standard_errors[fit.keys.index("shape")] == 0.0


@pytest.mark.parametrize(
    ("reason", "model", "changes"),
    [
        ("too few", "tmeasy", {"rows": 19}),
        ("too similar", "tmeasy", {"loads": (3000.0, 3100.0)}),
        ("too similar", "magic_formula", {"loads": (3000.0,)}),
        ("beyond the peak|do not determine", "tmeasy", {"slips": (-0.05, 0.05)}),
        ("do not determine .*slide", "tmeasy", {"slips": (-0.2, 0.2)}),
        ("beyond the peak|do not determine", "magic_formula", {"slips": (-0.04, 0.04)}),
        ("beyond the peak|do not determine", "linear", {"slips": (-0.03, 0.03)}),
        ("do not determine|beyond the peak", "tmeasy", {"slips": (0.5, 0.9)}),
        ("does not describe", "linear", {"noise": 9000.0}),
    ],
)
def test_too_little_excitation_is_refused_with_the_reason(
    reason: str, model: str, changes: dict[str, Any]
) -> None:
    before = reason.startswith("too")  # the search
    with pytest.raises(TireDataError if before else WorkError, match=reason):
        fit_tire(measure(TireConfiguration(model=model), **changes), model)


@pytest.mark.parametrize("factor", [1e300, 1e150, 1e-300])
@pytest.mark.parametrize("name", ["load", "force"])
@pytest.mark.parametrize("model", MODELS)
def test_values_of_another_magnitude_are_refused(model: str, name: str, factor: float) -> None:
    data = measure(TireConfiguration(model=model))
    scaled = data._replace(**{name: getattr(data, name) * factor})
    with pytest.raises(TireDataError, match=f"the largest {name} is"):
        fit_tire(scaled, model)


def test_force_against_the_slip_is_refused() -> None:
    data = measure(TireConfiguration())
    with pytest.raises(TireDataError, match="sign of the slip"):
        fit_tire(TireData(data.slip, data.load, -data.force), "tmeasy")


@pytest.mark.parametrize(
    ("reason", "text"),
    [
        ("no column 'load'", "slip,load_kN,force\n0.1,3,100\n"),
        ("2 times", "slip,load,load_N,force\n0.1,3000,3000,100\n"),
        ("line 2: the load -3 N must be above 0", "slip,load,force\n0.1,-3,1\n"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_with_the_reason(
    reason: str, text: str, tmp_path: Path
) -> None:
    path = tmp_path / "data.csv"
    path.write_text(text)
    with pytest.raises(TireDataError, match=reason):
        read_tire_data(path)


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TireDataError, match="cannot read"):
        read_tire_data(tmp_path / "missing.csv")
    with pytest.raises(TireDataError, match="Not a regular file"):
        read_tire_data(Path("/dev/zero"))


def test_columns_may_come_in_any_order_with_others_beside_them(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_text("# rig 3\nForce_N, speed ,SLIP,load\n900,20,0.02,3000\n\n-900,20,-0.02,2500\n")
    data = read_tire_data(path)
    np.testing.assert_array_equal(data.slip, [0.02, -0.02])
    np.testing.assert_array_equal(data.load, [3000.0, 2500.0])
    np.testing.assert_array_equal(data.force, [900.0, -900.0])


def write(path: Path, data: TireData) -> Path:
    rows = (",".join(map(repr, map(float, row))) for row in zip(*data, strict=True))
    path.write_text("\n".join(["slip,load,force", *rows]))
    return path


def curve(friction: float, stiffness: float, load: float, largest_slip: float) -> TireData:
    """Return a Magic Formula curve at loads of a third, two thirds and all of `load` [N]."""
    slip = np.tile(np.linspace(-largest_slip, largest_slip, 101), 3)
    loads = np.repeat(load * np.array([1.0, 2.0, 3.0]) / 3.0, 101)
    return TireData(slip, loads, friction * loads * np.sin(1.4 * np.arctan(stiffness * slip)))


TIRES = {
    "kart": curve(2.0, 15.0, 900.0, 0.4),
    "racing car on a belt": curve(2.8, 20.0, 1500.0, 0.3),
    "passenger car": curve(1.0, 12.0, 6000.0, 1.0),
    "truck": curve(0.8, 8.0, 30000.0, 1.0),
    "wet ice": curve(0.03, 25.0, 4000.0, 1.0),
    "hard roller": curve(0.5, 60.0, 40.0, 0.1),
    "soft roller, driven beyond its peak": curve(0.7, 3.0, 40.0, 3.0),
    "snow": curve(0.3, 2.5, 10000.0, 1.0),
    "small slips only": curve(1.0, 10.0, 4000.0, 0.02),
}


@pytest.mark.parametrize("tire", TIRES)
def test_tires_of_all_sizes_are_read(tire: str, tmp_path: Path) -> None:
    read = read_tire_data(write(tmp_path / "data.csv", TIRES[tire]))
    np.testing.assert_array_equal(read.force, TIRES[tire].force)


@pytest.mark.parametrize("file", sorted((CONFIG / "tires").glob("*.yaml")))
def test_measurements_of_the_tires_in_config_are_read(file: Path, tmp_path: Path) -> None:
    tire = from_mapping(TireConfiguration, read_mapping(file, "tire"))
    loads = (0.3 * tire.largest_load, 0.7 * tire.largest_load, tire.largest_load)
    data = measure(tire, noise=0.01 * tire.largest_load, slips=(-1.0, 1.0), loads=loads)
    read_tire_data(write(tmp_path / "data.csv", data))
    percent = data._replace(slip=100.0 * data.slip)
    with pytest.raises(TireDataError, match="divide a slip in per cent by 100"):
        read_tire_data(write(tmp_path / "data.csv", percent))


@pytest.mark.parametrize("tire", ["kart", "passenger car", "truck", "wet ice", "snow"])
@pytest.mark.parametrize(
    ("column", "factor", "remedy"),
    [
        ("slip", 100.0, "per cent by 100"),
        ("slip", np.degrees(1.0), "slip angle in degrees by its tangent"),
        ("force", 1e-3, "give both in N"),
        ("load", 1e-3, "give both in N"),
    ],
)
def test_another_unit_is_refused_with_the_remedy(
    tire: str, column: str, factor: float, remedy: str, tmp_path: Path
) -> None:
    data = TIRES[tire]
    other = data._replace(**{column: factor * getattr(data, column)})
    with pytest.raises(TireDataError, match=remedy):
        read_tire_data(write(tmp_path / "data.csv", other))


def test_figure_shows_every_row() -> None:
    data = measure(TireConfiguration(), rows=200)
    upper = fit_figure(data, fit_tire(data, "tmeasy"), "title").axes[0]
    dots = [line for line in upper.lines if line.get_linestyle() == "None"]
    assert sum(len(np.asarray(line.get_xdata())) for line in dots) == 200
