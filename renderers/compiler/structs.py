"""C structs with named fields, filled by Python and read by kernels.

A kernel takes the address of a struct instead of a long list of integers:

    MESH = Struct("Mesh", {"label": I64, "center": array_of(F64, 3)})
    FRAME = Struct("Frame", {"width": I64, "depth": pointer_to(F32), "meshes": MESH})
    frame_at = FRAME.at

    frame = frame_at(address)
    frame.depth[frame.width] = frame.meshes[3].center[2]

A field of type ``Struct`` holds the address of an array of structs. As in C, ``struct[k]`` is a reference to the k-th
struct of the array, unchecked. An ``array_of`` field lies within the struct; in kernels it is a pointer to its values.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping
from itertools import repeat
from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import extending, types

from renderers.compiler.numba_typing import define_fields, define_operator, intrinsic

_extending: Final[Any] = extending  # its stubs lack most names
_I64: Final = ir.IntType(64)

I64: Final[Any] = types.int64
I32: Final[Any] = types.int32
U32: Final[Any] = types.uint32
U8: Final[Any] = types.uint8
F64: Final[Any] = types.float64
F32: Final[Any] = types.float32


def pointer_to(scalar: Any) -> Any:
    """Type of a field that holds the address of scalars."""
    return types.CPointer(scalar)


class _InlineArray:
    """Type of a field that is an array of scalars."""

    def __init__(self, scalar: Any, count: int) -> None:
        self.scalar = scalar
        self.count = count


def array_of(scalar: Any, count: int) -> Any:
    """Type of a field that consists of ``count`` scalars."""
    return _InlineArray(scalar, count)


class _StructType(types.Type):
    """Numba type of a reference to a struct."""

    def __init__(self, name: str, kinds: Mapping[str, Any], offsets: Mapping[str, int], size: int) -> None:
        super().__init__(name)
        self.fields = {
            field: types.CPointer(kind.scalar) if isinstance(kind, _InlineArray) else kind
            for field, kind in kinds.items()
        }
        self.inline = {field for field, kind in kinds.items() if isinstance(kind, _InlineArray)}
        self.offsets = offsets
        self.size = size


class Struct:
    """A struct type for kernels and, as ``dtype``, for NumPy, where addresses are int64."""

    def __init__(self, name: str, fields: Mapping[str, Any]) -> None:
        """
        Args:
            name: unique among all structs; part of the names of compiled functions.
            fields: name -> a scalar type, ``pointer_to(...)``, ``array_of(...)``, or a ``Struct``.
        """
        kinds = {field: kind.type if isinstance(kind, Struct) else kind for field, kind in fields.items()}
        self.dtype: Final = np.dtype([(field, _layout(kind)) for field, kind in kinds.items()], align=True)
        layout: Any = self.dtype.fields
        offsets = {field: int(layout[field][1]) for field in kinds}
        self.size: Final = self.dtype.itemsize
        self.type: Final[Any] = _StructType(name, kinds, offsets, self.size)
        self.at: Final = _reference(self.type)
        """``at(address)``: the struct at an address, in kernels."""
        self.local: Final = _on_stack(self.type)
        """``local()``: an uninitialised struct on the stack of the calling device function, in kernels."""

    def record(self, **fields: Any) -> tuple[Any, ...]:
        """Return the fields of one struct in their order, to assign to an element of an array of ``dtype``.

        Fields that are left out are 0.

        Raises:
            TypeError: there is no such field.
        """
        names = self.dtype.names or ()
        if unknown := fields.keys() - set(names):
            raise TypeError(f"{self.type.name} has no field {min(unknown)!r}")
        return tuple(map(fields.get, names, repeat(0)))


def _layout(kind: Any) -> Any:
    if isinstance(kind, _InlineArray):
        return np.dtype((str(kind.scalar), (kind.count,)))
    return np.dtype(str(kind)) if isinstance(kind, (types.Integer, types.Float)) else np.dtype(np.int64)


@_extending.register_model(_StructType)
class _StructModel(_extending.models.PrimitiveModel):  # type: ignore[misc]  # Numba has no stubs for it
    def __init__(self, manager: Any, struct: _StructType) -> None:
        super().__init__(manager, struct, ir.IntType(8).as_pointer())


def _reference(struct: _StructType) -> Any:
    def cast(typing_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return builder.inttoptr(args[0], context.get_value_type(struct))

        return struct(types.int64), generate

    return intrinsic(cast)


def _on_stack(struct: _StructType) -> Any:
    def allocate(typing_context: Any) -> Any:
        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            with builder.goto_entry_block():
                memory = builder.alloca(ir.ArrayType(_I64, -(-struct.size // 8)))
            return builder.bitcast(memory, context.get_value_type(struct))

        return struct(), generate

    return intrinsic(allocate)


def _field_address(context: Any, builder: Any, struct: Any, reference: Any, name: str) -> Any:
    address = builder.gep(reference, [ir.Constant(_I64, struct.offsets[name])])
    value: Any = context.get_value_type(struct.fields[name])
    return builder.bitcast(address, value if name in struct.inline else value.as_pointer())


def _load_field(context: Any, builder: Any, struct: Any, reference: Any, name: str) -> Any:
    address = _field_address(context, builder, struct, reference, name)
    return address if name in struct.inline else builder.load(address)


def _store_field(context: Any, builder: Any, sig: Any, args: Any, name: str) -> None:
    struct, given = sig.args
    value = context.cast(builder, args[1], given, struct.fields[name])
    builder.store(value, _field_address(context, builder, struct, args[0], name))


def _element_signature(struct: Any, index: Any) -> Any:
    is_ours = isinstance(struct, _StructType) and isinstance(index, types.Integer)
    return struct(struct, types.int64) if is_ours else None


def _emit_element(builder: Any, sig: Any, reference: Any, index: Any) -> Any:
    return builder.gep(reference, [builder.mul(index, ir.Constant(_I64, sig.args[0].size))])


define_fields(_StructType, lambda struct, name: struct.fields.get(name), _load_field, _store_field)
define_operator(
    operator.getitem,
    (_StructType, types.Integer),
    _element_signature,
    _emit_element,
)
