"""Addition of runs of consecutive 8-bit texels to 16-bit columns, 32 columns at a time.

A run is a sequence of neighboring texels in a row; the runs under a line are short. For the ends of
a run, which do not fill a vector register, a compiler would use a scalar loop that takes longer
than the rest of the run. The kernels therefore add whole blocks of columns, as LLVM vectors, which
the compiler translates to the instructions of the processor. Integer sums are the same on all
processors. Plain loops would give the same lines: one over the columns that all four rows cover,
and scalar loops at both ends. With them, the cameras of `benchmarks/render_lines.py` take about
10 % more CPU time per line at headings of 0, 1, 45 and 90 deg, and 21 to 33 % more at 20 and 133
deg.
The later steps of a line use plain loops, because vectors would save little time there.

Each function adds four rows, ``sums[column + i] += sum over r of texture[offsets[r] + column + i]``
for 0 <= i < 32. The texture must be readable up to the end of a block. Offsets and bounds of the
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
"""Number of columns that are added at once."""

_ROWS = 4
_INT8, _INT16, _INT32 = (ir.IntType(bits) for bits in (8, 16, 32))
_COLUMNS = ir.VectorType(_INT16, BLOCK)
_NUMBERS = ir.Constant(_COLUMNS, list(range(BLOCK)))
_UNDEFINED = ir.Constant(_COLUMNS, ir.Undefined)
_FIRST_LANE = ir.Constant(ir.VectorType(_INT32, BLOCK), None)
_NONE = ir.Constant(_COLUMNS, None)

# Return type of a numba intrinsic: its signature, and a function that generates its instructions.
Intrinsic = tuple[Any, Callable[[Any, Any, Any, Any], Any]]


@intrinsic
def add_four(_context: Any, sums: Any, column: Any, texture: Any, offsets: Any) -> Intrinsic:
    """Add the 32 columns of the block that begins at `column`, in each of four rows, to `sums`."""
    return _adding(sums, texture, [offsets])


@intrinsic
def add_four_between(
    _context: Any, sums: Any, column: Any, texture: Any, offsets: Any, bounds: Any
) -> Intrinsic:
    """Add a part of the block that begins at `column`, in each of four rows, to `sums`.

    This part consists of the columns from ``bounds[0][r]`` to ``bounds[1][r] - 1`` of row r.
    """
    return _adding(sums, texture, [offsets, bounds])


def _adding(sums: Any, texture: Any, tuples: list[Any]) -> Intrinsic:
    """Return the signature of an addition, and the function that generates its LLVM code.

    Args:
        sums: type of the array of sums.
        texture: type of the array of texels.
        tuples: types of the offsets and, optionally, of the bounds.
    """
    signature = types.void(sums, types.intp, texture, *tuples)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        into, column, source, offsets, *bounds = arguments
        masks = _between(builder, column, bounds[0]) if bounds else [None] * _ROWS
        _add(context, builder, signature.args, (into, column, source, offsets), masks)
        return context.get_dummy_value()

    return signature, generate


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


def _between(builder: Any, column: Any, bounds: Any) -> list[Any]:
    starts, ends = (builder.extract_value(bounds, i) for i in range(2))
    columns = builder.add(_NUMBERS, _spread(builder, column))
    masks = []
    for row in range(_ROWS):
        start, end = (builder.extract_value(each, row) for each in (starts, ends))
        since = builder.sub(columns, _spread(builder, start))
        # In the unsigned comparison, a column before the start counts as a huge number.
        length = _spread(builder, builder.sub(end, start))
        masks.append(builder.icmp_unsigned("<", since, length))
    return masks


def _spread(builder: Any, number: Any) -> Any:
    one = builder.insert_element(_UNDEFINED, builder.trunc(number, _INT16), _INT32(0))
    return builder.shuffle_vector(one, _UNDEFINED, _FIRST_LANE)


def _address(context: Any, builder: Any, kind: Any, array: Any, at: Any, content: Any) -> Any:
    """Return the address of element `at` of an array, as an LLVM pointer to type `content`."""
    data = cgutils.create_struct_proxy(kind)(context, builder, value=array).data
    return builder.bitcast(builder.gep(data, [at]), content.as_pointer())
