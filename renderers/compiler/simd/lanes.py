"""Moves of lanes within vectors."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types

from renderers.compiler.simd.vectors import (
    I32,
    LANES,
    Vector,
    call_llvm,
    define,
    f32x8,
    has_feature,
    i32x8,
    intrinsic,
    lane_of,
    m8,
    shuffle,
)


def _numbers(a: Any) -> Any:
    return a if isinstance(a, Vector) and a is not m8 else None


def _rearrangement(picks: list[int]) -> Any:
    return define(_numbers, lambda builder, sig, value: shuffle(builder, value, value, picks))


broadcast_lane0, broadcast_lane1, broadcast_lane2, broadcast_lane3, broadcast_lane4, broadcast_lane5 = (
    _rearrangement([lane] * LANES) for lane in range(6)
)
"""``broadcast_lane3(v)``: lane 3 in all lanes."""
swapped = _rearrangement([1, 0, 3, 2, 5, 4, 7, 6])
"""Every two neighbouring lanes exchanged."""
swapped_pairs = _rearrangement([2, 3, 0, 1, 6, 7, 4, 5])
"""Every two neighbouring pairs of lanes exchanged."""


def _lane(lane: int) -> Any:
    return define(
        lambda a: types.int32 if a is i32x8 else None, lambda builder, sig, value: lane_of(builder, value, lane)
    )


lane0, lane4 = _lane(0), _lane(4)
"""``lane4(v)``: lane 4 of an i32x8, int32."""


@intrinsic
def permute(typing_context: Any, value: Any, lanes: Any) -> Any:
    """``permute(v, lanes)``: lane k is lane ``lanes[k]`` of ``v``; ``lanes`` is an i32x8 of 0 .. 7."""
    if value not in (f32x8, i32x8) or lanes is not i32x8:
        return None

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        source, picks = args
        if has_feature(context, "avx2"):
            name = "llvm.x86.avx2.permps" if value.is_float else "llvm.x86.avx2.permd"
            return call_llvm(builder, name, value.llvm, [source, picks])
        result = ir.Constant(value.llvm, ir.Undefined)
        for lane in range(LANES):
            picked = builder.extract_element(source, lane_of(builder, picks, lane))
            result = builder.insert_element(result, picked, ir.Constant(I32, lane))
        return result

    return value(value, lanes), generate


def _emit_compress(builder: Any, sig: Any, mask: Any, value: Any) -> Any:
    name = f"llvm.experimental.vector.compress.v8{value.type.element.intrinsic_name}"
    return call_llvm(builder, name, value.type, [value, mask, ir.Constant(value.type, ir.Undefined)])


compress = define(lambda mask, value: value if mask is m8 and value in (f32x8, i32x8) else None, _emit_compress)
"""``compress(mask, v)``: the lanes in the mask, moved together to the first lanes; the others are undefined. One
instruction with AVX-512."""
