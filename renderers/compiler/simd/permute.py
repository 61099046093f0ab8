"""Lanes by number: from another vector, and from the rows of a texture."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from renderers.compiler.simd.vectors import I1, I8, I32, I64, LANES, Vector, f32x8, i32x8, intrinsic, m8, make, shuffle


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


from_bits = make(
    lambda a: f32x8 if a is i32x8 else None, lambda builder, sig, value: builder.bitcast(value, f32x8.llvm)
)
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
def has_compress(typing_context: Any) -> Any:
    """Whether ``compress`` is one instruction: known when a kernel is compiled."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return ir.Constant(I1, int("+avx512vl" in context.codegen().magic_tuple()[2]))

    return types.boolean(), generate


def _emit_lanes(builder: Any, sig: Any, value: Any) -> Any:
    return builder.bitcast(builder.trunc(value, I8), ir.VectorType(I1, LANES))


mask_of = make(lambda value: m8 if value is types.int64 else None, _emit_lanes)
"""The mask whose lane k is set where bit k of an int64 is."""
