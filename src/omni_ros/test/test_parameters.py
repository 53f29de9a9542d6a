"""A configuration declared on a node: values, ranges, and rejection of invalid values by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_ros.parameters import declare_configuration, refuse_unknown_parameters


class Wheel(Configuration):
    radius: float = parameter(description="Radius", unit="m", above=0.0)


class Cart(Configuration):
    name: str = parameter("cart", description="Name", choices=("cart", "trolley"))
    seats: int = parameter(1, description="Seats", minimum=0, maximum=4)
    gains: tuple[float, ...] = parameter((), description="Gains")
    wheels: Mapping[str, Wheel] = parameter(description="Wheels")


@pytest.fixture
def context() -> Iterator[Context]:
    context = Context()
    rclpy.init(context=context)
    yield context
    context.try_shutdown()


def declare(context: Context, values: dict[str, Any]) -> tuple[Node, Cart]:
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    node = Node("cart", context=context, parameter_overrides=overrides)
    return node, declare_configuration(node, Cart)


TWO_WHEELS = {"wheels.names": ["left", "right"], "wheels.left.radius": 0.1}
COMPLETE = {**TWO_WHEELS, "wheels.right.radius": 0.2}


def test_values_and_defaults_reach_the_configuration(context: Context) -> None:
    _, cart = declare(context, {**COMPLETE, "gains": [1.0, 2.5], "name": "trolley"})
    assert cart == Cart(
        name="trolley",
        gains=(1.0, 2.5),
        wheels={"left": Wheel(radius=0.1), "right": Wheel(radius=0.2)},
    )


def test_the_node_describes_its_parameters(context: Context) -> None:
    node, _ = declare(context, COMPLETE)
    seats = node.describe_parameter("seats")
    assert (seats.integer_range[0].from_value, seats.integer_range[0].to_value) == (0, 4)
    assert seats.read_only
    radius = node.describe_parameter("wheels.left.radius")
    assert radius.description == "Radius [m]"
    assert radius.floating_point_range[0].from_value == 0.0
    assert "cart, trolley" in node.describe_parameter("name").additional_constraints


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (TWO_WHEELS, r"^wheels\.right\.radius: is required"),
        ({**COMPLETE, "seats": 5}, r"^seats: is out of range"),
        ({**COMPLETE, "seats": "two"}, r"^seats: has the wrong type"),
        ({**COMPLETE, "name": "barrow"}, r"^name: 'barrow'"),
        ({**COMPLETE, "wheels.left.radius": 0.0}, r"^wheels\.left\.radius: 0"),
        ({**COMPLETE, "gains": ["high"]}, r"^gains: has the wrong type"),
        ({**COMPLETE, "wheels.left.radius": 0}, r"^wheels\.left\.radius: 0"),
        ({**COMPLETE, "wheels.left.radius": True}, r"^wheels\.left\.radius: has the wrong type"),
    ],
)
def test_a_parameter_that_does_not_fit_is_refused_by_name(
    context: Context, values: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigurationError, match=words) as refused:
        declare(context, values)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"seat": 2}, "^seat: is not a parameter of cart; did you mean 'seats'"),
        ({"wheels.left.radus": 0.1}, "did you mean 'wheels.left.radius'"),
        ({"wheels.middle.radius": 0.1}, "^wheels.middle.radius: is not a parameter of cart"),
    ],
)
def test_a_parameter_that_the_node_does_not_have_is_refused(
    context: Context, values: dict[str, Any], words: str
) -> None:
    node, _ = declare(context, {**COMPLETE, **values})
    with pytest.raises(ConfigurationError, match=words):
        refuse_unknown_parameters(node)


def test_parameters_of_ros_itself_are_known(context: Context) -> None:
    values = {
        "use_sim_time": True,
        "start_type_description_service": False,
        "qos_overrides./clock.subscription.depth": 5,
    }
    node, _ = declare(context, {**COMPLETE, **values})
    refuse_unknown_parameters(node)


def test_whole_numbers_are_taken_where_numbers_are_declared(context: Context) -> None:
    node, cart = declare(context, {**COMPLETE, "wheels.left.radius": 1, "gains": [1, 2]})
    assert cart.wheels["left"].radius == 1.0
    assert cart.gains == (1.0, 2.0)
    assert node.get_parameter("wheels.left.radius").type_ == Parameter.Type.DOUBLE
    described = node.describe_parameter("wheels.left.radius")
    assert described.type == Parameter.Type.DOUBLE.value
    assert described.floating_point_range[0].from_value == 0.0
    assert described.read_only
    assert not described.dynamic_typing


def test_a_running_node_keeps_the_configuration_it_started_with(context: Context) -> None:
    node, _ = declare(context, COMPLETE)
    (result,) = node.set_parameters([Parameter("seats", value=2)])
    assert not result.successful
    assert node.get_parameter("seats").value == 1
