"""The vehicle brakes if the source of demands stops sending, for any reason."""

from __future__ import annotations

import math

import pytest

from omni_tools.drive.demand_source import REST, DemandSource
from omni_tools.drive.server import Demand, PageError, parse_demand

FORWARD = (3.0, 0.0, 0.0)
LEFT = (0.0, 1.0, 0.0)


@pytest.fixture
def source() -> DemandSource:
    return DemandSource(page_timeout=0.3, command_timeout=1.0)


def brakes(source: DemandSource, now: float) -> bool:
    demand = source.demand(now)
    if demand.pedal == 1.0:
        assert demand.twist == REST
    return demand.pedal == 1.0


def test_without_a_source_it_brakes(source: DemandSource) -> None:
    assert brakes(source, 0.0)


def test_a_page_drives_only_while_it_sends_demands(source: DemandSource) -> None:
    source.open_page()
    assert brakes(source, 0.0)
    source.take_page(0.0, FORWARD, 0.0)
    assert source.demand(0.29).twist == FORWARD
    assert brakes(source, 0.31)
    source.take_page(0.25, FORWARD, 1.0)
    assert source.demand(1.0).pedal == 0.25


def test_closing_the_page_brakes_at_once_and_until_somebody_means_to_drive(
    source: DemandSource,
) -> None:
    source.open_page()
    source.take_page(0.0, FORWARD, 0.0)
    source.take_command(LEFT, 0.0)
    source.close_page()
    assert brakes(source, 0.0)
    source.take_command(LEFT, 0.1)  # a key that is kept down
    assert brakes(source, 0.1)
    source.take_command(REST, 0.2)
    source.take_command(LEFT, 0.3)
    assert source.demand(0.3).twist == LEFT
    source.open_page()
    assert brakes(source, 0.3)  # demands of the previous page are ignored


def test_cmd_vel_drives_without_a_page_while_it_is_repeated(source: DemandSource) -> None:
    source.take_command(FORWARD, 0.0)
    demand = source.demand(0.9)
    assert (demand.pedal, demand.twist, demand.source) == (0.0, FORWARD, "cmd_vel")
    assert brakes(source, 1.1)


def test_an_idle_page_leaves_cmd_vel_the_wheel_but_keeps_the_pedal(source: DemandSource) -> None:
    source.open_page()
    source.take_page(0.0, REST, 0.0)
    source.take_command(LEFT, 0.0)
    assert source.demand(0.0).twist == LEFT
    source.take_page(0.0, FORWARD, 0.1)
    assert source.demand(0.1).twist == FORWARD
    source.take_page(1.0, REST, 0.2)
    assert brakes(source, 0.2)
    source.take_page(0.0, REST, 0.3)
    assert brakes(source, 0.7)  # cmd_vel does not override a silent page


def test_a_cmd_vel_that_is_no_number_counts_as_none(source: DemandSource) -> None:
    source.take_command((math.nan, 0.0, 0.0), 0.0)
    assert brakes(source, 0.0)


def test_a_page_asks_for_no_more_than_there_is() -> None:
    text = '{"pedal": 7, "stick": [-9, 0.5, 1], "assist": false, "reset": 3}'
    assert parse_demand(text) == Demand(1.0, (-1.0, 0.5, 1.0), assist=False, reset=3)
    assert parse_demand('{"pedal": 0, "stick": [0, 0, 0]}') == Demand(0.0, (0.0, 0.0, 0.0))
    chosen = parse_demand('{"pedal": 0, "stick": [0, 0, 0], "choose": ["ground", "cork"]}').choose
    assert chosen == ("ground", "cork")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "null",
        "{}",
        '{"pedal": 0}',
        '{"pedal": "1", "stick": [0, 0, 0]}',
        '{"pedal": true, "stick": [0, 0, 0]}',
        '{"pedal": NaN, "stick": [0, 0, 0]}',
        '{"pedal": 0, "stick": [0, 0]}',
        '{"pedal": 0, "stick": [0, 0, Infinity]}',
        '{"pedal": 0, "stick": [0, 0, 0], "assist": 1}',
        '{"pedal": 0, "stick": [0, 0, 0], "reset": true}',
        '{"pedal": 0, "stick": [0, 0, 0], "reset": 1.5}',
        '{"pedal": 0, "stick": [0, 0, 0], "choose": ["ground"]}',
        '{"pedal": 0, "stick": [0, 0, 0], "choose": [1, "cork"]}',
        '{"pedal": 0, "stick": [0, 0, 0], "choose": "law"}',
        b"\xff",
        "[" * 1000,
    ],
)
def test_what_makes_no_sense_is_refused(text: str | bytes) -> None:
    with pytest.raises(PageError):
        parse_demand(text)
