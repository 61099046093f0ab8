"""C structs with named fields, filled by Python and read by kernels.

A kernel takes the address of a struct instead of a long list of integers:

    class Mesh(Struct):
        label: I64
        center: Pointer[F64] = inline(3)

    class Frame(Struct):
        width: I64
        depth: Pointer[F32]
        meshes: Mesh

    frame = Frame(address)
    frame.depth[frame.width] = frame.meshes[3].center[2]

A field of a struct's type holds the address of an array of structs. As in C, ``struct[k]`` is a reference to the k-th
struct of the array, unchecked. An ``inline`` field lies within the struct; in kernels it is a pointer to its values.
"""

import inspect
import operator
from collections import namedtuple
from collections.abc import Mapping
from itertools import repeat
from typing import TYPE_CHECKING, Any, ClassVar, Final, Self

import numpy as np

from renderers.compiler.kernel_types import numba_type
from renderers.compiler.numba_typing import define_fields, define_function, define_operator, extending, ir, types

_I64: Final = ir.IntType(64)


class _Inline:
    """Default of a field that is an array of values."""

    def __init__(self, count: int) -> None:
        self.count = count


def inline(count: int) -> Any:
    """Return the default of a ``Pointer`` field whose ``count`` values lie within the struct."""
    return _Inline(count)


class _StructType(types.Type):
    """Numba type of a reference to a struct."""

    def __init__(self, name: str, fields: Mapping[str, Any], inline_fields: Mapping[str, int], layout: Any) -> None:
        super().__init__(name)
        self.fields = fields
        self.inline = inline_fields
        self.offsets = {field: int(layout.fields[field][1]) for field in fields}
        self.size: int = layout.itemsize


class Struct:
    """Base of struct types for kernels and, as ``dtype``, for NumPy, where addresses are int64.

    In kernels, ``Frame(address)`` is the struct at an address, and ``Frame()`` an uninitialised struct on the stack of
    the calling device function. Names of structs must be unique: they are parts of the names of compiled functions.
    """

    dtype: ClassVar[np.dtype[Any]]
    nbytes: ClassVar[int]
    numba_type: ClassVar[Any]

    def __init_subclass__(cls) -> None:
        annotations = inspect.get_annotations(cls, eval_str=True)
        fields = {name: numba_type(annotation) for name, annotation in annotations.items()}
        counts = {name: vars(cls)[name].count for name in fields if name in vars(cls)}
        for name in counts:
            delattr(cls, name)
        layout = [(name, _layout(kind, counts.get(name))) for name, kind in fields.items()]
        cls.dtype = np.dtype(layout, align=True)
        cls.nbytes = cls.dtype.itemsize
        cls.numba_type = _StructType(cls.__name__, fields, counts, cls.dtype)
        _define_constructor(cls)

    if TYPE_CHECKING:

        def __init__(self, address: int = 0) -> None: ...

        def __getitem__(self, index: int) -> Self: ...

    @classmethod
    def offset_of(cls, field: str) -> int:
        """Return a field's offset in bytes."""
        offset: int = cls.numba_type.offsets[field]
        return offset

    @classmethod
    def places(cls, nbytes: int) -> Any:
        """Return the places of the fields in an array of values of ``nbytes`` each, a constant that kernels may use."""
        offsets = {field: offset // nbytes for field, offset in cls.numba_type.offsets.items()}
        return namedtuple(f"{cls.__name__}Places", offsets)(**offsets)

    @classmethod
    def record(cls, **fields: Any) -> tuple[Any, ...]:
        """Return the fields of one struct in their order, to assign to an element of an array of ``dtype``.

        Fields that are left out are 0.

        Raises:
            TypeError: there is no such field.
        """
        names = cls.dtype.names or ()
        if unknown := fields.keys() - set(names):
            raise TypeError(f"{cls.__name__} has no field {min(unknown)!r}")
        return tuple(map(fields.get, names, repeat(0)))


def _layout(kind: Any, count: int | None) -> Any:
    if count is not None:
        return np.dtype((str(kind.dtype), (count,)))
    return np.dtype(str(kind)) if isinstance(kind, types.Integer | types.Float) else np.dtype(np.int64)


@extending.register_model(_StructType)
class _StructModel(extending.models.PrimitiveModel):  # type: ignore[misc]  # Numba has no stubs for it
    def __init__(self, manager: Any, struct: _StructType) -> None:
        super().__init__(manager, struct, ir.IntType(8).as_pointer())


def _define_constructor(cls: type[Struct]) -> None:
    struct = cls.numba_type

    def construct(typing_context: Any, *address: Any) -> Any:
        def at_address(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return builder.inttoptr(args[0], context.get_value_type(struct))

        def on_stack(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            with builder.goto_entry_block():
                memory = builder.alloca(ir.ArrayType(_I64, -(-struct.size // 8)))
            return builder.bitcast(memory, context.get_value_type(struct))

        return (struct(types.int64), at_address) if address else (struct(), on_stack)

    define_function(cls, construct)


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
define_operator(operator.getitem, (_StructType, types.Integer), _element_signature, _emit_element)
