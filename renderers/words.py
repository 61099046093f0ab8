"""Many bytes at a time: unaligned words behind a pointer, where they differ, and a word's lowest set bit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def _load(typing_context: Any, pointer: Any, index: Any) -> tuple[Any, Callable[..., Any]]:
    """``load_word(pointer, i)``: bytes i .. i + 7 behind a pointer to bytes, the first one lowest."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        place = builder.bitcast(builder.gep(args[0], [args[1]]), ir.IntType(64).as_pointer())
        return builder.load(place, align=1)

    return types.uint64(pointer, types.int64), generate


def _store(typing_context: Any, pointer: Any, index: Any, word: Any) -> tuple[Any, Callable[..., Any]]:
    """``store_word(pointer, i, word)``: the inverse of ``load_word``."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        place = builder.bitcast(builder.gep(args[0], [args[1]]), ir.IntType(64).as_pointer())
        builder.store(args[2], place, align=1)
        return context.get_dummy_value()

    return types.void(pointer, types.int64, types.uint64), generate


def _low_zeros(typing_context: Any, word: Any) -> tuple[Any, Callable[..., Any]]:
    """``low_zeros(word)``: zero bits below the lowest one that is set; 64 for zero."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 0))

    return types.int64(types.uint64), generate


def _differing(typing_context: Any, pointer: Any, index: Any, other: Any) -> tuple[Any, Callable[..., Any]]:
    """``differing(pointer, i, j)``: which of the 64 bytes behind i are not those behind j, the first one lowest."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        many = ir.VectorType(ir.IntType(8), 64).as_pointer()
        a, b = (
            builder.load(builder.bitcast(builder.gep(args[0], [place]), many), align=1) for place in (args[1], args[2])
        )
        return builder.bitcast(builder.icmp_unsigned("!=", a, b), ir.IntType(64))

    return types.uint64(pointer, types.int64, types.int64), generate


load_word: Any = intrinsic(_load)
store_word: Any = intrinsic(_store)
low_zeros: Any = intrinsic(_low_zeros)
differing: Any = intrinsic(_differing)
