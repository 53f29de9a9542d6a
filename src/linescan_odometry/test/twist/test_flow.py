"""Flow sensors measure two velocities at their position, alone or together with line cameras."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.odometry import LineScanOdometry, TwistEstimate
from linescan_odometry.port import BatchCollector
from linescan_odometry.twist.least_squares import KinematicsConfiguration, TwistSolver
from omni_core.configuration import ConfigurationError
from omni_core.sensors import FlowSensor, LineSensor, sensor_matrix
from omni_core.signals import Flow, LineBatch, LineBatchError

TWIST = np.array((1.2, -0.4, 0.7))
PERIOD_NS = 10_000_000
CORNERS = {
    "front": FlowSensor(x=0.6, y=0.1, heading_deg=10.0),
    "left": FlowSensor(x=-0.3, y=0.5, heading_deg=-80.0),
    "right": FlowSensor(x=-0.2, y=-0.5, heading_deg=200.0),
    "rear": FlowSensor(x=-0.7, y=0.0, heading_deg=45.0),
}
SLANTED = np.array(((4e-4, 1.5e-4), (1.5e-4, 1e-4)))


def only(*names: str, **changes: Any) -> dict[str, FlowSensor]:
    return {name: dataclasses.replace(CORNERS[name], **changes) for name in names}


def odometry(flows: dict[str, FlowSensor], **more: Any) -> LineScanOdometry:
    settings: dict[str, Any] = {"sensors": {}, "flow_sensors": flows, **more}
    settings.setdefault("maximum_acceleration", 0.0)
    return LineScanOdometry(OdometryConfiguration(**settings))


def flows_at(
    twist: np.ndarray, flows: dict[str, FlowSensor], stamp_ns: int = 0, /, **errors: Any
) -> dict[str, Flow]:
    velocities = (sensor_matrix(flows) @ twist).reshape(-1, 2)
    return {
        name: Flow(stamp_ns, velocity + errors.get(name, 0.0), SLANTED.copy())
        for name, velocity in zip(flows, velocities, strict=True)
    }


def test_two_flow_sensors_measure_the_twist_without_any_camera() -> None:
    flows = only("front", "left")
    estimate = odometry(flows).update(flows_at(TWIST, flows))
    assert estimate.measured
    np.testing.assert_allclose(estimate.twist, TWIST, atol=1e-12)


@pytest.mark.parametrize("calibrated", [False, True])
def test_the_covariance_is_that_of_the_errors(calibrated: bool) -> None:
    """Each sensor has correlated noise, and one scale, axis and position error."""
    errors = {"scale_error": 0.02, "heading_error_deg": 1.0, "lever_error": 0.01}
    flows = only(*CORNERS, **(errors if calibrated else {}))
    solver, matrix = TwistSolver(flows, 0.02), sensor_matrix(flows)
    random, used = np.random.default_rng(3), (True,) * 4
    noise = np.kron(np.eye(4), SLANTED)
    root = np.kron(np.eye(4), np.linalg.cholesky(SLANTED))
    normalized = []
    for _ in range(1500):
        velocity = matrix @ TWIST
        if calibrated:
            pairs = velocity.reshape(4, 2)
            scale, turn = 0.02 * random.normal(size=4), np.radians(1.0) * random.normal(size=4)
            across = pairs[:, ::-1] * (1.0, -1.0)
            lever = 0.01 * random.normal(size=(4, 2)) * TWIST[2]
            velocity = (pairs * (1.0 + scale[:, None]) + turn[:, None] * across + lever).ravel()
        twist, covariance = solver.solve(velocity + root @ random.normal(size=8), noise, used)
        error = twist - TWIST
        normalized.append(error @ np.linalg.solve(covariance, error))
    assert np.mean(normalized) == pytest.approx(3.0, rel=0.1)  # mean of chi-square, 3 dof


def test_a_scale_and_an_axis_error_are_common_to_both_velocities_of_a_flow_sensor() -> None:
    flows = only("front", "left", scale_error=0.02, heading_error_deg=3.0, lever_error=0.05)
    matrix, noise = sensor_matrix(flows), 1e-6 * np.eye(4)
    velocity, expected = matrix @ TWIST, noise.copy()
    for i in (0, 2):
        v, w = velocity[i : i + 2]
        scale, turn = 0.02 * np.array((v, w)), np.radians(3.0) * np.array((w, -v))
        common = np.outer(scale, scale) + np.outer(turn, turn)
        expected[i : i + 2, i : i + 2] += common + np.eye(2) * (0.05 * TWIST[2]) ** 2
    _, covariance = TwistSolver(flows, 0.02).solve(velocity, noise, (True, True))
    inverse = matrix.T @ np.linalg.solve(expected, matrix)
    np.testing.assert_allclose(covariance, np.linalg.inv(inverse), rtol=1e-9)


def test_a_flow_sensor_of_independent_errors_is_two_cameras() -> None:
    flows = only("front", "left", "right")
    cameras = {
        f"{name}_{i}": LineSensor(x=s.x, y=s.y, heading_deg=s.heading_deg + 90.0 * i)
        for name, s in flows.items()
        for i in range(2)
    }
    velocity = sensor_matrix(flows) @ TWIST + np.array((0.0, 0.02, 0.01, 0.0, -0.01, 0.03))
    variance = np.linspace(1e-4, 4e-4, 6)
    of_flows = TwistSolver(flows, 0.02).solve(velocity, np.diag(variance), (True,) * 3)
    of_cameras = TwistSolver(cameras, 0.02).solve(velocity, variance, (True,) * 6)
    for ours, theirs in zip(of_flows, of_cameras, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-15)


def test_a_camera_completes_one_flow_sensor() -> None:
    camera = {"side": LineSensor(x=0.0, y=0.5, heading_deg=0.0)}
    flows = only("front")
    settings = OdometryConfiguration(sensors=camera, flow_sensors=flows)
    estimate = LineScanOdometry(settings).update(flows_at(TWIST, flows))
    assert not estimate.measured
    assert "side: no lines arrived" in estimate.reason
    speed = sensor_matrix(camera) @ TWIST
    solver = TwistSolver(settings.all_sensors, 0.02)
    readings = np.concatenate((speed, sensor_matrix(flows) @ TWIST))
    twist, _ = solver.solve(readings, 1e-4 * np.eye(3), (True, True))
    np.testing.assert_allclose(twist, TWIST, atol=1e-12)


def test_one_flow_sensor_and_an_axle_suffice_unless_it_is_the_center_of_rotation() -> None:
    axle = KinematicsConfiguration(constraint="unsteered_axle", axle_x=-0.5)
    flows = only("front")
    rolling = np.array((1.2, 0.5 * 0.7, 0.7))
    settings = OdometryConfiguration(sensors={}, flow_sensors=flows, kinematics=axle)
    twist = LineScanOdometry(settings).update(flows_at(rolling, flows)).twist
    np.testing.assert_allclose(twist, rolling, atol=1e-9)
    on_axle = {"front": dataclasses.replace(flows["front"], x=-0.5, y=0.0)}
    with pytest.raises(ConfigurationError, match=r"pass through one point, \(-0.50, 0.00\)"):
        OdometryConfiguration(sensors={}, flow_sensors=on_axle, kinematics=axle)


@pytest.mark.parametrize("error", [(0.6, 0.0), (0.0, -0.6), (-0.5, 0.5)])
@pytest.mark.parametrize("faulty", list(CORNERS))
def test_four_isolate_the_faulty_one(faulty: str, error: tuple[float, float]) -> None:
    estimate = odometry(CORNERS).update(flows_at(TWIST, CORNERS, **{faulty: np.array(error)}))
    assert [name for name, flow in estimate.flows.items() if not flow.measured] == [faulty]
    assert f"{faulty}: contradicts the other sensors" in estimate.reason
    np.testing.assert_allclose(estimate.twist, TWIST, atol=1e-12)


def test_two_that_contradict_each_other_enlarge_the_covariance() -> None:
    """The two sensors measure velocities at which they would approach each other."""
    flows = only("front", "left")
    cos, sin = np.cos(np.radians(10.0)), np.sin(np.radians(10.0))
    wrong = np.array(((cos, sin), (-sin, cos))) @ (0.9, -0.4)  # away from each other
    estimate = odometry(flows).update(flows_at(TWIST, flows, front=wrong))
    assert estimate.measured
    error = estimate.twist - TWIST
    assert estimate.inflation > 64.0
    assert np.sqrt(error @ np.linalg.solve(estimate.covariance, error)) < 3.0


@pytest.mark.parametrize("seed", range(40))
def test_no_fault_of_one_of_three_is_accepted_with_a_small_covariance(seed: int) -> None:
    """An error along both axes may look like an error of another sensor; none is then excluded."""
    random = np.random.default_rng(seed)
    flows = only("front", "left", "right")
    faulty = str(random.choice(list(flows)))
    error = random.uniform(-3.0, 3.0) * random.normal(size=2)
    if seed % 2:  # the direction in which errors of front and left are equal
        bodily = np.array((CORNERS["right"].y - 0.1, 0.6 - CORNERS["right"].x))
        turn = np.radians(-10.0)
        cos, sin = np.cos(turn), np.sin(turn)
        faulty, error = "front", np.array(((cos, -sin), (sin, cos))) @ bodily
    estimate = odometry(flows).update(flows_at(TWIST, flows, **{faulty: error}))
    assert estimate.measured
    off = estimate.twist - TWIST
    sigmas = np.sqrt(off @ np.linalg.solve(estimate.covariance, off))
    assert sigmas < 10.0  # the limit of contradiction, 8, and two standard deviations of noise
    assert all(flow.measured for name, flow in estimate.flows.items() if name != faulty)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"velocity": np.array((np.nan, 0.0))}, "not finite"),
        ({"velocity": np.array((np.inf, 0.0))}, "not finite"),
        ({"covariance": np.full((2, 2), np.nan)}, "not finite"),
        ({"covariance": 1e6 * np.eye(2)}, "no measurement"),
        ({"covariance": np.array(((1e-4, 2e-4), (2e-4, 1e-4)))}, "positive definite"),
        ({"covariance": np.diag((1e-4, -1e-4))}, "positive definite"),
        ({"velocity": np.array((2.9, 1.0))}, "its maximum_speed of 3 m/s"),
    ],
)
def test_what_cannot_be_used_is_named(change: dict[str, Any], words: str) -> None:
    flows = only("front", "left", "right", maximum_speed=3.0)
    readings = flows_at(TWIST, flows)
    readings["left"] = dataclasses.replace(readings["left"], **change)
    estimate = odometry(flows).update(readings)
    assert words in estimate.flows["left"].reason
    np.testing.assert_allclose(estimate.twist, TWIST, atol=1e-12)


def test_a_jump_is_no_motion_until_it_has_lasted() -> None:
    flows = only("front", "left")
    subject = odometry(flows, maximum_acceleration=50.0)
    assert subject.update(flows_at(TWIST, flows)).measured
    beyond = np.array((5.0, 0.0))
    jump = subject.update(flows_at(TWIST, flows, PERIOD_NS, left=beyond))
    assert "changes by 5 m/s within 10 ms" in jump.reason
    later = subject.update(flows_at(TWIST + 2.0, flows, 12 * PERIOD_NS))
    assert later.measured, later.reason


def test_without_a_stated_covariance_the_configured_one_holds() -> None:
    flows = only("front", "left", deviation=0.03)
    readings = flows_at(TWIST, flows)
    unstated = {n: dataclasses.replace(f, covariance=np.zeros((2, 2))) for n, f in readings.items()}
    estimate = odometry(flows).update(unstated)
    np.testing.assert_array_equal(estimate.flows["left"].covariance, 0.03**2 * np.eye(2))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"flow_sensors": only("front")}, "there are 1: front (a flow sensor counts as two)"),
        (
            {"flow_sensors": only("front") | {"same": CORNERS["front"]}},
            "a rotation about it cannot be measured",
        ),
        (
            {
                "sensors": {"front": LineSensor(x=0.0, y=0.5, heading_deg=0.0)},
                "flow_sensors": only("front", "left"),
            },
            "flow_sensors.front: is also the name of a line camera",
        ),
    ],
)
def test_placements_that_do_not_suffice_are_refused(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(
        ConfigurationError, match="^" + ".*" + words.replace("(", r"\(").replace(")", r"\)")
    ):
        OdometryConfiguration(**{"sensors": {}, **settings})


def test_lines_under_the_name_of_a_flow_sensor_are_refused() -> None:
    lines = LineBatch(0, np.zeros((2, 64), np.uint8))
    with pytest.raises(LineBatchError, match="'front' is not one of the sensors"):
        odometry(only("front", "left")).update({"front": lines})


def groups_of(
    rate: float, phase_ns: int, *, flow_first: bool, until: int = 10
) -> list[tuple[int, int | None]]:
    """Return the stamps of camera and flow sensor in each group of one second."""
    subject = BatchCollector(("camera",), 0.005, {"flow": rate})
    flow_ns = round(1e9 / rate)
    events = [(i * PERIOD_NS, 1 - flow_first, "camera") for i in range(until)]
    for i in range(int(until * PERIOD_NS / flow_ns) + 1):
        stamp = i * flow_ns + phase_ns
        events.append((stamp, flow_first, "flow"))
    # Measurements with equal stamps may arrive in either order.
    events.sort(key=lambda event: (event[0], event[1]))
    groups = []
    for stamp, _, name in events:
        batch: Any = (
            Flow(stamp, np.zeros(2), np.eye(2))
            if name == "flow"
            else LineBatch(stamp, np.zeros((2, 64), np.uint8))
        )
        groups += subject.add(name, batch)
    return [
        (
            g["camera"].stamp_ns // 1_000_000,
            g["flow"].stamp_ns // 1_000_000 if "flow" in g else None,
        )
        for g in groups
    ]


@pytest.mark.parametrize("rate", [20.0, 50.0, 100.0, 200.0])
@pytest.mark.parametrize("phase_ns", [0, 3_000_000, -3_000_000])
def test_a_flow_sensor_follows_the_cameras_at_its_own_rate(rate: float, phase_ns: int) -> None:
    """Every group contains the flow measurement of its time, in any order of arrival."""
    first = groups_of(rate, phase_ns, flow_first=True)
    second = groups_of(rate, phase_ns, flow_first=False)
    both = min(len(first), len(second))
    assert both >= 8
    assert first[:both] == second[:both]
    flow_ms, phase_ms = 1000.0 / rate, phase_ns // 1_000_000
    for camera, flow in first:
        if flow is not None:
            assert abs(camera - flow) <= 5
        nearest = round((camera - phase_ms) / flow_ms) * flow_ms + phase_ms
        assert (flow is not None) == (abs(camera - nearest) <= 5)


def test_a_silent_flow_sensor_is_waited_for_once() -> None:
    subject = BatchCollector(("camera",), 0.005, {"flow": 100.0})
    sizes = [
        len(subject.add("camera", LineBatch(i * PERIOD_NS, np.zeros((2, 64), np.uint8))))
        for i in range(6)
    ]
    assert sizes == [0, 0, 3, 1, 1, 1]


def test_without_cameras_the_fastest_flow_sensors_lead() -> None:
    flows = only("front", "left") | only("right", rate=50.0)
    settings = OdometryConfiguration(sensors={}, flow_sensors=flows)
    subject = BatchCollector.of(settings)
    groups = []
    for i in range(4):
        for name, flow in flows_at(TWIST, flows, i * PERIOD_NS).items():
            if name != "right" or i % 2 == 0:
                groups += subject.add(name, flow)
    assert [list(group) for group in groups] == [
        ["front", "left", "right"],
        ["front", "left"],
        ["front", "left", "right"],
        ["front", "left"],
    ]


@pytest.mark.parametrize("rate", [20.0, 100.0])
@pytest.mark.parametrize("phase", np.linspace(0.0, 0.9, 10))
def test_sensors_that_are_read_at_different_times_measure_together(
    phase: float, rate: float
) -> None:
    """The times of reading differ by a share of the period, with a jitter of up to a tenth."""
    random = np.random.default_rng(round(10.0 * phase))
    flows = only("front", "left", rate=rate)
    subject = odometry(flows)
    collector = BatchCollector.of(OdometryConfiguration(sensors={}, flow_sensors=flows))
    period_ns = 1e9 / rate
    readings = [
        (round(period_ns * (i + shift + 0.1 * random.uniform())), name)
        for i in range(100)
        for name, shift in (("front", 0.0), ("left", phase))
    ]
    estimates = [
        subject.update(group)
        for stamp_ns, name in sorted(readings)
        for group in collector.add(name, flows_at(TWIST, flows, stamp_ns)[name])
    ]
    assert sum(estimate.measured for estimate in estimates) >= 98
    assert sum(not estimate.measured for estimate in estimates) <= 2


def test_played_again_it_begins_anew() -> None:
    flows = only("front", "left")
    subject = odometry(flows, maximum_acceleration=50.0)
    before: TwistEstimate = subject.update(flows_at(TWIST, flows, 50 * PERIOD_NS))
    again = subject.update(flows_at(-3.0 * TWIST, flows, 0))
    assert before.measured
    assert again.measured, again.reason
