"""The node of a flow chip publishes its readings, and reopens a chip after a failure."""

from __future__ import annotations

import itertools
import json
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np
import pytest
from bystander import Bystander, node_process
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistWithCovarianceStamped
from omni_process import WORKSPACE

from omni_core.sensors import FlowSensor, sensor_matrix
from omni_ros.environment import node_environment
from omni_ros.messages import to_nanoseconds, twist_of
from omni_ros.qos import RELIABLE
from omni_runs.experiment import ExperimentLibrary
from omni_runs.graph import nodes as graph
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.process_group import ProcessGroup
from omni_runs.yaml_files import read_mapping

# A chip that is unplugged after seven readings, the fourth of which is of a dark ground. Each time
# that it is opened, it moves faster.
PROGRAM = """
import numpy as np
from omni_vehicle import flow_chips, flow_sensor_node


class Chip:
    opened = 0

    def __init__(self, configuration):
        Chip.opened += 1
        self.readings = 0

    def read(self, time):
        self.readings += 1
        if self.readings == 8:
            raise flow_chips.FlowChipError("the bus failed")
        if self.readings == 4:
            return flow_chips.FlowSample.unmeasured("surface quality 3")
        velocity = np.array([0.1 * Chip.opened, -0.2, np.nan])
        return flow_chips.FlowSample(velocity, np.array([0.01, 0.02, np.nan]), "")


flow_chips.open_chip = Chip
raise SystemExit(flow_sensor_node.main())
"""
RETRY_NS = 300_000_000

# A model of the registers of a chip in place of its bus; the chip moves with a velocity.
BOARD = """
import sys
import time
from types import SimpleNamespace

folder, *velocity = sys.argv[1:5]
del sys.argv[1:5]
sys.path.insert(0, folder)
from test_flow_chips import I2cOtos, SpiFlowChip

velocity = tuple(map(float, velocity))


class Spi(SpiFlowChip):
    def __init__(self):
        super().__init__()
        self.velocity, self.last = velocity[:2], time.monotonic()

    def xfer2(self, words):
        now = time.monotonic()
        self.pass_time(now - self.last)
        self.last = now
        return super().xfer2(words)


def board(iBus):
    found = I2cOtos()
    found.heading, found.velocity = 0.1 * iBus, velocity
    return found


sys.modules["spidev"] = SimpleNamespace(SpiDev=Spi)
values = SimpleNamespace(INACTIVE=0, ACTIVE=1)
line = SimpleNamespace(Direction=SimpleNamespace(OUTPUT=1), Value=values)
sys.modules["gpiod.line"] = line
sys.modules["gpiod"] = SimpleNamespace(LineSettings=lambda **_: None, line=line)
sys.modules["gpiodevice"] = SimpleNamespace()

import qwiic_i2c
from omni_vehicle import flow_sensor_node

qwiic_i2c.get_i2c_driver = board
raise SystemExit(flow_sensor_node.main())
"""
TWIST = np.array((0.5, -0.2, 0.3))
SENSORS = {
    "left": FlowSensor(x=0.1, y=0.4, heading_deg=90.0),
    "right": FlowSensor(x=-0.2, y=-0.4, heading_deg=-30.0),
}


class Listener(Bystander):
    """The odometry that receives the readings."""

    def __init__(self, domain: int) -> None:
        super().__init__("listener", domain)
        self.twists: list[TwistWithCovarianceStamped] = []
        self.reports: set[str] = set()
        listen = self.node.create_subscription
        listen(TwistWithCovarianceStamped, "flow/left/twist", self.twists.append, RELIABLE)
        listen(DiagnosticArray, "/diagnostics", self._read, RELIABLE)

    def _read(self, message: DiagnosticArray) -> None:
        self.reports |= {status.message for status in message.status}

    def description(self) -> str:
        return f"{len(self.twists)} twists, {self.reports}"


def test_a_lost_chip_is_reported_and_opened_again() -> None:
    words = ["sensor:=left", "chip:=otos", f"retry_period:={1e-9 * RETRY_NS}"]
    parameters = itertools.chain.from_iterable(("-p", word) for word in words)
    with (
        reserved_domain() as domain,
        node_process(domain, "-c", PROGRAM, "--ros-args", *parameters),
        closing(Listener(domain)) as listener,
    ):
        listener.wait(lambda: len(listener.twists) > 28)
        listener.wait(lambda: "the bus failed; trying again" in listener.reports)
        listener.wait(lambda: "surface quality 3" in listener.reports)
    assert {message.header.frame_id for message in listener.twists} == {"left"}
    opened: dict[int, int] = {}  # stamp of the first reading by number of the opening
    unmeasured = 0
    for message in listener.twists:
        _, twist, covariance, _ = twist_of(message)
        assert covariance[2, 2] == 1e6
        if covariance[0, 0] == 1e6:
            unmeasured += 1
            continue
        assert twist[1] == -0.2
        np.testing.assert_allclose(np.diag(covariance)[:2], (1e-4, 4e-4))
        opened.setdefault(round(10.0 * twist[0]), to_nanoseconds(message.header.stamp))
    assert unmeasured > 0
    assert len(opened) >= 4
    # No message while the chip is away: the assistant brakes all wheels after its timeout.
    # The listener may have missed the first readings of the first opening.
    for before, after in itertools.pairwise(sorted(opened.values())[1:]):
        assert after - before > 0.9 * RETRY_NS


class Vehicle(Bystander):
    """The assistant, which receives the twist of the odometry."""

    def __init__(self, domain: int) -> None:
        super().__init__("vehicle", domain)
        self.twists: list[tuple[np.ndarray, np.ndarray]] = []
        self.node.create_subscription(
            TwistWithCovarianceStamped,
            "odometry/twist",
            lambda message: self.twists.append(twist_of(message)[1:3]),
            RELIABLE,
        )

    def description(self) -> str:
        return f"{len(self.twists)} twists"


def test_two_chips_of_different_types_measure_the_twist_of_the_vehicle(tmp_path: Path) -> None:
    pytest.importorskip("qwiic_otos", reason="requirements/flow.lock is not installed")
    experiment = read_mapping(WORKSPACE / "config/experiments/flow_sensors.yaml", "experiment")
    experiment["flow_sensors"] = {name: vars(sensor) for name, sensor in SENSORS.items()}
    file = tmp_path / "two.yaml"
    file.write_text(json.dumps(experiment))
    configuration = ExperimentLibrary(WORKSPACE / "config").load(str(file), "assisted")
    odometry = graph.Nodes(configuration, tmp_path, lockstep=False).odometry(listeners=1)
    velocities = (sensor_matrix(SENSORS) @ TWIST).reshape(-1, 2)
    models = str(WORKSPACE / "src/omni_vehicle/test")
    with (
        reserved_domain() as domain,
        ProcessGroup(node_environment(domain)) as group,
        ExitStack() as stack,
    ):
        for bus, (name, (v_x, v_y)) in enumerate(zip(SENSORS, velocities, strict=True), 1):
            moving = [models, str(v_x), str(v_y), str(TWIST[2])]
            chip = "otos" if bus == 1 else "pmw3901"
            words = [f"sensor:={name}", f"chip:={chip}", f"i2c_bus:={bus}"]
            words += ["counts_per_meter:=4000.0"]
            parameters = itertools.chain.from_iterable(("-p", word) for word in words)
            given = "-c", BOARD, *moving, "--ros-args", *parameters
            stack.enter_context(node_process(domain, *given))
        group.start(odometry)
        with closing(Vehicle(domain)) as vehicle:
            vehicle.wait(lambda: sum(c[0, 0] < 1.0 for _, c in vehicle.twists) > 50)
    measured = [(t, np.diag(c)) for t, c in vehicle.twists if c[0, 0] < 1.0]
    twists, variances = (np.array(values) for values in zip(*measured, strict=True))
    # A reading that comes late covers an unknown number of images, which its variance includes.
    assert np.mean(np.abs(twists - TWIST) < 5.0 * np.sqrt(variances)) > 0.9
    np.testing.assert_allclose(np.median(twists, axis=0), TWIST, atol=0.05)
