"""The joint estimator: covariance along the lines, displacement, fixed pattern, rest and edges."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.joint import candidates
from linescan_odometry.joint.estimator import JointEstimator
from linescan_odometry.joint.fit import _moved, assess, noise_of, scatter
from linescan_odometry.joint.likelihood import Expansion, expand, whiten
from linescan_odometry.joint.spectra import shrink, without_defects
from linescan_odometry.odometry import LineScanOdometry
from linescan_odometry.sensor import SensorOdometry
from omni_core.sensors import LineSensor, sensor_matrix
from omni_core.signals import LineBatch

Expose = Callable[..., Any]

PIXELS, LINES, RATE, PITCH = 512, 26, 2500.0, 5e-5
CHANGE = 15.0 / (RATE**2 * PITCH)  # px per line^2


def estimator(pixels: int = PIXELS, pitch: float = PITCH, rate: float = RATE) -> JointEstimator:
    """Return an estimator for a camera with this pixel pitch [m] and line rate [1/s]."""
    sensor = LineSensor(
        x=0.0, y=0.0, heading_deg=0.0, pixels=pixels, length=pitch * pixels, line_rate=rate
    )
    return JointEstimator(sensor, pixels // 2)


def moved(expose: Expose, displacement: float, **changes: Any) -> Any:
    return expose(np.arange(LINES) * displacement, PIXELS, **{"noise": 2.0, **changes})


def test_the_filter_along_the_lines_is_the_inverse_of_the_covariance() -> None:
    generator = np.random.default_rng(1)
    m, edges = 7, np.array([1, 4, 9])
    model = np.array([[2.0, 0.5], [0.9, 0.3], [0.4, 1.5]])
    spectra = (generator.normal(size=(m, 9)) + 1j * generator.normal(size=(m, 9))).astype(
        np.complex64
    )
    white = whiten(spectra, np.array([0, m]), edges, model)
    for band, (texture, rho, noise) in enumerate(model.T):
        lag = np.abs(np.subtract.outer(np.arange(m), np.arange(m)))
        covariance = texture * rho**lag + noise * np.eye(m)
        inside = slice(edges[band], edges[band + 1])
        direct = np.linalg.solve(covariance, spectra[:, inside])
        np.testing.assert_allclose(white[:, inside], direct, rtol=2e-4, atol=2e-5)


@pytest.mark.parametrize("displacement", [-150.3, -40.0, -3.7, -0.31, 0.0, 0.02, 1.5, 12.4, 81.9])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_displacements_are_recovered_within_their_deviation(
    displacement: float, dtype: Any, expose: Expose
) -> None:
    found = estimator().estimate(moved(expose, displacement, dtype=dtype))
    assert found.reason == ""
    assert abs(found.value - displacement) < 5.0 * math.sqrt(found.variance)
    assert math.sqrt(found.variance) < 0.05


def test_two_lines_are_enough(expose: Expose) -> None:
    found = estimator().estimate(expose([0.0, 7.3], PIXELS, noise=1.0))
    assert found.reason == ""
    assert found.value == pytest.approx(7.3, abs=0.2)


def test_an_acceleration_does_not_bias_the_mean(expose: Expose) -> None:
    kappa = np.arange(LINES) - 0.5 * (LINES - 1)
    lines = expose(20.0 * kappa + 0.5 * CHANGE * kappa**2, PIXELS, noise=2.0)
    found = estimator().estimate(lines)
    assert abs(found.value - 20.0) < 5.0 * math.sqrt(found.variance)


@pytest.mark.parametrize("displacement", [4.0, 15.0, 60.0])
def test_unequal_gains_do_not_draw_a_motion_to_rest(displacement: float, expose: Expose) -> None:
    generator = np.random.default_rng(3)
    gain = 1.0 + 0.2 * generator.standard_normal(PIXELS)
    lines = moved(expose, displacement) * gain
    found = estimator().estimate(np.rint(lines).clip(0, 255).astype(np.uint8))
    assert found.reason == ""
    assert abs(found.value - displacement) < max(5.0 * math.sqrt(found.variance), 0.02)


@pytest.mark.parametrize("displacement", [0.0, 3.0])
def test_the_gain_of_a_line_does_not_change_its_displacement(
    displacement: float, expose: Expose
) -> None:
    mains = 1.0 + 0.2 * np.sin(2.0 * np.pi * 100.0 * np.arange(LINES) / RATE)
    lines = moved(expose, displacement) * mains[:, None]
    found = estimator().estimate(np.rint(lines).clip(0, 255).astype(np.uint8))
    assert found.reason == ""
    assert abs(found.value - displacement) < 5.0 * math.sqrt(found.variance)


@pytest.mark.parametrize("displacement", [0.0, 0.01])
def test_unequal_pixels_do_not_make_a_creeping_vehicle_rest(
    displacement: float, expose: Expose
) -> None:
    scores = []
    for seed in range(10):
        gain = 1.0 + 0.05 * np.random.default_rng(seed).standard_normal(PIXELS)
        lines = moved(expose, displacement, grain=6.0, seed=seed, noise_seed=seed) * gain
        found = estimator().estimate(np.rint(lines).clip(0, 255).astype(np.uint8))
        assert found.reason == ""
        scores.append((found.value - displacement) ** 2 / found.variance)
    assert np.mean(scores) < 2.0**2


@pytest.mark.parametrize("displacement", [0.8, 1.5])
@pytest.mark.parametrize("contrast", [0.2, 0.4])
def test_strong_dirt_does_not_draw_a_slow_faint_ground_to_rest(
    displacement: float, contrast: float, expose: Expose
) -> None:
    measured = 0
    for seed in range(6):
        generator = np.random.default_rng(seed)
        gain = np.ones(PIXELS)
        gain[generator.integers(0, PIXELS, 20)] = 0.4
        ground = moved(expose, displacement, grain=5.0, seed=seed)
        lines = (ground.mean() + contrast * (ground - ground.mean())) * gain
        lines += generator.normal(0.0, 1.5, lines.shape)
        found = estimator().estimate(np.rint(lines).clip(0, 255).astype(np.uint8))
        if found.reason == "":
            assert abs(found.value - displacement) < 5.0 * math.sqrt(found.variance)
            measured += 1
    assert measured >= 5 or displacement < 1.0


def test_an_edge_that_moves_over_a_view_at_rest_is_not_taken_for_the_ground(
    expose: Expose,
) -> None:
    place = np.arange(PIXELS) - 2.5 * np.arange(LINES)[:, None]
    shade = 1.0 - 0.5 / (1.0 + np.exp((place - 0.5 * PIXELS) / 10.0))
    lines = np.rint(moved(expose, 0.0, grain=3.0) * shade).astype(np.uint8)
    assert estimator().estimate(lines).reason != ""


def sideways(
    seed: int,
    displacement: float,
    coherence: float,
    contrast: float,
    grains: Mapping[float, float],
    shape: tuple[int, int] = (LINES, PIXELS),
) -> Any:
    """Return lines of a camera that moves along and across its axis.

    Args:
        seed: seed of ground and noise.
        displacement: displacement per line [px].
        coherence: coherence of neighboring lines [1].
        contrast: standard deviation of the lines [gray levels].
        grains: amplitude of each component of the texture by its correlation length [px].
        shape: number of lines, and of pixels per line.
    """
    count, pixels = shape
    rate = 2.0 * math.pi * np.fft.rfftfreq(4 * pixels)
    spectrum = sum(share * np.exp(-0.5 * (grain * rate) ** 2) for grain, share in grains.items())
    generator = np.random.default_rng(seed)
    fresh = spectrum * np.fft.rfft(generator.standard_normal((count, 4 * pixels)))
    ground = [fresh[0]]
    for new in fresh[1:]:
        kept = coherence * ground[-1] + math.sqrt(1.0 - coherence**2) * new
        ground.append(kept * np.exp(1j * displacement * rate))
    lines = np.fft.irfft(ground)[:, :pixels]
    lines *= contrast / lines.std()
    lines += generator.normal(128.0, 2.0, lines.shape)
    return np.rint(lines).clip(0, 255).astype(np.uint8)


def scores_sideways(
    displacement: float, coherence: float, contrast: float, grains: Mapping[float, float]
) -> list[float]:
    """Return the normalized squared errors of 40 batches; arguments as in `sideways`."""
    scores = []
    for seed in range(40):
        lines = sideways(seed, displacement, coherence, contrast, grains)
        found = estimator().estimate(lines)
        if not found.reason:
            scores.append((found.value - displacement) ** 2 / found.variance)
    return scores


def expanded(displacement: float) -> tuple[Any, Expansion]:
    """Return lines in motion across the axis, and the expansion at a displacement [px]."""
    logs = np.log(sideways(3, 1.7, 0.9, 20.0, {3.0: 1.0})).astype(np.float32)
    return logs, expand(logs, np.zeros(307), np.array([displacement, 0.0]), PIXELS // 2, CHANGE)


def shifted(here: Expansion, shift: Any) -> Expansion:
    """Return an expansion whose spectra are shifted, by a shift per line at each frequency [px]."""
    cut, model = here.cut, here.model
    turn = np.multiply.outer(model.along[0, cut.line], model.rate * shift)
    spectra = (cut.spectra * np.exp(-1j * turn)).astype(np.complex64)
    white = whiten(spectra, cut.first, model.edges, model.bands)
    return here._replace(cut=cut._replace(spectra=spectra), white=white)


def test_the_observed_curvature_is_the_slope_of_the_newton_step() -> None:
    _, here = expanded(1.71)

    def step(shift: float) -> float:
        there = shifted(here, shift)
        product, _ = _moved(there)
        return float((np.conj(1j * here.model.rate * there.cut.spectra) * product).real.sum())

    assert step(0.0) == pytest.approx(here.step[0], rel=1e-2)
    slope = (step(1e-3) - step(-1e-3)) / 2e-3
    assert _moved(here)[1] == pytest.approx(-slope, rel=1e-2)


def test_the_variance_contains_the_scatter_between_frequency_bands() -> None:
    logs, here = expanded(1.7)
    drift = np.zeros(len(here.model.rate))
    for band, (i, j) in enumerate(itertools.pairwise(here.model.edges)):
        drift[i:j] = 0.3 * (-1.0) ** band  # px per line; opposite in neighboring bands
    pixels, noise = logs.shape[1], noise_of(logs)
    deviation = math.sqrt(assess(here, pixels, noise).variance)
    drifted = math.sqrt(assess(shifted(here, drift), pixels, noise).variance)
    assert deviation < 0.05
    assert 0.1 < drifted < 0.4


@pytest.mark.parametrize("displacement", [0.03, 1.34])
def test_lines_far_apart_on_different_ground_do_not_mislead_the_candidates(
    displacement: float,
) -> None:
    coarse = estimator(128)
    for seed in range(20):
        found = coarse.estimate(sideways(seed, displacement, 0.9, 20.0, {1.5: 1.0}, (157, 128)))
        assert found.reason == ""
        assert found.value == pytest.approx(displacement, abs=0.05)


def over_fibers(seed: int) -> Any:
    """Return lines of a coarse camera that moves across its axis over long, thin fibers.

    The fibers are longer than the height of the pixels, which is that of 76 lines, and have random
    directions. The camera does not move along its axis.
    """
    lines, pixels, covered, step = 157, 128, 76, 0.66  # step: motion across from line to line [px]
    generator = np.random.default_rng(seed)
    extent = np.array([[lines + covered], [pixels / step]])
    half = 50.0 / step  # half length of a fiber [lines]
    center = generator.uniform(-half, extent + half, (2, 1500))
    angle = generator.uniform(0.0, math.pi, 1500)
    along = np.arange(-half, half, 0.5)
    row, place = center[..., None] + np.array((np.cos(angle), np.sin(angle)))[..., None] * along
    strips, _, _ = np.histogram2d(
        row.ravel(),
        step * place.ravel(),
        (lines + covered, pixels),
        ((0, lines + covered), (0, pixels)),
        weights=np.repeat(generator.normal(size=1500), len(along)),
    )
    total = strips.cumsum(axis=0)
    levels = total[covered:] - total[:-covered]
    levels *= 20.0 / levels.std()
    levels += generator.normal(128.0, 1.0, levels.shape)
    return np.rint(levels).clip(0, 255).astype(np.uint8)


def test_errors_over_fibers_longer_than_the_pixels_are_stated() -> None:
    scores = []
    for seed in range(40):
        found = estimator(128, 3.9e-4, 15600.0).estimate(over_fibers(seed))
        if found.reason:
            assert found.reason.startswith("dominated by")
            continue
        scores.append(found.value**2 / found.variance)
    assert len(scores) >= 39  # a few features may determine a batch
    assert max(scores) < 3.0**2
    assert np.mean(scores) < 1.5**2  # the stated deviation is correct within a factor of 1.5


def test_texture_common_to_many_lines_counts_as_few_pairs() -> None:
    number, lines, coherence = 40, 60, 0.9
    distances = np.arange(1, lines)
    generator = np.random.default_rng(6)
    series = np.empty((2, 4000, lines))
    fresh = generator.standard_normal(series.shape) * math.sqrt(1.0 - coherence**2)
    series[..., 0] = generator.standard_normal(series.shape[:2])
    for k in range(1, lines):
        series[..., k] = coherence * series[..., k - 1] + fresh[..., k]
    product = (series[0] * series[1])[:, :number].mean(axis=1)  # of unrelated lines
    square = (coherence ** (2.0 * distances)).astype(np.float32)[:, None]
    effective = candidates.independent(square, distances, lines)[lines - number - 1, 0]
    assert effective == pytest.approx(1.0 / np.var(product), rel=0.1)


def test_the_error_of_a_mean_does_not_count_as_a_pattern() -> None:
    generator = np.random.default_rng(1)
    precision = np.full(600, 4.0)
    error = 0.5 * (generator.normal(size=600) + 1j * generator.normal(size=600)) / math.sqrt(2.0)
    pattern = generator.normal(size=600) + 1j * generator.normal(size=600)
    # The power of the pattern is 2, so 1 / (1 + 1 / (2 * 4)) of its mean remains.
    for truth, lowest, highest in ((0.0, 0.0, 0.17), (1.0, 0.87, 0.91)):
        mean = (truth * pattern + error).astype(np.complex64)
        shrunk = shrink((precision * mean).astype(np.complex64), precision)
        assert lowest <= np.median(np.abs(shrunk / mean)) <= highest


@pytest.mark.parametrize("displacement", [1.7, 5.0])
def test_errors_on_a_smooth_ground_that_leaves_the_view_sideways_are_stated(
    displacement: float,
) -> None:
    scores = scores_sideways(displacement, 0.7, 10.0, {10.0: 1.0})
    assert len(scores) >= 20
    assert max(scores) < 5.0**2
    assert np.mean(scores) < 2.0**2  # the stated deviation is correct within a factor of 2


@pytest.mark.parametrize("displacement", [1.7, 5.0])
def test_features_longer_than_a_segment_do_not_enlarge_the_stated_errors(
    displacement: float,
) -> None:
    scores = scores_sideways(displacement, 0.9, 20.0, {3.0: 1.0, 60.0: 10.0})
    assert len(scores) >= 35
    assert 0.5**2 < np.mean(scores) < 2.0**2


def test_lines_of_nothing_but_noise_are_not_measured() -> None:
    noise = np.random.default_rng(4).normal(100.0, 3.0, (LINES, PIXELS))
    assert estimator().estimate(np.rint(noise).astype(np.uint8)).reason != ""


def test_rest_of_a_coarse_camera_is_always_measured(expose: Expose) -> None:
    camera = estimator(256)
    for seed in range(200):
        found = camera.estimate(expose(np.zeros(11), 256, grain=3.0, noise=2.0, noise_seed=seed))
        assert found.reason == ""
        assert abs(found.value) < 5.0 * math.sqrt(found.variance)


@pytest.mark.parametrize("darkest", [0.0, 0.03])
def test_the_noise_of_dark_pixels_is_not_taken_for_motion(darkest: float, expose: Expose) -> None:
    distance = (np.arange(PIXELS) - 0.3 * PIXELS) / 4.0
    gain = 1.0 - (1.0 - darkest) * np.exp(-0.5 * distance**2)
    for seed in range(20):
        noise = np.random.default_rng(seed).normal(0.0, 2.0, (LINES, PIXELS))
        lines = moved(expose, 0.0, noise=0.0, seed=seed) * gain + noise
        found = estimator().estimate(np.rint(lines).clip(0, 255).astype(np.uint8))
        assert found.reason == ""
        assert abs(found.value) < 5.0 * math.sqrt(found.variance)


@pytest.mark.parametrize("grain", [3.0, 8.0])
@pytest.mark.parametrize("contrast", [3.0, 10.0])
def test_dirt_over_a_ground_without_coherence_is_not_rest(contrast: float, grain: float) -> None:
    generator = np.random.default_rng(2)
    gain = np.ones(PIXELS)
    for place in generator.uniform(0.0, PIXELS, 12):
        distance = np.minimum(np.abs(np.arange(PIXELS) - place) / 20.0, 1.0)
        gain *= 1.0 - 0.5 * (1.0 - distance**2) ** 2
    for seed in range(6):
        lines = sideways(seed, 0.0, 0.0, contrast, {grain: 1.0}) * gain
        found = estimator().estimate(np.rint(lines).astype(np.uint8))
        assert found.reason or math.sqrt(found.variance) * LINES > candidates.APART


def unequal(expose: Expose, displacement: float, contrast: float, seed: int) -> Any:
    """Return lines of a camera whose pixel gains differ by 1 %; `contrast` is the ground's."""
    generator = np.random.default_rng(seed)
    gain = 1.0 + 0.01 * np.random.default_rng(1).standard_normal(PIXELS)
    ground = expose(np.arange(LINES) * displacement, PIXELS, grain=3.0, noise=0.0, seed=seed)
    lines = 128.0 * (1.0 + contrast * (ground / 128.0 - 1.0) / (30.0 / 128.0)) * gain
    lines += generator.normal(0.0, 2.0, lines.shape)
    return np.rint(lines).astype(np.uint8)


@pytest.mark.parametrize("contrast", [0.0, 0.003])
@pytest.mark.parametrize("displacement", [0.3, 1.0])
def test_unequal_pixels_do_not_show_rest_before_the_camera_has_moved(
    displacement: float, contrast: float, expose: Expose
) -> None:
    for seed in range(20):
        found = estimator().estimate(unequal(expose, displacement, contrast, seed))
        assert found.reason or abs(found.value - displacement) < 5.0 * math.sqrt(found.variance)


def test_a_camera_that_has_moved_measures_rest_over_a_faint_ground(expose: Expose) -> None:
    camera = estimator()
    cold = camera.estimate(unequal(expose, 0.0, 0.01, 1))
    for seed in range(20):
        assert not camera.estimate(unequal(expose, 7.0, 0.1, seed)).reason
    warm = camera.estimate(unequal(expose, 0.0, 0.01, 1))
    assert not warm.reason
    assert abs(warm.value) < 5.0 * math.sqrt(warm.variance)
    assert warm.variance < 0.7 * cold.variance


@pytest.mark.parametrize("method", ["pairs", "joint"])
def test_each_method_measures_the_twist(method: str, expose: Expose) -> None:
    sensors = {
        name: LineSensor(
            x=x, y=y, heading_deg=heading, pixels=PIXELS, length=PITCH * PIXELS, line_rate=RATE
        )
        for name, x, y, heading in (("left", 0.0, 0.5, 0.0), ("right", 0.0, -0.5, 0.0),
                                    ("front", 0.6, 0.0, 90.0))
    }  # fmt: skip
    odometry = LineScanOdometry(
        OdometryConfiguration(sensors=sensors, method=method, cover_detection=False)
    )
    twist = np.array([4.0, 1.0, 0.5])
    speeds = sensor_matrix(sensors) @ twist
    estimate = odometry.update(
        {
            name: LineBatch(10**9, moved(expose, speed / RATE / PITCH, seed=i))
            for i, (name, speed) in enumerate(zip(sensors, speeds, strict=True))
        }
    )
    assert estimate.measured, estimate.reason
    assert estimate.twist == pytest.approx(twist, abs=5e-3)


def test_a_stuck_pixel_leaves_a_coarse_ground_at_rest_measured(expose: Expose) -> None:
    length = PITCH * PIXELS
    sensor = LineSensor(
        x=0.0, y=0.0, heading_deg=0.0, pixels=PIXELS, length=length, non_uniformity=0.0
    )
    lines = moved(expose, 0.0, grain=6.0)
    lines[:, 100] = 0
    reading = SensorOdometry(sensor, _with_others(sensor)).update(LineBatch(10**9, lines))
    assert reading.measured, reading.reason
    assert abs(reading.velocity) < 5.0 * math.sqrt(reading.variance) < 0.01


def test_gradients_far_below_the_noise_need_another_batch(expose: Expose) -> None:
    ground = moved(expose, 7.0, grain=6.0, noise=0.0)
    noise = np.random.default_rng(5).normal(0.0, 3.0, ground.shape)
    certain = []
    for contrast in (1.0, 0.02):
        faint = ground.mean() + contrast * (ground - ground.mean()) + noise
        estimate = estimator().estimate(np.rint(faint).clip(0, 255).astype(np.uint8))
        certain.append(not estimate.reason and not estimate.few)
    assert certain == [True, False]


def test_defective_pixels_are_interpolated_and_only_they(expose: Expose) -> None:
    sound = moved(expose, 7.0, grain=8.0)
    assert without_defects(sound) is sound
    broken = sound.copy()
    broken[:, 40], broken[:, 100], broken[:, 101] = 0, 255, 250
    mended = without_defects(broken)
    assert np.abs(mended.astype(int) - sound)[:, [40, 100, 101]].max() < 40
    others = np.setdiff1d(np.arange(PIXELS), [40, 100, 101])
    assert np.array_equal(mended[:, others], sound[:, others])
    assert broken[0, 40] == 0  # the camera's buffer is not changed


@pytest.mark.parametrize("gains", [0.01, 0.02, 0.05])
def test_unequal_pixels_on_a_smooth_ground_are_not_defective(gains: float) -> None:
    """Most pixels are between their neighbors, on the slopes of the ground."""
    generator = np.random.default_rng(7)
    ground = gaussian_filter1d(generator.normal(0.0, 1.0, 2048), 6.0)
    lines = (110.0 + 20.0 * ground / ground.std()) * (1.0 + gains * generator.normal(size=2048))
    noise = generator.normal(0.0, 2.0, (LINES, 2048))
    exposed = np.rint(lines + noise).clip(0, 255).astype(np.uint8)
    assert without_defects(exposed) is exposed


@pytest.mark.parametrize("displacement", [0.0, 3.0, -5.0])
def test_the_variance_due_to_rivals_is_that_of_equally_likely_displacements(
    displacement: float,
) -> None:
    shape = candidates.SPACINGS, 256
    lagged, power = np.ones(shape, np.complex64), np.ones(shape, np.float32)  # lines at rest
    rest = candidates.Correlation(lagged, power[0], power)
    layout = candidates.Layout(26, 512, 1024, 256)
    away = np.arange(-candidates.APART, candidates.APART + 1.0)
    differences = np.array([-displacement, *away])
    equal = scatter(rest, layout, displacement, (math.inf, 0.0))
    assert equal == pytest.approx(np.mean(differences**2))
    assert scatter(rest, layout, displacement, (0.0, 0.0)) == 0.0
    # From 3 px, the search finds 2 to -3 px, which are at least as near to rest; then rest itself.
    differences = np.array([0.0, -3.0, -1.0, -2.0, -3.0, -4.0, -5.0, -6.0])
    variance = scatter(rest, layout, 3.0, (1e-3, 0.0))
    assert variance == pytest.approx(np.mean(differences**2))


def test_sharp_features_do_not_prevent_the_detection_of_rest() -> None:
    sensor = LineSensor(x=0.0, y=0.0, heading_deg=0.0, pixels=PIXELS, length=PITCH * PIXELS)
    camera = SensorOdometry(sensor, _with_others(sensor))
    generator, x = np.random.default_rng(1), np.arange(PIXELS) / PIXELS
    phases = generator.uniform(0.0, 6.0, 9)
    waves = (math.tau * k * x + phase for k, phase in enumerate(phases, 3))
    ground = 128.0 + 6.0 * sum(map(np.cos, waves))
    ground[generator.permutation(PIXELS)[: PIXELS // 32]] += 20.0
    for stamp_ns in range(10**9, 10**9 + 30 * 10**7, 10**7):
        noise = generator.normal(0.0, 2.0, (LINES - 1, PIXELS))
        lines = np.rint(ground + noise).clip(0, 255).astype(np.uint8)
        assert without_defects(lines) is not lines
        assert camera.update(LineBatch(stamp_ns, lines)).reason == ""


def test_frozen_and_empty_lines_are_refused(expose: Expose) -> None:
    sensor = LineSensor(x=0.0, y=0.0, heading_deg=0.0, pixels=PIXELS, length=PITCH * PIXELS)
    camera = SensorOdometry(sensor, _with_others(sensor))
    still = np.repeat(expose([0.0], PIXELS), LINES, axis=0)
    assert camera.update(LineBatch(10**9, still)).reason.startswith("frozen")
    half = moved(expose, 4.0)
    half[LINES // 2 :] = half[LINES // 2]
    assert camera.update(LineBatch(10**9 + 10_000_000, half)).reason.startswith("frozen")
    dark = np.zeros((LINES, PIXELS), np.uint8)
    assert camera.update(LineBatch(2 * 10**9, dark)).reason.startswith("no contrast")


def _with_others(sensor: LineSensor) -> OdometryConfiguration:
    others = {
        f"other_{i}": LineSensor(x=0.3 * i, y=0.5 - i, heading_deg=60.0 * i, pixels=PIXELS)
        for i in (1, 2)
    }
    return OdometryConfiguration(sensors={"camera": sensor, **others}, method="joint")
