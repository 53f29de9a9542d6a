"""Adds runs of 8-bit texels onto 16-bit columns, 32 at a time.

The runs of the line cameras are short: a compiler leaves the ends that do not fill a vector to a
scalar loop, and these cost more than the middle. So blocks of columns are written here in the
vectors of LLVM, which become whatever instructions the processor has. Whole numbers have the same
sums on all of them.

Each function adds four rows, ``sums[column + i] += sum over r of texture[offsets[r] + column + i]``
for 0 <= i < 32. The texture must be readable up to the end of a block. Offsets and bounds of the
rows are tuples of four whole numbers.
"""

# numba finds an intrinsic's arguments by their names and writes the instructions from their types.
# ruff: noqa: ARG001

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

BLOCK = 32
"""Columns added at once."""

_ROWS = 4
_INT8, _INT16, _INT32 = ir.IntType(8), ir.IntType(16), ir.IntType(32)
_COLUMNS = ir.VectorType(_INT16, BLOCK)
_NUMBERS = ir.Constant(_COLUMNS, list(range(BLOCK)))
_NONE = ir.Constant(_COLUMNS, None)
_UNDEFINED = ir.Constant(_COLUMNS, ir.Undefined)
_FIRST_LANE = ir.Constant(ir.VectorType(_INT32, BLOCK), None)

# What numba asks an intrinsic for: its signature, and a function that writes its instructions.
_Intrinsic = tuple[Any, Callable[[Any, Any, Any, Any], Any]]
_Mask = Callable[[Any, Any, list[Any]], Any]


@intrinsic
def add_four(_context: Any, sums: Any, column: Any, texture: Any, offsets: Any) -> _Intrinsic:
    """Add whole blocks of four rows."""
    return _adding(sums, texture, [offsets], None)


@intrinsic
def add_four_from(
    _context: Any, sums: Any, column: Any, texture: Any, offsets: Any, starts: Any
) -> _Intrinsic:
    """Add of each row what lies in columns ``starts[r]`` and beyond."""
    return _adding(sums, texture, [offsets, starts], _from)


@intrinsic
def add_four_until(
    _context: Any, sums: Any, column: Any, texture: Any, offsets: Any, ends: Any
) -> _Intrinsic:
    """Add of each row what lies before column ``ends[r]``."""
    return _adding(sums, texture, [offsets, ends], _until)


@intrinsic
def add_four_between(
    _context: Any, sums: Any, column: Any, texture: Any, offsets: Any, starts: Any, ends: Any
) -> _Intrinsic:
    """Add of each row what lies in columns ``starts[r]`` to ``ends[r] - 1``."""
    return _adding(sums, texture, [offsets, starts, ends], _between)


@intrinsic
def prefetch(_context: Any, texture: Any, at: Any) -> _Intrinsic:
    """Ask for a texel's cache line; it need not exist."""
    signature = types.void(texture, types.intp)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = _address(context, builder, signature.args[0], arguments[0], arguments[1], _INT8)
        kind = ir.FunctionType(ir.VoidType(), [pointer.type, _INT32, _INT32, _INT32])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(function, [pointer, _INT32(0), _INT32(3), _INT32(1)])  # to read, keep, data
        return context.get_dummy_value()

    return signature, generate


def _adding(sums: Any, texture: Any, tuples: list[Any], mask: _Mask | None) -> _Intrinsic:
    """Return signature and instructions, the first of the tuples being the offsets."""
    signature = types.void(sums, types.intp, texture, *tuples)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        into, column, source, *numbers = arguments
        total = None
        for row in range(_ROWS):
            offset, *bounds = (builder.extract_value(each, row) for each in numbers)
            at = builder.add(offset, column)
            pointer = _address(
                context, builder, signature.args[2], source, at, ir.VectorType(_INT8, BLOCK)
            )
            run = builder.sext(builder.load(pointer, align=1), _COLUMNS)
            if mask is not None:
                run = builder.select(mask(builder, column, bounds), run, _NONE)
            total = run if total is None else builder.add(total, run)
        pointer = _address(context, builder, signature.args[0], into, column, _COLUMNS)
        builder.store(builder.add(builder.load(pointer, align=2), total), pointer, align=2)
        return context.get_dummy_value()

    return signature, generate


def _from(builder: Any, column: Any, bounds: list[Any]) -> Any:
    return builder.icmp_signed(">=", _NUMBERS, _within_block(builder, bounds[0], column))


def _until(builder: Any, column: Any, bounds: list[Any]) -> Any:
    return builder.icmp_signed("<", _NUMBERS, _within_block(builder, bounds[0], column))


def _between(builder: Any, column: Any, bounds: list[Any]) -> Any:
    return builder.and_(_from(builder, column, bounds), _until(builder, column, bounds[1:]))


def _within_block(builder: Any, bound: Any, column: Any) -> Any:
    """Return where a bound lies, counted from the block's first column, in each column."""
    place = builder.trunc(builder.sub(bound, column), _INT16)
    one = builder.insert_element(_UNDEFINED, place, _INT32(0))
    return builder.shuffle_vector(one, _UNDEFINED, _FIRST_LANE)


def _address(context: Any, builder: Any, kind: Any, array: Any, at: Any, content: Any) -> Any:
    """Return a pointer to what begins at an index of an array."""
    data = cgutils.create_struct_proxy(kind)(context, builder, value=array).data
    return builder.bitcast(builder.gep(data, [at]), content.as_pointer())
