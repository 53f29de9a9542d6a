"""All tire models: closed forms, the required shape of the curve, and the contact equation."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import omni_sim
from omni_core.configuration import ConfigurationError, from_mapping, to_mapping
from omni_sim.tire.interface import configuration
from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.tire.interface.model import contact_friction, curve_at, force_at
from omni_sim.tire.models import MODELS, kernel_parameters, magic_formula
from omni_sim.tire.tire import Tire

NAMES = tuple(MODELS)
TIRES = {name: Tire(TireConfiguration(model=name)) for name in NAMES}
D = 5000.0  # [N s/m]

loads = st.floats(100.0, 6000.0)
frictions = st.floats(0.05, 1.5)
every_model = pytest.mark.parametrize("name", NAMES)


def test_every_declared_model_is_there() -> None:
    assert set(NAMES) == set(configuration.MODELS)
    for name, model in MODELS.items():
        assert type(getattr(TireConfiguration(), name)) is model.configuration


@every_model
@given(loads, frictions)
def test_curve_gives_slope_peak_and_sliding_force(name: str, load: float, friction: float) -> None:
    tire = TIRES[name]
    curve = tire.curve(load, friction)

    def force(slip: float) -> float:
        return float(tire.force(slip, load, friction))

    h = 1e-7
    assert (force(h) - force(-h)) / (2.0 * h) == pytest.approx(curve.slope, rel=1e-4)
    assert force(curve.peak_slip) == pytest.approx(curve.peak_force, rel=1e-9)
    assert force(1e9) == pytest.approx(curve.slide_force, rel=1e-5)
    slips = np.linspace(0.0, 8.0 * curve.peak_slip, 3001)
    forces = tire.force(slips, load, friction)
    steps = np.diff(forces)
    rising = slips[1:] <= curve.peak_slip
    assert np.all(steps[rising] > 0.0)
    assert np.all(steps[slips[:-1] >= curve.peak_slip] <= 1e-12 * curve.peak_force)
    np.testing.assert_array_equal(tire.force(-slips, load, friction), -forces)


@every_model
@given(st.floats(0.0, 1.0), loads, frictions)
def test_friction_scales_force_and_slip_alike(
    name: str, slip: float, load: float, friction: float
) -> None:
    tire = TIRES[name]
    scaled = float(tire.force(slip, load, friction))
    assert scaled == pytest.approx(friction * float(tire.force(slip / friction, load)), rel=1e-9)
    assert tire.curve(load, friction).slope == pytest.approx(tire.curve(load).slope, rel=1e-12)


@every_model
@given(st.floats(0.0, 1.5), loads, frictions)
def test_derivative_is_that_of_the_force(
    name: str, slip: float, load: float, friction: float
) -> None:
    tire = TIRES[name]
    curve = curve_at(kernel_parameters(tire.configuration), load, friction)
    assume(abs(slip - curve.peak_slip) > 1e-4)  # the linear tire has a corner there
    h = 1e-6
    low = max(slip - h, 0.0)
    difference = (force_at(curve, slip + h)[0] - force_at(curve, low)[0]) / (slip + h - low)
    assert force_at(curve, slip)[1] == pytest.approx(difference, abs=2e-4 * curve.slope)


@every_model
def test_load_beyond_the_model_is_clamped_and_reported(name: str) -> None:
    tire = TIRES[name]
    assert tire.configuration.largest_load == 6000.0
    assert float(tire.force(0.1, 9000.0)) == float(tire.force(0.1, 6000.0))
    assert float(tire.force(0.1, -1.0)) == 0.0


@given(loads)
def test_linear_tire_is_proportional_to_slip_and_load_up_to_friction(load: float) -> None:
    tire = TIRES["linear"]
    for slip in (0.01, 0.059, 0.0601, 2.0):
        expected = load * min(50000.0 / 3000.0 * slip, 1.0)
        assert float(tire.force(slip, load)) == pytest.approx(expected, rel=1e-12)


@given(loads)
def test_magic_formula_and_tmeasy_share_the_parabola_of_equation_3(load: float) -> None:
    # Bakker's D = (a_1 F_z + a_2) F_z is the parabola of Eq. (3), by other coefficients.
    one, other = TIRES["magic_formula"].curve(load), TIRES["tmeasy"].curve(load)
    assert one.peak_force == pytest.approx(other.peak_force, rel=1e-12)
    assert one.slope == pytest.approx(other.slope, rel=1e-12)


@given(st.floats(1.06, 1.94), st.floats(-3.0, 3.0))
def test_magic_formula_without_curvature_has_closed_forms(shape: float, exponent: float) -> None:
    slip = 10.0**exponent
    parameters = magic_formula.constants(0.8, 0.0, 12.0, 0.0, shape, 0.0)
    curve = curve_at(parameters, 1000.0, 1.0)
    b = 12.0 / (shape * 0.8)
    expected = 800.0 * math.sin(shape * math.atan(b * slip))
    assert force_at(curve, slip)[0] == pytest.approx(expected, rel=1e-9)
    # The sine is at its top where C atan(x) is a right angle.
    assert curve.peak_slip == pytest.approx(math.tan(0.5 * math.pi / shape) / b, rel=1e-9)


@given(st.floats(1.05, 1.95), st.floats(-20.0, 0.95))
def test_magic_formula_knows_where_it_falls_fastest(shape: float, curvature: float) -> None:
    parameters = magic_formula.constants(1.0, 0.0, 10.0, 0.0, shape, curvature)
    x = parameters.peak * np.geomspace(1.0, 1e4, 4000)
    falls = [-magic_formula.unit_curve(shape, curvature, float(place))[1] for place in x]
    assert max(falls) <= parameters.fall * (1.0 + 1e-6) + 1e-12
    assert max(falls) == pytest.approx(parameters.fall, rel=1e-3, abs=1e-12)


def tire_of_random_shape(name: str, shape: float, curvature: float) -> TireConfiguration:
    if name != "magic_formula":
        return TireConfiguration(model=name)
    formula = {"shape": shape, "curvature": curvature}
    return from_mapping(TireConfiguration, {"model": name, "magic_formula": formula})


@every_model
@given(
    st.floats(0.0, 2e4),
    st.floats(-7.0, 2.0),
    st.floats(1.0, 5.0),
    st.booleans(),
    st.floats(0.0, 6000.0),
    st.tuples(st.floats(1.05, 1.95), st.floats(-20.0, 0.95)),
)
def test_patch_speed_solves_the_balance_of_forces(
    name: str,
    demand: float,
    exponent: float,
    gain: float,
    sliding: bool,
    load: float,
    shape: tuple[float, float],
) -> None:
    speed = 10.0**exponent
    parameters = kernel_parameters(tire_of_random_shape(name, *shape))
    curve = curve_at(parameters, load, 1.0)
    force, w, now = contact_friction(demand, D, gain, speed, curve, sliding)
    assert 0.0 <= force <= curve.peak_force * (1.0 + 1e-12)
    assert w >= 0.0
    assert D * w + gain * force == pytest.approx(demand, rel=1e-9, abs=1e-9)
    if speed > 1e-2 and curve.peak_force > 0.0:
        assert force == pytest.approx(force_at(curve, w / speed)[0], rel=1e-6, abs=1e-6)
    if curve.peak_force > 0.0 and w < curve.peak_slip * speed:
        assert not now


@every_model
@pytest.mark.parametrize("speed", [1e-6, 0.02])
@pytest.mark.parametrize("curvature", [-10.0, -1.3, 0.6])
def test_a_patch_sticks_up_to_the_peak_and_slides_down_to_the_least_force(
    name: str, curvature: float, speed: float
) -> None:
    parameters = kernel_parameters(tire_of_random_shape(name, 1.4, curvature))
    curve = curve_at(parameters, 3000.0, 1.0)
    demands = np.linspace(0.0, 1.5 * curve.peak_force + 2.0 * D * speed, 3001)
    sliding = False
    states = []
    for demand in (*demands, *demands[::-1]):
        force, w, sliding = contact_friction(float(demand), D, 1.0, speed, curve, sliding)
        states.append((demand, force, w, sliding))
    for demand, force, w, slides in states[: len(demands)]:
        at_peak = curve.peak_force + D * speed * curve.peak_slip
        if demand <= at_peak - 2.0:
            assert not slides
            assert force == pytest.approx(demand - D * w)
            assert w <= curve.peak_slip * speed
        elif demand >= at_peak + 2.0 and speed < 1e-3:
            assert slides
            assert force == pytest.approx(curve.slide_force, rel=2e-3)
    # A sliding patch keeps sliding as long as there is a solution beyond the peak.
    beyond = curve.peak_slip * np.geomspace(1.0, 1e9, 20_000)
    least = min(D * speed * slip + force_at(curve, slip)[0] for slip in beyond)
    for demand, _, _, slides in states[len(demands) :]:
        assert slides == (demand > least) or abs(demand - least) < 2.0


@pytest.mark.parametrize(
    ("key", "mapping"),
    [
        ("model", {"model": "tmeasi"}),
        ("magic_formula.friction_gradient", {"magic_formula": {"friction_gradient": -2e-4}}),
        ("magic_formula.stiffness_gradient", {"magic_formula": {"stiffness_gradient": -2e-3}}),
        ("magic_formula.shape", {"magic_formula": {"shape": 2.5}}),
        ("linear.friction", {"linear": {"friction": 0.0}}),
        ("nominal_load_1", {"nominal_load_1": 3000.0}),
    ],
)
def test_a_tire_that_makes_no_sense_is_refused_by_name(
    key: str, mapping: dict[str, object]
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        from_mapping(TireConfiguration, mapping)
    assert caught.value.key == key


@every_model
def test_configuration_survives_its_mapping(name: str) -> None:
    tire = TireConfiguration(model=name)
    assert from_mapping(TireConfiguration, to_mapping(tire)) == tire


def test_a_fourth_model_is_a_module_and_a_section(tmp_path: Path) -> None:
    package = Path(omni_sim.__file__).parent
    shutil.copytree(package, tmp_path / "omni_sim", ignore=shutil.ignore_patterns("__pycache__"))
    models = tmp_path / "omni_sim" / "tire" / "models"
    text = (models / "linear.py").read_text()
    (models / "twice.py").write_text(text.replace("peak_force = ", "peak_force = 2.0 * "))
    declared = tmp_path / "omni_sim" / "tire" / "interface" / "configuration.py"
    text = declared.read_text().replace("MODELS = (", 'MODELS = ("twice", ', 1)
    model = "    linear: LinearConfiguration = section(LinearConfiguration)\n"
    assert model in text
    declared.write_text(text.replace(model, model + model.replace("linear", "twice", 1)))
    program = """
from omni_core.configuration import from_mapping
from omni_sim.tire.tire import Tire, TireConfiguration
print(*(float(Tire(from_mapping(TireConfiguration, {"model": name})).force(9.0, 1000.0))
        for name in ("linear", "twice")))
"""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join((str(tmp_path), *sys.path)),
        "NUMBA_DISABLE_JIT": "1",  # compiling is what the other tests are for
    }
    answer = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert answer.stdout.split() == ["1000.0", "2000.0"]
