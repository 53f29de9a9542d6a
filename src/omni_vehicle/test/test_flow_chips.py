"""Flow chips read through their makers' libraries from models of their registers."""

from __future__ import annotations

import enum
import math
import struct
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_vehicle import flow_chips
from omni_vehicle.flow_chips import (
    FlowChipConfiguration,
    FlowChipError,
    open_chip,
)

IMAGE_RATE = 121.0
PERIOD = 0.25 / IMAGE_RATE
COUNTS_PER_METER = 4000.0


class SpiFlowChip:
    """Registers of a PMW3901 or PAA5100 on SPI: identity, orientation, motion burst.

    The chip takes images at a fixed rate, and its counts change at images only.

    Attributes:
        velocity: velocity of the ground under the chip, in the chip's axes [m/s].
    """

    board: SpiFlowChip
    plugged = True

    def __init__(self) -> None:
        type(self).board = self
        self.velocity, self.quality, self.shutter = (0.0, 0.0), 80, 0x02
        self._path, self._counted, self._read = np.zeros(2), np.zeros(2, int), np.zeros(2, int)
        self._clock = 0.4 / IMAGE_RATE  # since the last image [s]
        self.power_up()

    def power_up(self) -> None:
        self.registers = {0x00: 0x49, 0x01: 0x00}

    def open(self, port: int, select: int) -> None:
        del port, select

    def pass_time(self, seconds: float) -> None:
        velocity = COUNTS_PER_METER * np.array(self.velocity)
        self._path = self._path + velocity * seconds
        self._clock += seconds
        if self._clock >= 1.0 / IMAGE_RATE:
            self._clock %= 1.0 / IMAGE_RATE
            self._counted = np.floor(self._path - velocity * self._clock).astype(int)

    def xfer2(self, words: list[int]) -> list[int]:
        if not self.plugged:
            return [0xFF] * len(words)  # the line is pulled up
        address = words[0]
        if address & 0x80:
            self.registers[address & 0x7F] = words[1]
            return [0, 0]
        if address == 0x16 and len(words) == 13:
            return self._burst()
        return [0, self.registers.get(address, 0)]

    def _burst(self) -> list[int]:
        orientation = self.registers.get(0x5B, 0)
        x, y = (int(count) for count in self._counted - self._read)
        self._read = self._counted
        if orientation & 0x80:
            x, y = y, x
        x, y = x * (-1) ** (orientation >> 5 & 1), y * (-1) ** (orientation >> 6 & 1)
        motion = 0x80 if x or y else 0x00
        fields = (0, motion, 0, x, y, self.quality, 0, 0, 0, self.shutter, 0)
        return list(struct.pack("<BBBhhBBBBBB", *fields))


class I2cOtos:
    """Registers of an OTOS board on I2C; values are set in SI units."""

    i2cbus = True

    def __init__(self) -> None:
        self.plugged, self.status = True, 0
        self.heading, self.velocity = 0.0, (0.0, 0.0, 0.0)
        self.written: dict[int, int] = {}
        self.blocks: dict[int, list[int]] = {}

    def isDeviceConnected(self, address: int) -> bool:  # noqa: N802 (the library's name)
        return self.plugged and address == 0x17

    def read_byte(self, _address: int, register: int) -> int:
        self._answer()
        return {0x00: 0x5F, 0x1F: self.status}.get(register, self.written.get(register, 0))

    readByte = read_byte  # noqa: N815

    def write_byte(self, _address: int, register: int, value: int) -> None:
        self._answer()
        self.written[register] = value

    def read_block(self, _address: int, register: int, length: int) -> list[int]:
        self._answer()
        if register in self.blocks:
            return self.blocks[register][:length]
        assert register == 0x20
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        x, y, rate = self.velocity
        world = (cos * x - sin * y, sin * x + cos * y)
        scale = (32768 / 5.0, 32768 / math.radians(2000.0))  # 5 m/s, 2000 deg/s full scale
        words = [0, 0, round(self.heading * 32768 / math.pi)]
        words += [round(world[0] * scale[0]), round(world[1] * scale[0]), round(rate * scale[1])]
        words += [0] * 6 + [0] * 3 + [0] * 3
        return list(struct.pack("<18h", *words))[:length]

    def write_block(self, _address: int, register: int, values: list[int]) -> None:
        self._answer()
        self.blocks[register] = list(values)

    def _answer(self) -> None:
        if not self.plugged:
            raise OSError(121, "Remote I/O error")


@pytest.fixture
def spi(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the SPI bus of the kernel by the model."""

    class Direction(enum.Enum):
        OUTPUT = 1

    class Value(enum.Enum):
        INACTIVE, ACTIVE = 0, 1

    modules = {
        "spidev": SimpleNamespace(SpiDev=SpiFlowChip),
        "gpiod": SimpleNamespace(LineSettings=lambda **_: None),
        "gpiod.line": SimpleNamespace(Direction=Direction, Value=Value),
        "gpiodevice": SimpleNamespace(),
    }
    for name, contents in modules.items():
        module = ModuleType(name)
        module.__dict__.update(vars(contents))
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, "pmw3901", raising=False)
    pytest.importorskip("pmw3901", reason="requirements/flow.lock is not installed")


@pytest.fixture
def registers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the maker's library by a class that gives access to the registers."""

    class Chip:
        def __init__(self, *_: int) -> None:
            self.spi_dev = SpiFlowChip()

        def set_orientation(self, **_: bool) -> None:
            pass

    library = ModuleType("pmw3901")
    library.__dict__.update(PMW3901=Chip, PAA5100=Chip)
    monkeypatch.setitem(sys.modules, "pmw3901", library)


class Bench:
    """A chip that is read at a rate over a moving ground."""

    def __init__(self, **changes: Any) -> None:
        given: dict[str, Any] = {"chip": "pmw3901", "counts_per_meter": COUNTS_PER_METER} | changes
        self.configuration = FlowChipConfiguration(**given)
        self.chip = open_chip(self.configuration)
        self.board, self.time = SpiFlowChip.board, 0.0
        self.chip.read(self.time)

    def poll(self, period: float = PERIOD) -> flow_chips.FlowSample | None:
        self.board.pass_time(period)
        self.time += period
        return self.chip.read(self.time)

    def read(self, period: float = PERIOD) -> flow_chips.FlowSample:
        """Read until there is a sample, and return it."""
        samples = (self.poll(period) for _ in range(10))
        return next(sample for sample in samples if sample is not None)


@pytest.mark.usefixtures("spi")
@pytest.mark.parametrize("chip", ["pmw3901", "paa5100"])
@pytest.mark.parametrize("period", [PERIOD, 0.003, 0.007, 0.01, 0.02])
def test_counts_become_a_velocity_with_the_stated_deviation(chip: str, period: float) -> None:
    bench = Bench(chip=chip, relative_deviation=0.0)
    bench.board.velocity = (0.613, -0.277)
    bench.read(period)
    samples = [bench.read(period) for _ in range(400)]
    errors = np.array([sample.velocity[:2] - bench.board.velocity for sample in samples])
    stated = np.mean([sample.deviation[0] ** 2 for sample in samples])
    # Unknown images scale both axes alike: the sum of the squares is that of the speed.
    assert 0.3 * stated < np.mean(np.sum(errors**2, axis=1)) / 2.0 < 1.5 * stated
    if period < 1.0 / IMAGE_RATE:  # the number of images is known
        rounding = IMAGE_RATE / COUNTS_PER_METER / math.sqrt(6.0)
        assert stated == pytest.approx(rounding**2)
    np.testing.assert_allclose(errors.mean(axis=0), 0.0, atol=3e-3)
    assert np.isnan(samples[-1].velocity[2])  # one chip measures no yaw rate


def late(random: np.random.Generator) -> float:
    """Return a period that is sometimes several images long, as on a loaded computer."""
    return float(random.uniform(1.0, 3.0) / IMAGE_RATE if random.random() < 0.03 else PERIOD)


POLLS: dict[str, Callable[[np.random.Generator], float]] = {
    "four for an image": lambda _: PERIOD,
    "3 ms": lambda _: 0.003,
    "7 ms": lambda _: 0.007,
    "one for an image": lambda _: 1.0 / IMAGE_RATE,
    "10 ms": lambda _: 0.01,
    "20 ms": lambda _: 0.02,
    "jitter": lambda random: PERIOD * float(random.uniform(0.5, 1.5)),
    "long jitter": lambda random: 0.007 * float(random.uniform(0.6, 1.4)),
    "late": late,
}


@pytest.mark.usefixtures("registers")
@pytest.mark.parametrize("poll", POLLS)
@pytest.mark.parametrize("counts_per_image", [0.1, 0.49, 0.97, 1.3, 6.0])
def test_counts_and_zeros_add_up_to_the_motion(counts_per_image: float, poll: str) -> None:
    bench = Bench(relative_deviation=0.0)
    speed = counts_per_image * IMAGE_RATE / COUNTS_PER_METER
    bench.board.velocity = (speed * math.cos(0.4), -speed * math.sin(0.4))
    random, duration = np.random.default_rng(1), max(10.0, 600.0 / (counts_per_image * IMAGE_RATE))
    samples: list[tuple[float, flow_chips.FlowSample]] = []
    while bench.time < duration:
        sample = bench.poll(POLLS[poll](random))
        if sample is not None:
            samples.append((bench.time, sample))
    times = np.array([time for time, _ in samples])
    velocities = np.array([sample.velocity[:2] for _, sample in samples])
    elapsed = np.diff(times)[:, np.newaxis]
    # Held until the next reading, and integrated over the time since the last one.
    for mean in (velocities[:-1], velocities[1:]):
        distance = np.sum(mean * elapsed, axis=0)
        np.testing.assert_allclose(
            distance / (times[-1] - times[0]), bench.board.velocity, atol=0.05 * speed
        )
    # A rounded value has at most 1.5 times the variance of its mean over all fractions.
    errors = np.sum((velocities - bench.board.velocity) ** 2, axis=1) / 2.0
    stated = np.mean([sample.deviation[0] ** 2 for _, sample in samples])
    assert np.mean(errors) < 1.6 * stated


@pytest.mark.usefixtures("registers")
@pytest.mark.parametrize("speed", [0.005, 0.05, 0.5])
@pytest.mark.parametrize("period", [PERIOD, 0.003, 0.007, 0.01, 0.02])
def test_a_stop_is_measured_within_an_image_and_a_reading(speed: float, period: float) -> None:
    bench = Bench()
    bench.board.velocity = (speed, 0.0)
    for _ in range(500):
        bench.poll(period)
    bench.board.velocity, stopped = (0.0, 0.0), bench.time
    while (sample := bench.poll(period)) is None or sample.velocity[0] != 0.0:
        # The last counts may come one image after the stop, at the end of a reading.
        assert bench.time - stopped < 3.0 * (1.0 / IMAGE_RATE + period)


@pytest.mark.usefixtures("spi")
def test_rest_is_measured_and_a_dark_or_plain_ground_is_not() -> None:
    bench = Bench()
    at_rest = bench.read()
    assert at_rest.problem == ""
    np.testing.assert_array_equal(at_rest.velocity[:2], 0.0)
    bench.board.quality = 10
    assert "quality 10" in bench.read().problem
    bench.board.quality, bench.board.shutter = 80, 0x1F
    sample = bench.read()
    assert "exposure" in sample.problem
    assert np.all(np.isnan(sample.velocity))


@pytest.mark.usefixtures("spi")
def test_what_is_faster_than_the_chip_is_no_measurement() -> None:
    bench = Bench(maximum_speed=1.0)
    bench.board.velocity = (1.5, 0.0)
    bench.read()  # between two images of which one was taken at rest
    assert "m/s exceeds maximum_speed" in bench.read().problem


@pytest.mark.usefixtures("spi")
def test_counts_over_a_gap_are_no_velocity_but_count_as_distance() -> None:
    bench = Bench()
    bench.board.velocity = (0.5, 0.0)
    bench.board.pass_time(0.5)
    bench.time += 0.5
    assert "no reading for 0.5 s" in bench.read().problem
    assert bench.chip.counts[0] == pytest.approx(0.5 * 0.5 * COUNTS_PER_METER, abs=20)  # type: ignore[attr-defined]
    assert bench.read().velocity[0] == pytest.approx(0.5, abs=0.03)


@pytest.mark.usefixtures("spi")
def test_axes_are_set_in_the_chip() -> None:
    bench = Bench(swap_xy=True, invert_y=True)
    bench.board.velocity = (0.5, 0.25)
    bench.read()
    np.testing.assert_allclose(bench.read().velocity[:2], (0.25, -0.5), atol=0.03)


@pytest.mark.usefixtures("spi")
def test_an_unplugged_chip_is_noticed_at_once_and_opened_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench()
    monkeypatch.setattr(SpiFlowChip, "plugged", False)
    with pytest.raises(FlowChipError, match="lost"):
        bench.read()
    with pytest.raises(FlowChipError, match="does not answer"):
        open_chip(bench.configuration)
    monkeypatch.setattr(SpiFlowChip, "plugged", True)
    # The power returned within a period: the chip responds, but has lost its settings.
    again = Bench(invert_x=True)
    again.board.power_up()
    with pytest.raises(FlowChipError, match="reset"):
        again.read()


def test_a_missing_bus_driver_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "pmw3901.py").write_text("import gpiod\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "pmw3901", raising=False)
    monkeypatch.setitem(sys.modules, "gpiod", None)
    given = FlowChipConfiguration(chip="paa5100", counts_per_meter=COUNTS_PER_METER)
    with pytest.raises(ConfigurationError, match=r"gpiod.* pip install pmw3901 spidev gpiod gpiod"):
        open_chip(given)


@pytest.mark.usefixtures("spi")
def test_the_scale_must_be_measured() -> None:
    with pytest.raises(ConfigurationError, match="counts_per_meter"):
        FlowChipConfiguration(chip="paa5100")


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch) -> Iterator[I2cOtos]:
    """Return the only board, which is connected to bus 3."""
    pytest.importorskip("qwiic_otos", reason="requirements/flow.lock is not installed")
    found = I2cOtos()
    absent = SimpleNamespace(i2cbus=None)
    monkeypatch.setattr(
        "qwiic_i2c.get_i2c_driver",
        lambda iBus: found if iBus == 3 else absent,  # noqa: N803
    )
    flow_chips._i2c_driver.cache_clear()
    yield found
    flow_chips._i2c_driver.cache_clear()


def otos(bus: int = 3) -> flow_chips.FlowChip:
    return open_chip(FlowChipConfiguration(chip="otos", i2c_bus=bus))


def sampled(chip: flow_chips.FlowChip) -> flow_chips.FlowSample:
    sample = chip.read(0.0)
    assert sample is not None
    return sample


def test_each_otos_has_its_own_bus(board: I2cOtos) -> None:
    board.velocity = (0.3, 0.0, 0.0)
    assert sampled(otos(3)).velocity[0] == pytest.approx(0.3, abs=2e-3)
    with pytest.raises(FlowChipError, match="I2C bus 1 cannot be opened"):
        otos(1)


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.5])
def test_an_otos_reports_in_its_own_axes_whatever_its_heading(
    heading: float, board: I2cOtos
) -> None:
    chip = otos()
    board.heading, board.velocity = heading, (1.2, -0.4, 0.8)
    sample = sampled(chip)
    np.testing.assert_allclose(sample.velocity, board.velocity, atol=2e-3)
    assert np.all(sample.deviation > 0.0)


def test_an_otos_gets_its_scalars_and_its_offset(board: I2cOtos) -> None:
    assert not board.blocks
    otos()
    assert set(*board.blocks.values()) == {0}  # the offset of another program is removed
    given = FlowChipConfiguration(
        chip="otos",
        i2c_bus=3,
        linear_scalar=1.05,
        angular_scalar=0.9622,
        offset_x=0.1,
        offset_y=-0.05,
        offset_heading_deg=-90.0,
    )
    library = open_chip(given)._chip  # type: ignore[attr-defined]
    assert library.getLinearScalar() == pytest.approx(1.05, abs=1e-3)
    assert library.getAngularScalar() == pytest.approx(0.9622, abs=1e-3)
    offset = library.getOffset()
    assert (offset.x, offset.y) == pytest.approx((0.1, -0.05), abs=1e-3)
    assert math.degrees(offset.h) == pytest.approx(-90.0, abs=0.1)


def test_an_otos_that_warns_or_fails_measures_nothing(board: I2cOtos) -> None:
    chip = otos()
    board.status = 0x02
    assert "poor tracking" in sampled(chip).problem
    board.status = 0x80
    with pytest.raises(FlowChipError, match="failure"):
        chip.read(0.0)
    board.plugged = False
    with pytest.raises(FlowChipError, match="bus failed"):
        chip.read(0.0)
