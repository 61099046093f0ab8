"""Raw pointers in kernels.

Array arguments of functions that are not inlined cost reference counts (atomics) and negative-index arithmetic, 40 to
60 ns per triangle. Entry points therefore take one small table of addresses; below them everything is a C pointer,
``p[i]`` reads and writes without a check. Whoever fills the table keeps the arrays alive while kernels run.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray


def address_of(array: NDArray[Any] | None, dtype: type[np.generic]) -> int:
    """Address of the first value of a C-contiguous array; 0 for None.

    Raises:
        TypeError: another dtype, or not C-contiguous: a kernel would read something else.
    """
    if array is None:
        return 0
    if array.dtype != dtype or not array.flags.c_contiguous:
        raise TypeError(f"an array of {array.dtype}, {array.shape} must be C-contiguous {np.dtype(dtype)}")
    address: int = array.__array_interface__["data"][0]  # a third of the time of array.ctypes.data
    return address


Table = tuple[NDArray[np.int64], memoryview, int]
"""An array, its memory, its address."""


def table(values: int) -> Table:
    """(values,) int64, all 0, at least one; its memory; its address, at a fraction of what ``address_of`` takes."""
    array = np.zeros(values, np.int64)
    memory = array.data
    return array, memory, ctypes.addressof(ctypes.c_char.from_buffer(memory))


def _pointer_to(element: Any) -> Any:
    def cast(typing_context: Any, address: Any) -> tuple[Any, Callable[..., Any]]:
        pointer: Any = types.CPointer(element)

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return builder.inttoptr(args[0], context.get_value_type(pointer))

        return pointer(types.int64), generate

    return intrinsic(cast)


f32_at = _pointer_to(types.float32)
"""``f32_at(address)``: a pointer to float32 values."""
f64_at = _pointer_to(types.float64)
"""A pointer to float64 values."""
i32_at = _pointer_to(types.int32)
"""A pointer to int32 values."""
i64_at = _pointer_to(types.int64)
"""A pointer to int64 values."""
u32_at = _pointer_to(types.uint32)
"""A pointer to uint32 values."""
u8_at = _pointer_to(types.uint8)
"""A pointer to bytes."""
u16_at = _pointer_to(types.uint16)
"""A pointer to uint16 values."""


def _same_place_as(element: Any) -> Any:
    def cast(typing_context: Any, pointer: Any) -> tuple[Any, Callable[..., Any]]:
        wanted: Any = types.CPointer(element)

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return builder.bitcast(args[0], context.get_value_type(wanted))

        return wanted(pointer), generate

    return intrinsic(cast)


as_f32 = _same_place_as(types.float32)
"""``as_f32(pointer)``: the same place as float32 values."""
as_i32 = _same_place_as(types.int32)
"""The same place as int32 values."""
as_i64 = _same_place_as(types.int64)
"""The same place as int64 values."""
as_u32 = _same_place_as(types.uint32)
"""The same place as uint32 values."""
