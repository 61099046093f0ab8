"""Loads and stores of whole vectors, and of one value per lane.

Stores and prefetches return 0, since intrinsic functions need a result.
"""

from collections.abc import Callable
from typing import Any, Final

from renderers.compiler.kernel_types import Pointer
from renderers.compiler.numba_typing import intrinsic, ir, types
from renderers.compiler.simd.vectors import (
    I1,
    I8,
    I32,
    LANES,
    I32x8,
    Vector,
    call_llvm,
    define,
    f32x8,
    f64x8,
    has_feature,
    i32x8,
    insert,
    m8,
    offset_of,
)

_VECTORS: Final = {types.float32: f32x8, types.float64: f64x8, types.int32: i32x8, types.uint32: i32x8}
"""Vector types by the type of the values behind a pointer."""


def vector_behind(pointer: Any) -> Any:
    """Return the vector type that a pointer's values are loaded as; None if it is no pointer to numbers."""
    return _VECTORS.get(pointer.dtype) if isinstance(pointer, types.CPointer) else None


def vector_address(builder: Any, vector: Vector, pointer: Any, index: Any) -> Any:
    """Return the address of value ``index`` behind a pointer, as that of a vector."""
    return builder.bitcast(builder.gep(pointer, [index]), vector.llvm.as_pointer())


def _alignment(vector: Vector) -> int:
    return 8 if vector is f64x8 else 4


class VolatileLoad(ir.instructions.LoadInstr):  # type: ignore[misc]  # llvmlite has no types
    """A load that LLVM neither removes nor merges with others."""

    def descr(self, buffer: list[str]) -> None:
        super().descr(buffer)
        buffer[-1] = buffer[-1].replace("load ", "load volatile ", 1)


def _volatile_load(builder: Any, address: Any, alignment: int) -> Any:
    load = VolatileLoad(builder.block, address)
    load.align = alignment
    insert(builder, load)
    return load


def _emit_load(builder: Any, sig: Any, pointer: Any, index: Any) -> Any:
    vector = sig.return_type
    return builder.load(vector_address(builder, vector, pointer, index), align=_alignment(vector))


def _emit_volatile_load(builder: Any, sig: Any, pointer: Any, index: Any) -> Any:
    vector = sig.return_type
    return _volatile_load(builder, vector_address(builder, vector, pointer, index), _alignment(vector))


load: Callable[[Pointer[Any], int], Any] = define(lambda pointer, index: vector_behind(pointer), _emit_load)
"""``load(pointer, i)``: the values i .. i + 8, unaligned."""
load_volatile: Callable[[Pointer[Any], int], Any] = define(
    lambda pointer, index: vector_behind(pointer), _emit_volatile_load
)
"""``load`` for values that are blended and stored back; the package's notes say why."""


def _emit_store(builder: Any, sig: Any, pointer: Any, index: Any, value: Any) -> Any:
    vector = sig.args[2]
    builder.store(value, vector_address(builder, vector, pointer, index), align=_alignment(vector))
    return ir.Constant(I32, 0)


store: Callable[[Pointer[Any], int, Any], int] = define(
    lambda pointer, index, value: types.int32 if vector_behind(pointer) is value else None, _emit_store
)
"""``store(pointer, i, v)``: write the values i .. i + 8, unaligned."""


@intrinsic
def store_where(typing_context: Any, pointer: Any, index: Any, mask: Any, value: Any) -> Any:
    """``store_where(pointer, i, mask, v)``: write the lanes in the mask to the values i .. i + 8.

    A masked store with AVX-512; elsewhere all lanes are stored, those outside of the mask with their old values. Values
    that are loaded again soon are better blended by the caller: a masked store does not forward to a load.
    """
    if vector_behind(pointer) is not value or mask is not m8 or value is f64x8:
        return None

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer, index, mask, new = args
        address = vector_address(builder, value, pointer, index)
        if has_feature(context, "avx512vl"):
            name = f"llvm.masked.store.v8{value.llvm.element.intrinsic_name}.p0"
            call_llvm(builder, name, ir.VoidType(), [new, address, ir.Constant(I32, 4), mask])
        else:
            old = _volatile_load(builder, address, 4)
            builder.store(builder.select(mask, new, old), address, align=4)
        return ir.Constant(I32, 0)

    return types.int32(pointer, types.int64, mask, value), generate


class _LaneAddresses(ir.instructions.GEPInstr):  # type: ignore[misc]  # llvmlite has no types
    """The addresses of the values behind a pointer at each lane of a vector of indices."""

    def __init__(self, builder: Any, pointer: Any, indices: Any) -> None:
        super().__init__(builder.block, pointer, [ir.Constant(I32, 0)], False, "")
        self.type = ir.VectorType(pointer.type, LANES)
        self.indices = [indices]
        self.operands = [pointer, indices]


@intrinsic
def _gather(typing_context: Any, pointer: Any, indices: Any) -> Any:
    vector = vector_behind(pointer)
    if vector is None or indices is not i32x8:
        return None

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        alignment, values = _alignment(vector), ir.Constant(vector.llvm, ir.Undefined)
        if has_feature(context, "clzero"):  # AMD
            for lane in range(LANES):
                address = builder.gep(args[0], [offset_of(builder, args[1], lane)])
                value = builder.load(address, align=alignment)
                values = builder.insert_element(values, value, ir.Constant(I32, lane))
            return values
        addresses = _LaneAddresses(builder, *args)
        insert(builder, addresses)
        all_lanes = ir.Constant(ir.VectorType(I1, LANES), [1] * LANES)
        name = f"llvm.masked.gather.v8{vector.llvm.element.intrinsic_name}.v8p0"
        return call_llvm(builder, name, vector.llvm, [addresses, ir.Constant(I32, alignment), all_lanes, values])

    return vector(pointer, indices), generate


gather: Callable[[Pointer[Any], I32x8], Any] = _gather
"""``gather(pointer, indices)``: the value at each lane of an i32x8. LLVM chooses one instruction where it is faster
than eight loads: on Intel since Skylake (half the time). It also does for Zen 4, which takes longer with it."""


def _emit_prefetch(builder: Any, sig: Any, pointer: Any, index: Any) -> Any:
    address = builder.bitcast(builder.gep(pointer, [index]), I8.as_pointer())
    read, high_locality, data_cache = ir.Constant(I32, 0), ir.Constant(I32, 3), ir.Constant(I32, 1)
    call_llvm(builder, "llvm.prefetch.p0", ir.VoidType(), [address, read, high_locality, data_cache])
    return ir.Constant(I32, 0)


prefetch = define(lambda pointer, index: types.int32 if isinstance(pointer, types.CPointer) else None, _emit_prefetch)
"""``prefetch(pointer, i)``: fetch the cache line of value i; the address need not be valid."""
