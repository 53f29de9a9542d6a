"""Steps from rows of texels to pixels that a compiler does not write in vectors by itself.

It cannot know that the arrays lie apart, has no gathers of bytes and no sums that run on. So these
steps are written here in the vectors of LLVM, as in `blocks`. All sums are whole numbers, in
doubles too, and the same on every processor.
"""

# numba finds an intrinsic's arguments by their names and writes the instructions from their types.
# ruff: noqa: ARG001

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from omni_sim.camera.footprint.blocks import Intrinsic, address

LANES = 8
"""Columns or edges of one call."""

POINT = 24
"""Binary places of fixed-point positions."""

WEIGHT_BITS = 8
"""Binary places of the weights of partly covered rows."""

_CLASSES = 4
_BOOL, _INT8, _INT32, _INT64 = ir.IntType(1), ir.IntType(8), ir.IntType(32), ir.IntType(64)
_INT8S = ir.VectorType(_INT8, LANES)
_INT32S, _INT64S = ir.VectorType(_INT32, LANES), ir.VectorType(_INT64, LANES)
_DOUBLES, _BOOLS = ir.VectorType(ir.DoubleType(), LANES), ir.VectorType(_BOOL, LANES)
_NUMBERS = ir.Constant(_INT64S, list(range(LANES)))
_ALL = ir.Constant(_BOOLS, [1] * LANES)
_NONE = ir.Constant(_DOUBLES, [0.0] * LANES)
_BELOW_ONE = (1 << POINT) - 1


@intrinsic
def add_edges(
    _context: Any, totals: Any, column: Any, cover: Any, texture: Any, offsets: Any
) -> Intrinsic:
    """Add the two rows that columns from `column` on cover in part, weighted.

    All weights of a column add up to the height, whatever the rounding: a uniform ground must not
    show where rows begin and end.

    Args:
        totals: int32, one per column.
        column: the first one.
        cover: low, climb and height of the cover, a tuple of whole numbers.
        texture: int8.
        offsets: where in it column 0 of each row lies.
    """
    return _adding_edges(totals, cover, texture, offsets, alike=False)


@intrinsic
def add_edges_alike(
    _context: Any, totals: Any, column: Any, cover: Any, texture: Any, offsets: Any
) -> Intrinsic:
    """Do the same where all of these columns cover the same rows in part."""
    return _adding_edges(totals, cover, texture, offsets, alike=True)


def _adding_edges(totals: Any, cover: Any, texture: Any, offsets: Any, *, alike: bool) -> Intrinsic:
    signature = types.void(totals, types.intp, cover, texture, offsets)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        totals, column, cover, texture, offsets = arguments
        kinds = signature.args
        low, climb, height = (
            _spread(builder, builder.extract_value(cover, place), _INT64S) for place in range(3)
        )
        columns = builder.add(_spread(builder, column, _INT64S), _NUMBERS)
        count = cgutils.create_struct_proxy(kinds[0])(context, builder, value=totals).nitems
        within = builder.icmp_signed("<", columns, _spread(builder, count, _INT64S))
        y = builder.sub(builder.add(low, builder.mul(climb, columns)), _whole(1))
        # The rows before the first and behind the last that are covered in full.
        under = builder.ashr(y, _whole(POINT))
        over = builder.ashr(builder.add(builder.add(y, height), _whole(1)), _whole(POINT))
        rest = builder.sub(_whole(_BELOW_ONE), builder.and_(y, _whole(_BELOW_ONE)))
        below = builder.lshr(rest, _whole(POINT - WEIGHT_BITS))
        full = builder.shl(builder.sub(builder.sub(over, under), _whole(1)), _whole(WEIGHT_BITS))
        above = builder.sub(builder.lshr(height, _whole(POINT - WEIGHT_BITS)), full)
        above = builder.sub(above, below)
        data = address(context, builder, kinds[3], texture, ir.Constant(_INT64, 0), _INT8)
        starts = address(context, builder, kinds[4], offsets, ir.Constant(_INT64, 0), _INT64)
        pointer = address(context, builder, kinds[0], totals, column, _INT32S)
        total = builder.load(pointer, align=4)
        for row, weight in ((under, below), (over, above)):
            if alike:
                first = builder.extract_element(row, _INT32(0))
                place = builder.add(builder.load(builder.gep(starts, [first])), column)
                grey = builder.bitcast(builder.gep(data, [place]), _INT8S.as_pointer())
                grey = builder.sext(builder.load(grey, align=1), _INT32S)
            else:
                place = builder.add(_gather(builder, starts, row, within, _INT64S), columns)
                # Four bytes, of which the first counts.
                grey = _gather(builder, data, place, within, _INT32S)
                grey = builder.ashr(builder.shl(grey, _word(24)), _word(24))
            total = builder.add(total, builder.mul(builder.trunc(weight, _INT32S), grey))
        builder.store(total, pointer, align=4)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def merge_classes(_context: Any, totals: Any, column: Any, cells: Any) -> Intrinsic:
    """Merge the classes into quarter-texel cells: ``cells[q, c]`` at s = origin + c + (2 + q)/4.

    Class k of column c begins at quarter k of a column that starts half a texel early, so cell q
    sees classes up to q of its own column and the others of the column before.

    Args:
        totals: int32, shape (4, columns).
        column: the first of those to do.
        cells: likewise.
    """
    signature = types.void(totals, types.intp, cells)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        totals, column, cells = arguments
        merged = _merged(context, builder, signature.args[0], totals, column)
        for cls, cell in enumerate(merged):
            pointer = _plane(context, builder, signature.args[2], cells, cls, column)
            builder.store(cell, pointer, align=4)
        return context.get_dummy_value()

    return signature, generate


def _merged(context: Any, builder: Any, kind: Any, totals: Any, column: Any) -> list[Any]:
    following = builder.add(column, _INT64(1))
    here, last = (
        [
            builder.load(_plane(context, builder, kind, totals, cls, at), align=4)
            for cls in range(_CLASSES)
        ]
        for at in (following, column)
    )
    cells = [builder.add(builder.add(here[0], last[1]), builder.add(last[2], last[3]))]
    for cls in range(1, _CLASSES):
        cells.append(builder.add(cells[-1], builder.sub(here[cls], last[cls])))
    return cells


@intrinsic
def sum_cells(_context: Any, cells: Any, column: Any, before: Any, integral: Any) -> Intrinsic:
    """Return the sum of all cells up to these columns, and set what it is up to each cell.

    Args:
        cells: int32, shape (4, columns).
        column: the first of those to do.
        before: the sum of all cells of the columns before.
        integral: float64; receives the sum before each cell, ``integral[4 c + q]``.
    """
    return _summing(cells, integral, merged=True)


@intrinsic
def sum_classes(_context: Any, totals: Any, column: Any, before: Any, integral: Any) -> Intrinsic:
    """Do the same with classes that are still to be merged."""
    return _summing(totals, integral, merged=False)


def _summing(source: Any, integral: Any, *, merged: bool) -> Intrinsic:
    signature = types.float64(source, types.intp, types.float64, integral)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        source, column, before, integral = arguments
        kinds = signature.args
        if merged:
            cells = [
                builder.load(_plane(context, builder, kinds[0], source, cls, column), align=4)
                for cls in range(_CLASSES)
            ]
        else:
            cells = _merged(context, builder, kinds[0], source, column)
        sums = [_NONE]
        for cell in cells:
            sums.append(builder.fadd(sums[-1], builder.sitofp(cell, _DOUBLES)))
        # Each lane adds the one before, then the two before, then the four before.
        upto = sums[_CLASSES]
        for step in (1, 2, 4):
            moved = [LANES + i - step if i >= step else i for i in range(LANES)]
            upto = builder.fadd(upto, _shuffle(builder, _NONE, upto, moved))
        start = _spread(builder, before, _DOUBLES)
        ahead = _shuffle(builder, _NONE, upto, [0, *range(LANES, 2 * LANES - 1)])
        ahead = builder.fadd(ahead, start)
        parts = [builder.fadd(ahead, part) for part in sums[:_CLASSES]]
        by_two = [j + LANES * k for j in range(LANES) for k in (0, 1)]
        by_four = [2 * (j + LANES * k) + i for j in range(LANES) for k in (0, 1) for i in (0, 1)]
        first = _shuffle(builder, parts[0], parts[1], by_two)
        second = _shuffle(builder, parts[2], parts[3], by_two)
        together = _shuffle(builder, first, second, by_four)
        place = builder.mul(column, _INT64(_CLASSES))
        pointer = address(context, builder, kinds[3], integral, place, together.type)
        builder.store(together, pointer, align=8)
        return builder.fadd(before, builder.extract_element(upto, _INT32(LANES - 1)))

    return signature, generate


@intrinsic
def read_edges(
    _context: Any, integral: Any, places: Any, edge: Any, last: Any, values: Any
) -> Intrinsic:
    """Read the integral twice at each edge of a pixel and set `values` to the sum.

    Args:
        integral: float64, before each cell.
        places: of both readings at the first edge, and the advance from edge to edge times 256
            [cells, fixed point].
        edge: the first one to read.
        last: the last edge that there is; those behind it are read there.
        values: float64, one per edge.
    """
    signature = types.void(integral, places, types.intp, types.intp, values)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        integral, places, edge, last, values = arguments
        kinds = signature.args
        edges = builder.add(_spread(builder, edge, _INT64S), _NUMBERS)
        last = _spread(builder, last, _INT64S)
        edges = builder.select(builder.icmp_signed("<", edges, last), edges, last)
        *starts, advance = (
            _spread(builder, builder.extract_value(places, i), _INT64S) for i in range(3)
        )
        moved = builder.ashr(builder.mul(advance, edges), _whole(8))
        readings = []
        for start in starts:
            at = builder.add(start, moved)
            cell = builder.ashr(at, _whole(POINT))
            rest = builder.uitofp(builder.and_(at, _whole(_BELOW_ONE)), _DOUBLES)
            fraction = builder.fmul(rest, _number(1.0 / (1 << POINT)))
            low, high = (
                _gather(
                    builder,
                    address(context, builder, kinds[0], integral, _INT64(i), ir.DoubleType()),
                    cell, _ALL, _DOUBLES,
                )
                for i in (0, 1)
            )  # fmt: skip
            lack = builder.fmul(builder.fsub(_number(1.0), fraction), builder.fsub(high, low))
            readings.append(builder.fsub(high, lack))
        pointer = address(context, builder, kinds[4], values, edge, _DOUBLES)
        builder.store(builder.fadd(*readings), pointer, align=8)
        return context.get_dummy_value()

    return signature, generate


def _whole(value: int) -> Any:
    return ir.Constant(_INT64S, [value] * LANES)


def _word(value: int) -> Any:
    return ir.Constant(_INT32S, [value] * LANES)


def _number(value: float) -> Any:
    return ir.Constant(_DOUBLES, [value] * LANES)


def _spread(builder: Any, value: Any, kind: Any) -> Any:
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), value, _INT32(0))
    return _shuffle(builder, one, one, [0] * LANES)


def _shuffle(builder: Any, first: Any, second: Any, order: list[int]) -> Any:
    mask = ir.Constant(ir.VectorType(_INT32, len(order)), order)
    return builder.shuffle_vector(first, second, mask)


def _plane(context: Any, builder: Any, kind: Any, array: Any, plane: int, column: Any) -> Any:
    """Return a pointer to columns of a plane of a two-dimensional array of whole numbers."""
    proxy = cgutils.create_struct_proxy(kind)(context, builder, value=array)
    room = builder.extract_value(proxy.shape, 1)
    at = builder.add(builder.mul(room, _INT64(plane)), column)
    return address(context, builder, kind, array, at, _INT32S)


def _gather(builder: Any, start: Any, places: Any, mask: Any, kind: Any) -> Any:
    """Return what lies at `places`, counted from a pointer in what it points to; 0 without mask."""
    element = start.type.pointee
    size = 1 if element == _INT8 else 8
    addresses = builder.mul(places, _whole(size))
    addresses = builder.add(addresses, _spread(builder, builder.ptrtoint(start, _INT64), _INT64S))
    pointers = builder.inttoptr(addresses, ir.VectorType(ir.PointerType(), LANES))
    name = "f64" if kind is _DOUBLES else str(kind.element)
    function = cgutils.get_or_insert_function(
        builder.module,
        ir.FunctionType(kind, [pointers.type, _INT32, _BOOLS, kind]),
        f"llvm.masked.gather.v{LANES}{name}.v{LANES}p0",
    )
    return builder.call(function, [pointers, _INT32(size), mask, ir.Constant(kind, None)])
