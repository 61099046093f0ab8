"""Moves of lanes within vectors."""

from collections.abc import Callable
from typing import Any

from renderers.compiler.numba_typing import intrinsic, ir, types
from renderers.compiler.simd.vectors import (
    I32,
    LANES,
    Lanes,
    Mask8,
    call_llvm,
    define,
    f32x8,
    f64x8,
    has_feature,
    i32x8,
    lane_of,
    m8,
)

lane = define(
    lambda value, lane: value.element if value in (f32x8, f64x8, i32x8) and isinstance(lane, types.Integer) else None,
    lambda builder, sig, value, lane: builder.extract_element(value, lane),
)
"""``lane(v, k)``: lane k, a number."""


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


compress: Callable[[Mask8, Lanes], Lanes] = define(
    lambda mask, value: value if mask is m8 and value in (f32x8, i32x8) else None, _emit_compress
)
"""``compress(mask, v)``: the lanes in the mask, moved together to the first lanes; the others are undefined. One
instruction with AVX-512."""
