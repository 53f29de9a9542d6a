"""Tuples of many arrays that compiled kernels receive as one pointer.

numba passes a tuple by value. A nested tuple of sixty arrays has about 400 values, all of which
every call and every assignment would copy, and LLVM would spend most of the compilation time on
these copies. A kernel receives a tuple of a class decorated with `by_reference` as a pointer, and
loads a field when it reads it. In a kernel, such a tuple can only be passed on, and its fields be
read by name. Python code uses it like any other named tuple.
"""

from typing import Any, TypeVar

from numba import types
from numba.extending import (
    NativeValue,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)

_C = TypeVar("_C", bound=type)


class Reference(types.NamedTuple):
    """Type of a pointer to the fields of a named tuple."""

    def __init__(self, kinds: Any, cls: type) -> None:
        super().__init__(kinds, cls)
        self.dtype = types.NamedTuple(kinds, cls)
        self.name = f"reference to {self.dtype}"


register_model(Reference)(models.PointerModel)


def by_reference(cls: _C) -> _C:
    """Let kernels receive the tuples of a class as pointers; for large `NamedTuple` classes."""

    @typeof_impl.register(cls)
    def _type_of(value: Any, context: Any) -> Reference:
        return Reference([typeof_impl(field, context) for field in value], cls)

    return cls


def _place(context: Any, builder: Any, pointer: Any, index: int) -> Any:
    """Return the address of a field."""
    indices = [context.get_constant(types.int32, one) for one in (0, index)]
    return builder.gep(pointer, indices, inbounds=True)


@lower_getattr_generic(Reference)
def _load(context: Any, builder: Any, kind: Reference, pointer: Any, name: str) -> Any:
    """Return the value of a field."""
    index = kind.fields.index(name)
    value = context.unpack_value(builder, kind[index], _place(context, builder, pointer, index))
    if context.enable_nrt:
        context.nrt.incref(builder, kind[index], value)
    return value


@unbox(Reference)
def _unbox(kind: Reference, tuple_: Any, c: Any) -> NativeValue:
    """Store the fields of a tuple of Python on the stack, and return their address."""
    with c.builder.goto_entry_block():
        pointer = c.builder.alloca(c.context.get_data_type(kind.dtype))
        failed = c.builder.alloca(c.context.get_value_type(types.boolean))
    c.builder.store(c.context.get_constant(types.boolean, False), failed)
    natives = []
    for index, field in enumerate(kind):
        native = c.unbox(field, c.pyapi.tuple_getitem(tuple_, index))
        place = _place(c.context, c.builder, pointer, index)
        c.context.pack_value(c.builder, field, native.value, place)
        c.builder.store(c.builder.or_(c.builder.load(failed), native.is_error), failed)
        natives.append((field, native))

    def clean_up() -> None:
        for field, native in natives:
            if native.cleanup is not None:
                native.cleanup()
            if c.context.enable_nrt:
                c.context.nrt.decref(c.builder, field, native.value)

    return NativeValue(pointer, is_error=c.builder.load(failed), cleanup=clean_up)
