"""Reading arrays by address inside kernels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def _loader(numba_type: Any, llvm_type: ir.Type) -> Any:
    def load(typing_context: Any, address: Any, index: Any) -> tuple[Any, Callable[..., Any]]:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            pointer = builder.inttoptr(args[0], llvm_type.as_pointer())
            return builder.load(builder.gep(pointer, [args[1]]))

        return numba_type(types.int64, types.int64), generate

    return intrinsic(load)


load_f32 = _loader(types.float32, ir.FloatType())
"""``load_f32(address, i)``: the i-th float32 behind an int64 address."""
load_u32 = _loader(types.uint32, ir.IntType(32))
"""``load_u32(address, i)``: the i-th uint32."""
load_u8 = _loader(types.uint8, ir.IntType(8))
"""``load_u8(address, i)``: the i-th byte."""
load_i64 = _loader(types.int64, ir.IntType(64))
"""``load_i64(address, i)``: the i-th int64."""
