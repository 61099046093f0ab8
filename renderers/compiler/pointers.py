"""C pointers in kernels, and the memory that Python gives them.

Passing arrays between functions that are not inlined costs reference counts and negative-index arithmetic, 40 to 60 ns
per triangle. Kernels therefore take addresses of arrays and structs (``renderers.compiler.structs``) and work on C
pointers: ``p[i]`` reads and writes without a check. The Python caller keeps the arrays alive while a kernel runs.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from renderers.compiler.kernel_types import F32, F64, I32, I64, U8, U32, Pointer, numba_type
from renderers.compiler.numba_typing import intrinsic, ir, types

CACHE_LINE: Final = 64


def address_of(array: NDArray[Any] | None, dtype: type[np.generic] | np.dtype[Any]) -> int:
    """Return the address of a C-contiguous array's first value; 0 for None.

    Raises:
        TypeError: the array has another dtype or is not C-contiguous. A kernel would misread it.
    """
    if array is None:
        return 0
    if array.dtype != dtype or not array.flags.c_contiguous:
        raise TypeError(f"an array of {array.dtype}, {array.shape} must be C-contiguous {np.dtype(dtype)}")
    return array.ctypes.data


def aligned(shape: tuple[int, ...], dtype: DTypeLike) -> tuple[NDArray[Any], int]:
    """Return an uninitialised C-contiguous array that begins with a cache line, and its address.

    NumPy's own arrays begin 16 bytes after one: every second vector would straddle two lines and take twice the time.
    """
    nbytes = math.prod(shape) * np.dtype(dtype).itemsize
    raw = np.empty(nbytes + CACHE_LINE, np.uint8)
    address = address_of(raw, np.uint8)
    skipped = -address % CACHE_LINE
    return raw[skipped : skipped + nbytes].view(dtype).reshape(shape), address + skipped


def aligned_parts(sizes: Mapping[str, int]) -> tuple[NDArray[np.uint8], dict[str, int]]:
    """Return uninitialised memory, and the addresses of its parts by name, given their sizes in bytes.

    Each part begins with a cache line.
    """
    offsets, end = {}, 0
    for name, nbytes in sizes.items():
        offsets[name] = end
        end += -(-nbytes // CACHE_LINE) * CACHE_LINE
    memory, address = aligned((end,), np.uint8)
    for name in offsets:
        offsets[name] += address
    return memory, offsets


def _pointer_to(scalar: Any) -> Any:
    def cast(typing_context: Any, address: Any) -> tuple[Any, Callable[..., Any]]:
        pointer: Any = types.CPointer(scalar)

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return builder.inttoptr(args[0], context.get_value_type(pointer))

        return pointer(types.int64), generate

    return intrinsic(cast)


f32_at: Callable[[int], Pointer[F32]] = _pointer_to(types.float32)
"""``f32_at(address)``: a pointer to float32."""
f64_at: Callable[[int], Pointer[F64]] = _pointer_to(types.float64)
i32_at: Callable[[int], Pointer[I32]] = _pointer_to(types.int32)
i64_at: Callable[[int], Pointer[I64]] = _pointer_to(types.int64)
u32_at: Callable[[int], Pointer[U32]] = _pointer_to(types.uint32)
u8_at: Callable[[int], Pointer[U8]] = _pointer_to(types.uint8)


def _cast_to(scalar: Any) -> Any:
    def cast(typing_context: Any, pointer: Any) -> tuple[Any, Callable[..., Any]]:
        target: Any = types.CPointer(scalar)

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return builder.bitcast(args[0], context.get_value_type(target))

        return target(pointer), generate

    return intrinsic(cast)


as_f32: Callable[[Pointer[Any]], Pointer[F32]] = _cast_to(types.float32)
"""``as_f32(pointer)``: the same address as a pointer to float32."""
as_i32: Callable[[Pointer[Any]], Pointer[I32]] = _cast_to(types.int32)
as_u32: Callable[[Pointer[Any]], Pointer[U32]] = _cast_to(types.uint32)


@intrinsic
def advance(typing_context: Any, pointer: Any, count: Any) -> Any:
    """``advance(pointer, n)``: a pointer to the value ``n`` (int64) further on, as C's ``pointer + n``."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.gep(args[0], [args[1]])

    return pointer(pointer, types.int64), generate


@intrinsic
def address(typing_context: Any, pointer: Any) -> Any:
    """Return a pointer's or struct's address as int64."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.ptrtoint(args[0], ir.IntType(64))

    return types.int64(pointer), generate


def stack_array(scalar: Any, count: int) -> Any:
    """Return a function for kernels: no arguments, returns a pointer to ``count`` uninitialised values on the stack.

    The memory is valid until the calling device function returns. All calls within one function return the same memory.
    """

    value_type = numba_type(scalar)

    def allocate(typing_context: Any) -> tuple[Any, Callable[..., Any]]:
        pointer: Any = types.CPointer(value_type)

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            with builder.goto_entry_block():
                memory = builder.alloca(ir.ArrayType(context.get_data_type(value_type), count))
            return builder.bitcast(memory, context.get_value_type(pointer))

        return pointer(), generate

    return intrinsic(allocate)


@intrinsic
def allocate(typing_context: Any, nbytes: Any) -> Any:
    """Return the address of new uninitialised memory of ``nbytes`` (int64) bytes; ``release`` frees it."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.ptrtoint(context.nrt.allocate(builder, args[0]), ir.IntType(64))

    return types.int64(types.int64), generate


@intrinsic
def release(typing_context: Any, address: Any) -> Any:
    """Free memory from ``allocate``."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        context.nrt.free(builder, builder.inttoptr(args[0], ir.IntType(8).as_pointer()))
        return ir.Constant(ir.IntType(32), 0)

    return types.int32(types.int64), generate
