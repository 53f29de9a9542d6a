"""Adds runs of 8-bit texels onto 16-bit columns, 32 at a time.

The runs of the line cameras are short. A compiler processes the ends that do not fill a vector in a
scalar loop, which takes longer than the middle. So blocks of columns are written in LLVM vectors,
which are compiled to the instructions of the processor. Integer sums are the same on all
processors. Plain Python loops over whole blocks with masked ends took 46 % more CPU time (mean over
the cameras and headings of `benchmarks/render_lines.py`). The steps after this one use plain loops,
which take only 15 % more there.

Each function adds four rows, ``sums[column + i] += sum over r of texture[offsets[r] + column + i]``
for 0 <= i < 32, or < 64 if it adds two blocks. Most functions prefetch the cache lines of the four
rows that follow. The texture must be readable up to the end of a block. Offsets and bounds of the
rows are tuples of four integers.
"""

# numba matches the arguments of an intrinsic by name and uses only their types here.
# ruff: noqa: ARG001

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
_NUMBERS = ir.Constant(_COLUMNS, list(range(BLOCK)))
_UNDEFINED = ir.Constant(_COLUMNS, ir.Undefined)
_FIRST_LANE = ir.Constant(ir.VectorType(_INT32, BLOCK), None)
_CHOSEN = ir.VectorType(ir.IntType(1), BLOCK)
_NONE = ir.Constant(_COLUMNS, None)

# Result of an intrinsic for numba: its signature, and a function that writes its instructions.
Intrinsic = tuple[Any, Callable[[Any, Any, Any, Any], Any]]
# Writes masks by block and row, from a column and bounds.
_Choice = Callable[[Any, Any, Any], list[list[Any]]]


@intrinsic
def add_four(_context: Any, sums: Any, column: Any, texture: Any, offsets: Any) -> Intrinsic:
    """Add a whole block of four rows."""
    return _adding(sums, texture, [offsets], 1, None)


@intrinsic
def add_four_between(
    _context: Any, sums: Any, column: Any, texture: Any, offsets: Any, following: Any, bounds: Any
) -> Intrinsic:
    """Add columns ``bounds[0][r]`` to ``bounds[1][r] - 1`` of a block."""
    return _adding(sums, texture, [offsets, following, bounds], 1, _between)


@intrinsic
def add_four_twice(
    _context: Any, sums: Any, column: Any, texture: Any, offsets: Any, following: Any
) -> Intrinsic:
    """Add two whole blocks."""
    return _adding(sums, texture, [offsets, following], 2, None)


@intrinsic
def add_four_from(
    _context: Any, sums: Any, column: Any, texture: Any, offsets: Any, following: Any, starts: Any
) -> Intrinsic:
    """Add the columns of two blocks from ``starts[r]`` on, fewer than 64."""
    return _adding(sums, texture, [offsets, following, starts], 2, _from)


@intrinsic
def add_four_until(
    _context: Any, sums: Any, column: Any, texture: Any, offsets: Any, following: Any, ends: Any
) -> Intrinsic:
    """Add the columns of two blocks before ``ends[r]``, fewer than 64."""
    return _adding(sums, texture, [offsets, following, ends], 2, _until)


def _adding(
    sums: Any, texture: Any, tuples: list[Any], blocks: int, choose: _Choice | None
) -> Intrinsic:
    """Return signature and instructions; the tuples are offsets, following offsets and bounds."""
    signature = types.void(sums, types.intp, texture, *tuples)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        into, column, source, offsets, *more = arguments
        masks = choose(builder, column, more[1]) if choose else [[None] * _ROWS] * blocks
        for block, chosen in enumerate(masks):
            at = builder.add(column, _INT64(block * BLOCK))
            _add(context, builder, signature.args, (into, at, source, offsets), chosen)
        if more:
            _prefetch(context, builder, signature.args[2], source, more[0], column)
        return context.get_dummy_value()

    return signature, generate


def _prefetch(
    context: Any, builder: Any, kind: Any, texture: Any, offsets: Any, column: Any
) -> None:
    """Prefetch the cache lines of four rows."""
    for row in range(_ROWS):
        at = builder.add(builder.extract_value(offsets, row), column)
        pointer = _address(context, builder, kind, texture, at, _INT8)
        prefetch = ir.FunctionType(ir.VoidType(), [pointer.type, _INT32, _INT32, _INT32])
        function = cgutils.get_or_insert_function(builder.module, prefetch, "llvm.prefetch.p0")
        # Arguments: read access, keep in the cache, data.
        builder.call(function, [pointer, _INT32(0), _INT32(3), _INT32(1)])


def _add(context: Any, builder: Any, kinds: Any, place: Any, masks: list[Any]) -> None:
    into, column, source, offsets = place
    total = None
    for row, mask in enumerate(masks):
        at = builder.add(builder.extract_value(offsets, row), column)
        pointer = _address(context, builder, kinds[2], source, at, ir.VectorType(_INT8, BLOCK))
        run = builder.sext(builder.load(pointer, align=1), _COLUMNS)
        if mask is not None:
            run = builder.select(mask, run, _NONE)
        total = run if total is None else builder.add(total, run)
    pointer = _address(context, builder, kinds[0], into, column, _COLUMNS)
    builder.store(builder.add(builder.load(pointer, align=2), total), pointer, align=2)


def _from(builder: Any, column: Any, starts: Any) -> list[list[Any]]:
    return _of_two_blocks(builder, column, starts, lambda bits: bits)


def _until(builder: Any, column: Any, ends: Any) -> list[list[Any]]:
    return _of_two_blocks(builder, column, ends, builder.not_)


def _of_two_blocks(builder: Any, column: Any, bounds: Any, turn: Any) -> list[list[Any]]:
    """Return masks of 64 columns by block and row, from a bound on, transformed by `turn`."""
    masks: list[list[Any]] = [[], []]
    for row in range(_ROWS):
        place = builder.sub(builder.extract_value(bounds, row), column)
        bits = turn(builder.shl(_INT64(-1), place))
        for block, chosen in enumerate(masks):
            part = builder.trunc(builder.lshr(bits, _INT64(block * BLOCK)), _INT32)
            chosen.append(builder.bitcast(part, _CHOSEN))
    return masks


def _between(builder: Any, column: Any, bounds: Any) -> list[list[Any]]:
    starts, ends = (builder.extract_value(bounds, i) for i in range(2))
    columns = builder.add(_NUMBERS, _spread(builder, column))
    masks = []
    for row in range(_ROWS):
        start, end = (builder.extract_value(each, row) for each in (starts, ends))
        since = builder.sub(columns, _spread(builder, start))
        # Unsigned comparison: a column before the start becomes a huge number.
        length = _spread(builder, builder.sub(end, start))
        masks.append(builder.icmp_unsigned("<", since, length))
    return [masks]


def _spread(builder: Any, number: Any) -> Any:
    one = builder.insert_element(_UNDEFINED, builder.trunc(number, _INT16), _INT32(0))
    return builder.shuffle_vector(one, _UNDEFINED, _FIRST_LANE)


def _address(context: Any, builder: Any, kind: Any, array: Any, at: Any, content: Any) -> Any:
    """Return a pointer to an element of an array."""
    data = cgutils.create_struct_proxy(kind)(context, builder, value=array).data
    return builder.bitcast(builder.gep(data, [at]), content.as_pointer())
