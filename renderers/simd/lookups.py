"""Lanes by number: from another vector, and from the rows of a texture."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from renderers.simd.moves import VolatileLoad
from renderers.simd.vectors import I8, I32, I64, LANES, Vector, f32x8, i32x8, intrinsic, make, shuffle


@intrinsic
def permute(typing_context: Any, value: Any, lanes: Any) -> Any:
    """In every lane the lane of a vector that an i32x8 says, 0 .. 7."""
    if not isinstance(value, Vector) or value not in (f32x8, i32x8) or lanes is not i32x8:
        return None

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if "+avx2" in context.codegen().magic_tuple()[2]:
            name = "llvm.x86.avx2.permps" if value.is_float else "llvm.x86.avx2.permd"
            kind = ir.FunctionType(value.llvm, [value.llvm, i32x8.llvm])
            declare: Any = cgutils.get_or_insert_function
            return builder.call(declare(builder.module, kind, name), args)
        out = ir.Constant(value.llvm, ir.Undefined)
        for lane in range(LANES):
            k = ir.Constant(I32, lane)
            out = builder.insert_element(out, builder.extract_element(args[0], builder.extract_element(args[1], k)), k)
        return out

    return value(value, lanes), generate


float_of = make(lambda a: f32x8 if a is i32x8 else None, lambda builder, sig, value: builder.bitcast(value, f32x8.llvm))
"""The float32 values of bit patterns."""


def _squares(builder: Any, values: Any, offsets: list[Any], stride: Any) -> list[Any]:
    """The four vectors of ``gather_squares`` from eight int64."""
    rows = values, builder.gep(values, [stride])
    pairs = ir.VectorType(I64, 4)
    fours: list[list[Any]] = [[ir.Constant(pairs, ir.Undefined)] * 2, [ir.Constant(pairs, ir.Undefined)] * 2]
    for lane, offset in enumerate(offsets):
        # Lanes 0, 1, 4, 5 and 2, 3, 6, 7: the halves of registers are then shuffled each by themselves.
        which, slot = lane // 2 % 2, ir.Constant(I32, lane // 4 * 2 + lane % 2)
        for row in range(2):
            place = builder.bitcast(builder.gep(rows[row], [offset]), I64.as_pointer())
            fours[row][which] = builder.insert_element(fours[row][which], builder.load(place, align=4), slot)
    parts: list[Any] = []
    for row in range(2):
        first, second = (builder.bitcast(four, i32x8.llvm) for four in fours[row])
        parts += [shuffle(builder, first, second, [pick + k for pick in (0, 2, 8, 10, 4, 6, 12, 14)]) for k in range(2)]
    return parts


@intrinsic
def gather_squares(typing_context: Any, values: Any, indices: Any, stride: Any) -> Any:
    """Four i32x8: the int32 at ``indices[lane]`` behind a pointer, the one after it, and the same ``stride`` (an int64)
    further on. Indices are at least 0."""
    out: Any = types.UniTuple(i32x8, 4)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        lanes = [builder.extract_element(args[1], ir.Constant(I32, lane)) for lane in range(LANES)]
        offsets = [builder.zext(lane, I64) for lane in lanes]
        return context.make_tuple(builder, out, _squares(builder, args[0], offsets, args[2]))

    return out(values, indices, stride), generate


@intrinsic
def load_squares(typing_context: Any, values: Any, indices: Any, begin: Any, stride: Any) -> Any:
    """As ``gather_squares`` with the eight indices from value ``begin`` on behind a pointer to values of four bytes,
    stored there long enough ago: loading them one by one is cheaper than taking a vector apart."""
    out: Any = types.UniTuple(i32x8, 4)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        first = builder.bitcast(builder.gep(args[1], [args[2]]), I32.as_pointer())
        lanes = [VolatileLoad(builder.block, builder.gep(first, [ir.Constant(I64, k)])) for k in range(LANES)]
        for load in lanes:  # volatile, or LLVM makes one vector of them and takes it apart
            load.align = 4
            builder._insert(load)
        offsets = [builder.zext(lane, I64) for lane in lanes]
        return context.make_tuple(builder, out, _squares(builder, args[0], offsets, args[3]))

    return out(values, indices, types.int64, stride), generate


@intrinsic
def prefetch_squares(typing_context: Any, values: Any, indices: Any, stride: Any) -> Any:
    """Fetch the cache lines of the int32 at ``indices[lane]`` behind a pointer and ``stride`` (an int64) further on,
    which may lie anywhere. The result means nothing."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        rows = args[0], builder.gep(args[0], [args[2]])
        byte = I8.as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, I32, I32, I32])
        declare: Any = cgutils.get_or_insert_function
        function = declare(builder.module, kind, "llvm.prefetch.p0")
        read, soon, data = ir.Constant(I32, 0), ir.Constant(I32, 3), ir.Constant(I32, 1)
        for lane in range(LANES):
            offset = builder.zext(builder.extract_element(args[1], ir.Constant(I32, lane)), I64)
            for row in rows:
                builder.call(function, [builder.bitcast(builder.gep(row, [offset]), byte), read, soon, data])
        return ir.Constant(I32, 0)

    return types.int32(values, indices, stride), generate
