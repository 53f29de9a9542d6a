"""Adds runs of 8-bit texels onto 16-bit columns, 32 at a time.

The runs of the line cameras are short: a compiler leaves the ends that do not fill a vector to a
scalar loop, and these cost more than the middle. So blocks of columns are written here in the
vectors of LLVM, which become whatever instructions the processor has. Whole numbers have the same
sums on all of them.

Each function adds four rows, ``sums[column + i] += sum over r of texture[offsets[r] + column + i]``
for 0 <= i < 32, or < 64 where it adds two blocks; these ask for the cache lines of the four rows
that follow. The texture must be readable up to the end of a block. Offsets and bounds of the rows
are tuples of four whole numbers.
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
_INT8, _INT16, _INT32, _INT64 = (ir.IntType(bits) for bits in (8, 16, 32, 64))
_COLUMNS = ir.VectorType(_INT16, BLOCK)
_CHOSEN = ir.VectorType(ir.IntType(1), BLOCK)
_NONE = ir.Constant(_COLUMNS, None)

# What numba asks an intrinsic for: its signature, and a function that writes its instructions.
Intrinsic = tuple[Any, Callable[[Any, Any, Any, Any], Any]]
_Mask = Callable[[Any, Any, list[Any]], Any]


@intrinsic
def add_four(_context: Any, sums: Any, column: Any, texture: Any, offsets: Any) -> Intrinsic:
    """Add a whole block of four rows."""
    return _adding(sums, texture, [offsets], None)


@intrinsic
def add_four_between(
    _context: Any, sums: Any, column: Any, texture: Any, offsets: Any, starts: Any, ends: Any
) -> Intrinsic:
    """Add of each row what lies in columns ``starts[r]`` to ``ends[r] - 1``."""
    return _adding(sums, texture, [offsets, starts, ends], _between)


@intrinsic
def add_four_twice(
    _context: Any, sums: Any, column: Any, texture: Any, offsets: Any, following: Any
) -> Intrinsic:
    """Add two whole blocks."""
    return _adding_two(sums, texture, [offsets, following], None)


@intrinsic
def add_four_from(
    _context: Any, sums: Any, column: Any, texture: Any, offsets: Any, following: Any, starts: Any
) -> Intrinsic:
    """Add of two blocks what lies in columns ``starts[r]`` and beyond, fewer than 64 on."""
    return _adding_two(sums, texture, [offsets, following, starts], _bits_from)


@intrinsic
def add_four_until(
    _context: Any, sums: Any, column: Any, texture: Any, offsets: Any, following: Any, ends: Any
) -> Intrinsic:
    """Add of two blocks what lies before column ``ends[r]``, fewer than 64 on."""
    return _adding_two(sums, texture, [offsets, following, ends], _bits_until)


def _adding(sums: Any, texture: Any, tuples: list[Any], mask: _Mask | None) -> Intrinsic:
    """Return signature and instructions, the first of the tuples being the offsets."""
    signature = types.void(sums, types.intp, texture, *tuples)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        column, numbers = arguments[1], arguments[3:]
        bounds = [
            [builder.extract_value(each, row) for each in numbers[1:]] for row in range(_ROWS)
        ]
        masks = [mask and mask(builder, column, each) for each in bounds]
        _add(context, builder, signature.args, arguments, 0, masks)
        return context.get_dummy_value()

    return signature, generate


def _adding_two(sums: Any, texture: Any, tuples: list[Any], bits: _Mask | None) -> Intrinsic:
    """Do the same for two blocks, the second of the tuples being the offsets of what follows."""
    signature = types.void(sums, types.intp, texture, *tuples)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        _, column, source, _, following, *bounds = arguments
        chosen = [
            bits and bits(builder, column, [builder.extract_value(bounds[0], row)])
            for row in range(_ROWS)
        ]
        for block in range(2):
            masks = [
                each and _mask(builder, builder.lshr(each, _INT64(block * BLOCK)))
                for each in chosen
            ]
            _add(context, builder, signature.args, arguments, block * BLOCK, masks)
        for row in range(_ROWS):
            at = builder.add(builder.extract_value(following, row), column)
            pointer = address(context, builder, signature.args[2], source, at, _INT8)
            kind = ir.FunctionType(ir.VoidType(), [pointer.type, _INT32, _INT32, _INT32])
            function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
            # To read, to keep, of data.
            builder.call(function, [pointer, _INT32(0), _INT32(3), _INT32(1)])
        return context.get_dummy_value()

    return signature, generate


def _add(
    context: Any, builder: Any, kinds: Any, arguments: Any, ahead: int, masks: list[Any]
) -> None:
    into, column, source, offsets = arguments[:4]
    column = builder.add(column, _INT64(ahead))
    total = None
    for row, mask in enumerate(masks):
        at = builder.add(builder.extract_value(offsets, row), column)
        pointer = address(context, builder, kinds[2], source, at, ir.VectorType(_INT8, BLOCK))
        run = builder.sext(builder.load(pointer, align=1), _COLUMNS)
        if mask is not None:
            run = builder.select(mask, run, _NONE)
        total = run if total is None else builder.add(total, run)
    pointer = address(context, builder, kinds[0], into, column, _COLUMNS)
    builder.store(builder.add(builder.load(pointer, align=2), total), pointer, align=2)


def _bits_from(builder: Any, column: Any, bounds: list[Any]) -> Any:
    """Return a bit for each of 64 columns, set from a bound on."""
    return builder.shl(_INT64(-1), builder.sub(bounds[0], column))


def _bits_until(builder: Any, column: Any, bounds: list[Any]) -> Any:
    return builder.not_(_bits_from(builder, column, bounds))


def _mask(builder: Any, bits: Any) -> Any:
    return builder.bitcast(builder.trunc(bits, _INT32), _CHOSEN)


def _between(builder: Any, column: Any, bounds: list[Any]) -> Any:
    starts, ends = (_bits_from(builder, column, [_within(builder, b, column)]) for b in bounds)
    return _mask(builder, builder.and_(starts, builder.not_(ends)))


def _within(builder: Any, bound: Any, column: Any) -> Any:
    """Return a bound, or the nearest end of a block that it lies outside of."""
    last = builder.add(column, _INT64(BLOCK))
    bound = builder.select(builder.icmp_signed(">", bound, column), bound, column)
    return builder.select(builder.icmp_signed("<", bound, last), bound, last)


def address(context: Any, builder: Any, kind: Any, array: Any, at: Any, content: Any) -> Any:
    """Return a pointer to what begins at an index of an array."""
    data = cgutils.create_struct_proxy(kind)(context, builder, value=array).data
    return builder.bitcast(builder.gep(data, [at]), content.as_pointer())
