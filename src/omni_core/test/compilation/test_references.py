"""Kernels receive a tuple of many arrays as a pointer to its fields."""

import sys
from typing import NamedTuple

import numpy as np

from omni_core.kernels import by_reference, kernel, lean
from omni_core.quantities import FloatArray


@by_reference
class Wheel(NamedTuple):
    speed: FloatArray
    braked: bool
    radius: float


@by_reference
class Vehicle(NamedTuple):
    wheel: Wheel
    twist: FloatArray
    name: tuple[int, float]


@lean
def _spin(wheel: Wheel) -> float:
    """Change a field of a nested tuple in place, and return another one."""
    wheel.speed[0] += 1.0
    return wheel.radius if wheel.braked else 0.0


@kernel
def advance(vehicle: Vehicle) -> tuple[float, FloatArray]:
    later = vehicle.twist[1:]
    return _spin(vehicle.wheel) + later.sum() + vehicle.name[0], vehicle.twist


def vehicle(radius: float = 0.1) -> Vehicle:
    return Vehicle(Wheel(np.zeros(2), True, radius), np.arange(3.0), (5, 6.0))


def test_a_kernel_reads_and_changes_the_fields() -> None:
    given = vehicle(0.25)
    result, twist = advance(given)
    assert result == 0.25 + 3.0 + 5
    assert twist is given.twist or np.shares_memory(twist, given.twist)
    assert given.wheel.speed.tolist() == [1.0, 0.0]
    assert advance(given._replace(wheel=given.wheel._replace(braked=False)))[0] == 8.0


def test_a_call_keeps_no_reference_to_an_array() -> None:
    given = vehicle()
    advance(given)
    before = sys.getrefcount(given.twist), sys.getrefcount(given.wheel.speed)
    for _ in range(3):
        advance(given)
    assert (sys.getrefcount(given.twist), sys.getrefcount(given.wheel.speed)) == before


def test_the_tuple_is_one_argument_of_the_compiled_function() -> None:
    advance(vehicle())
    ((kind,),) = getattr(advance, "signatures")  # noqa: B009
    model = getattr(advance, "targetctx").data_model_manager[kind]  # noqa: B009
    assert not isinstance(model.get_argument_type(), tuple)
