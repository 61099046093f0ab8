"""Arithmetic, comparisons and conversions of vectors, lane by lane, and reductions to one number."""

from collections.abc import Callable
from typing import Any

from renderers.compiler.numba_typing import ir, types
from renderers.compiler.simd.vectors import (
    I1,
    I8,
    I32,
    I64,
    LANES,
    F32x8,
    F64x8,
    I32x8,
    Lanes,
    Mask8,
    Vector,
    call_llvm,
    compare,
    define,
    f32x8,
    f64x8,
    i32x8,
    m8,
)


def _same_vector(a: Any, b: Any) -> Any:
    return a if isinstance(a, Vector) and a is b else None


minimum: Callable[[Lanes, Lanes], Lanes] = define(
    _same_vector, lambda builder, sig, a, b: builder.select(compare(builder, sig.return_type, "<", a, b), a, b)
)
"""``minimum(a, b)``: the smaller value; ``b`` where one is NaN."""
maximum: Callable[[Lanes, Lanes], Lanes] = define(
    _same_vector, lambda builder, sig, a, b: builder.select(compare(builder, sig.return_type, ">", a, b), a, b)
)
"""``maximum(a, b)``: the larger value; ``b`` where one is NaN."""
less_unsigned: Callable[[I32x8, I32x8], Mask8] = define(
    lambda a, b: m8 if a is i32x8 and b is i32x8 else None, lambda builder, sig, a, b: builder.icmp_unsigned("<", a, b)
)
"""``less_unsigned(a, b)``: mask of the lanes where ``a < b`` as unsigned integers."""
select: Callable[[Mask8, Lanes, Lanes], Lanes] = define(
    lambda mask, a, b: _same_vector(a, b) if mask is m8 else None,
    lambda builder, sig, mask, a, b: builder.select(mask, a, b),
)
"""``select(mask, a, b)``: ``a`` where the mask is set, else ``b``."""


def _float_function(name: str) -> Any:
    def emit(builder: Any, sig: Any, value: Any) -> Any:
        suffix = "v8f32" if sig.return_type is f32x8 else "v8f64"
        return call_llvm(builder, f"llvm.{name}.{suffix}", value.type, [value])

    return define(lambda a: a if isinstance(a, Vector) and a.is_float else None, emit)


rint: Callable[[Lanes], Lanes] = _float_function("rint")
"""The nearest integer, ties to even."""
ceil: Callable[[Lanes], Lanes] = _float_function("ceil")
floor: Callable[[Lanes], Lanes] = _float_function("floor")
absolute: Callable[[Lanes], Lanes] = _float_function("fabs")
sqrt: Callable[[Lanes], Lanes] = _float_function("sqrt")
"""The square root, correctly rounded on every machine."""


def _emit_to_f32(builder: Any, sig: Any, value: Any) -> Any:
    return (builder.sitofp if sig.args[0] is i32x8 else builder.fptrunc)(value, f32x8.llvm)


def _emit_to_f64(builder: Any, sig: Any, value: Any) -> Any:
    return (builder.sitofp if sig.args[0] is i32x8 else builder.fpext)(value, f64x8.llvm)


to_f32: Callable[[I32x8 | F64x8], F32x8] = define(lambda a: f32x8 if a in (i32x8, f64x8) else None, _emit_to_f32)
to_f64: Callable[[I32x8 | F32x8], F64x8] = define(lambda a: f64x8 if a in (i32x8, f32x8) else None, _emit_to_f64)
to_i32: Callable[[F32x8 | F64x8], I32x8] = define(
    lambda a: i32x8 if a in (f32x8, f64x8) else None, lambda builder, sig, value: builder.fptosi(value, i32x8.llvm)
)
"""The integer towards 0; undefined for values outside of int32."""
float_bits: Callable[[F32x8], I32x8] = define(
    lambda a: i32x8 if a is f32x8 else None, lambda builder, sig, value: builder.bitcast(value, i32x8.llvm)
)
"""The bit patterns of float32 values, i32x8."""

movemask: Callable[[Mask8], int] = define(
    lambda mask: types.int64 if mask is m8 else None,
    lambda builder, sig, mask: builder.zext(builder.bitcast(mask, I8), I64),
)
"""int64 of a mask: bit k is set where lane k is."""
lowest_bit: Callable[[int], int] = define(
    lambda value: types.int64 if value is types.int64 else None,
    lambda builder, sig, value: builder.cttz(value, ir.Constant(I1, 1)),
)
"""Index of the lowest set bit of an int64 that is not 0."""


def _emit_count_bits(builder: Any, sig: Any, value: Any) -> Any:
    suffix = "i64" if value.type == I64 else f"v{LANES}i32"
    return call_llvm(builder, f"llvm.ctpop.{suffix}", value.type, [value])


count_bits = define(lambda value: value if value in (types.int64, i32x8) else None, _emit_count_bits)
"""Number of set bits of an int64, or of each lane of an i32x8."""


def _reduction(name: str) -> Any:
    def emit(builder: Any, sig: Any, value: Any) -> Any:
        return builder.sext(call_llvm(builder, f"llvm.vector.reduce.{name}.v8i32", I32, [value]), I64)

    return define(lambda a: types.int64 if a is i32x8 else None, emit)


minimum_of: Callable[[I32x8], int] = _reduction("smin")
"""int64: the smallest lane of an i32x8."""
maximum_of: Callable[[I32x8], int] = _reduction("smax")
"""int64: the largest lane of an i32x8."""
or_of: Callable[[I32x8], int] = _reduction("or")
"""int64: the bitwise or of the lanes of an i32x8."""
