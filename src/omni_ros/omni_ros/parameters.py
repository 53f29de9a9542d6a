"""Declaration of a component's configuration as ROS parameters."""

import sys
import typing
from collections.abc import Collection, Mapping
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy import exceptions
from rclpy.node import Node
from rclpy.parameter import Parameter

from omni_core import configuration as declared
from omni_core.configuration import Configuration, ConfigurationError, ParameterInfo
from omni_ros.flat_parameters import unflatten

C = TypeVar("C", bound=Configuration)

# Parameters of rclpy that are declared only where they are used.
_OF_RCLPY = ("use_sim_time", "start_type_description_service")
_OF_RCLPY_BELOW = "qos_overrides."


def declare_configuration(node: Node, cls: type[C], changeable: Collection[str] = ()) -> C:
    """Declare every field of a configuration as a parameter of the node; return the values.

    The parameters have descriptors (description, unit, range). A node is configured when it starts,
    so the parameters that are not in `changeable` are read-only.

    Args:
        node: node on which the parameters are declared.
        cls: the configuration; nested fields become dotted names, see
            `omni_ros.flat_parameters`.
        changeable: names of the parameters that can be changed while the node runs.

    Raises:
        ConfigurationError: a parameter is missing, of the wrong type or out of range.
    """

    def read(key: str, kind: Any, default: Any, info: ParameterInfo) -> Any:
        return _declare(node, key, kind, default, _descriptor(kind, info, key not in changeable))

    return unflatten(cls, read)


def refuse_unknown_parameters(node: Node) -> None:
    """Raise an error if values are given for parameters that the node does not have.

    Without this check, a value with a mistyped name would be ignored, and the default would be
    used. Call this function after the node has declared all configurations.

    Args:
        node: the node.

    Raises:
        ConfigurationError: a parameter is unknown; the message names it and the most similar known
            parameter.
    """
    for name in _given(node):
        known = node.has_parameter(name) or name in _OF_RCLPY or name.startswith(_OF_RCLPY_BELOW)
        if not known:
            names = [key for key in node.get_parameters_by_prefix("") if key not in _OF_RCLPY]
            hint = declared.did_you_mean(name, names)
            raise ConfigurationError(name, f"is not a parameter of {node.get_name()}{hint}")


def _given(node: Node) -> Mapping[str, Parameter]:
    """Return the parameter values from files and command-line arguments, keyed by name."""
    given: Mapping[str, Parameter] = node._parameter_overrides  # rclpy has no public access
    return given


def _declare(node: Node, key: str, kind: Any, default: Any, descriptor: ParameterDescriptor) -> Any:
    """Declare a parameter of a node, and return its value; the default if no value is given."""
    doubles = _whole_numbers_as_doubles(_given(node).get(key), kind)
    try:
        if doubles is not None:
            node.declare_parameter(key, doubles, descriptor, ignore_override=True)
        elif default is None or isinstance(default, tuple):
            # Arrays are declared by type, because an empty one would become an array of bytes.
            node.declare_parameter(key, _parameter_type(kind), descriptor)
        else:
            node.declare_parameter(key, default, descriptor)
        value = node.get_parameter(key).value
    except exceptions.ParameterUninitializedException:
        value = None
    except exceptions.InvalidParameterTypeException as error:
        raise ConfigurationError(key, f"has the wrong type: {error}") from None
    except exceptions.InvalidParameterValueException as error:
        raise ConfigurationError(key, f"is out of range: {error}") from None
    return default if value is None else value


def _whole_numbers_as_doubles(given: Parameter | None, kind: Any) -> Any:
    """Return integers, given for a parameter that consists of doubles, as doubles.

    In all other cases, the result is None. Without this conversion, ROS would reject an integer
    such as 1 for a double.
    """
    if given is not None:
        if kind is float and given.type_ == Parameter.Type.INTEGER:
            return float(given.value)
        if kind == tuple[float, ...] and given.type_ == Parameter.Type.INTEGER_ARRAY:
            return [float(entry) for entry in given.value]
    return None


def _parameter_type(kind: Any) -> Parameter.Type:
    plain = {
        bool: Parameter.Type.BOOL,
        int: Parameter.Type.INTEGER,
        float: Parameter.Type.DOUBLE,
        str: Parameter.Type.STRING,
    }
    if typing.get_origin(kind) is tuple:
        arrays = {float: Parameter.Type.DOUBLE_ARRAY, str: Parameter.Type.STRING_ARRAY}
        return arrays[typing.get_args(kind)[0]]
    return plain[kind]


def _descriptor(kind: Any, info: ParameterInfo, read_only: bool) -> ParameterDescriptor:
    unit = f" [{info.unit}]" if info.unit else ""
    descriptor = ParameterDescriptor(description=info.description + unit, read_only=read_only)
    if info.choices is not None:
        descriptor.additional_constraints = "one of: " + ", ".join(info.choices)
    lower = info.minimum if info.minimum is not None else info.above
    if lower is None and info.maximum is None:
        return descriptor
    descriptor.additional_constraints = info.bounds_in_words()
    if kind not in (float, int):
        return descriptor
    largest = sys.float_info.max if kind is float else declared.LARGEST_INTEGER
    bounds = {
        "from_value": kind(-largest if lower is None else lower),
        "to_value": kind(largest if info.maximum is None else info.maximum),
    }
    if kind is float:
        descriptor.floating_point_range = [FloatingPointRange(**bounds)]
    else:
        descriptor.integer_range = [IntegerRange(**bounds)]
    return descriptor
