"""The vector types, their operators and arithmetic."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, ClassVar, Final

from llvmlite import ir
from numba import extending, types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model

LANES: Final = 8

intrinsic: Any = extending.intrinsic

I1, I8, I32, I64 = ir.IntType(1), ir.IntType(8), ir.IntType(32), ir.IntType(64)
F32, F64 = ir.FloatType(), ir.DoubleType()


class Vector(types.Type):
    """Eight values of one scalar type."""

    def __init__(self, name: str, element: Any, llvm: ir.Type) -> None:
        self.element = element
        self.llvm = ir.VectorType(llvm, LANES)
        self.is_float = isinstance(llvm, (ir.FloatType, ir.DoubleType))
        super().__init__(name)


f32x8: Final = Vector("f32x8", types.float32, F32)
f64x8: Final = Vector("f64x8", types.float64, F64)
i32x8: Final = Vector("i32x8", types.int32, I32)
m8: Final = Vector("m8", types.boolean, I1)


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Vector) -> None:
        super().__init__(manager, numba_type, numba_type.llvm)  # type: ignore[no-untyped-call]  # llvmlite's


def _operators() -> None:
    """Register ``+ - * / & | ^ >> <<``, unary ``- ~`` and the comparisons."""
    floats: dict[Any, str] = {
        operator.add: "fadd",
        operator.sub: "fsub",
        operator.mul: "fmul",
        operator.truediv: "fdiv",
    }
    integers: dict[Any, str] = {
        operator.add: "add",
        operator.sub: "sub",
        operator.mul: "mul",
        operator.and_: "and_",
        operator.or_: "or_",
        operator.xor: "xor",
        operator.rshift: "ashr",
        operator.lshift: "shl",
    }
    comparisons = {
        operator.lt: "<",
        operator.le: "<=",
        operator.gt: ">",
        operator.ge: ">=",
        operator.eq: "==",
        operator.ne: "!=",
    }

    register_template: Any = infer_global
    register_lowering: Any = lower_builtin
    make_signature: Any = signature

    def register(key: Any) -> None:
        class Template(AbstractTemplate):
            metadata: ClassVar[dict[str, str]] = {"target": "cpu"}  # type: ignore[misc]  # tried before Numba's own

            def generic(self, args: Any, kws: Any) -> Any:
                a = args[0]
                if not all(isinstance(v, Vector) and v is a for v in args) or kws:
                    return None
                return make_signature(m8 if key in comparisons else a, *args)

        register_template(key)(Template)

        def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            a = sig.args[0]
            if key in comparisons:
                compare = builder.fcmp_ordered if a.is_float else builder.icmp_signed
                return compare(comparisons[key], *args)
            if len(args) == 1:
                return (
                    builder.fneg(args[0])
                    if a.is_float
                    else (builder.neg(args[0]) if key is operator.neg else builder.not_(args[0]))
                )
            return getattr(builder, (floats if a.is_float else integers)[key])(*args)

        register_lowering(key, *([Vector] * (1 if key in (operator.neg, operator.invert) else 2)))(lower)

    for key in {*floats, *integers, *comparisons, operator.neg, operator.invert}:
        register(key)


_operators()


def make(result: Callable[..., Any], emit: Callable[..., Any]) -> Any:
    """An intrinsic of one to three arguments: ``result`` gives its type from theirs (None: not for these)."""

    def build(*types_of_arguments: Any) -> Any:
        out = result(*types_of_arguments)
        if out is None:
            return None

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return emit(builder, sig, *args)

        return out(*types_of_arguments), generate

    count = result.__code__.co_argcount
    if count == 1:
        return intrinsic(lambda typing_context, a: build(a))
    if count == 2:
        return intrinsic(lambda typing_context, a, b: build(a, b))
    return intrinsic(lambda typing_context, a, b, c: build(a, b, c))


def _splat_of(builder: Any, vector: Vector, value: Any) -> Any:
    first = builder.insert_element(ir.Constant(vector.llvm, ir.Undefined), value, ir.Constant(I32, 0))
    zeros = ir.Constant(ir.VectorType(I32, LANES), [0] * LANES)
    return builder.shuffle_vector(first, ir.Constant(vector.llvm, ir.Undefined), zeros)


def _splat(vector: Vector) -> Any:
    def emit(builder: Any, sig: Any, value: Any) -> Any:
        given, wanted = sig.args[0], vector.llvm.element
        if isinstance(given, types.Integer):
            if vector.is_float:
                value = builder.sitofp(value, wanted)
            elif value.type.width > 32:
                value = builder.trunc(value, wanted)
        elif value.type != wanted:
            value = builder.fptrunc(value, wanted) if wanted == F32 else builder.fpext(value, wanted)
        return _splat_of(builder, vector, value)

    def result(a: Any) -> Any:
        return vector if isinstance(a, types.Integer) or (vector.is_float and isinstance(a, types.Float)) else None

    return make(result, emit)


f32 = _splat(f32x8)
"""``f32(scalar)``: the value, rounded to float32, in all lanes."""
f64 = _splat(f64x8)
"""``f64(scalar)``: the value in all lanes."""
i32 = _splat(i32x8)
"""``i32(integer)``: the value's low 32 bits in all lanes."""


@intrinsic
def iota(typing_context: Any) -> Any:
    """i32x8: 0, 1, .. 7."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return ir.Constant(i32x8.llvm, list(range(LANES)))

    return i32x8(), generate


def insert(builder: Any, instruction: Any) -> None:
    """Insert an instruction of a class that llvmlite's builder has no method for."""
    builder._insert(instruction)  # noqa: SLF001 - llvmlite has no public way


def shuffle(builder: Any, a: Any, b: Any, picks: list[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(I32, len(picks)), picks))


def _spread(lane: int) -> Any:
    def emit(builder: Any, sig: Any, value: Any) -> Any:
        return shuffle(builder, value, value, [lane] * LANES)

    return make(lambda a: a if isinstance(a, Vector) and a is not m8 else None, emit)


(
    broadcast_lane0,
    broadcast_lane1,
    broadcast_lane2,
    broadcast_lane3,
    broadcast_lane4,
    broadcast_lane5,
    broadcast_lane6,
    broadcast_lane7,
) = (_spread(lane) for lane in range(LANES))
"""``broadcast_lane3(v)``: lane 3 of the vector in all lanes."""


def _rearrangement(picks: list[int]) -> Any:
    def emit(builder: Any, sig: Any, value: Any) -> Any:
        return shuffle(builder, value, value, picks)

    return make(lambda a: a if isinstance(a, Vector) and a is not m8 else None, emit)


low_twice = _rearrangement([0, 1, 2, 3, 0, 1, 2, 3])
"""The first four lanes, twice."""
high_twice = _rearrangement([4, 5, 6, 7, 4, 5, 6, 7])
swapped = _rearrangement([1, 0, 3, 2, 5, 4, 7, 6])
"""Every two lanes change places."""
swapped_pairs = _rearrangement([2, 3, 0, 1, 6, 7, 4, 5])


def _emit_halves(builder: Any, sig: Any, a: Any, b: Any) -> Any:
    return shuffle(builder, a, b, [0, 1, 2, 3, 12, 13, 14, 15])


join_halves = make(lambda a, b: a if isinstance(a, Vector) and a is b and a is not m8 else None, _emit_halves)
"""``join_halves(a, b)``: the first four lanes of ``a`` and the last four of ``b``."""


def _lane(number: int) -> Any:
    def emit(builder: Any, sig: Any, value: Any) -> Any:
        return builder.extract_element(value, ir.Constant(I32, number))

    return make(lambda a: types.int32 if a is i32x8 else None, emit)


lane0, lane4 = _lane(0), _lane(4)
"""``lane4(v)``: int32, lane 4 of the vector."""


def _emit_select(builder: Any, sig: Any, mask: Any, a: Any, b: Any) -> Any:
    return builder.select(mask, a, b)


select = make(lambda mask, a, b: a if mask is m8 and isinstance(a, Vector) and a is b else None, _emit_select)
"""``select(m8, a, b)``: a where the mask is set, else b."""


def _emit_min(builder: Any, sig: Any, a: Any, b: Any) -> Any:
    compare = builder.fcmp_ordered if sig.return_type.is_float else builder.icmp_signed
    return builder.select(compare("<", a, b), a, b)


def _emit_max(builder: Any, sig: Any, a: Any, b: Any) -> Any:
    compare = builder.fcmp_ordered if sig.return_type.is_float else builder.icmp_signed
    return builder.select(compare(">", a, b), a, b)


minimum = make(lambda a, b: a if isinstance(a, Vector) and a is b else None, _emit_min)
"""The smaller of two, lane by lane; the second where one is not a number."""
maximum = make(lambda a, b: a if isinstance(a, Vector) and a is b else None, _emit_max)
"""The larger of two, lane by lane; the second where one is not a number."""


less_unsigned = make(
    lambda a, b: m8 if a is i32x8 and b is i32x8 else None,
    lambda builder, sig, a, b: builder.icmp_unsigned("<", a, b),
)
"""m8: whether the first of two is smaller, both taken as unsigned numbers."""


def _emit_bits(builder: Any, sig: Any, mask: Any) -> Any:
    return builder.zext(builder.bitcast(mask, I8), I64)


movemask = make(lambda mask: types.int64 if mask is m8 else None, _emit_bits)
"""int64: bit k is set where lane k of the mask is."""


def _emit_lowest(builder: Any, sig: Any, value: Any) -> Any:
    return builder.cttz(value, ir.Constant(I1, 1))


lowest_bit = make(lambda value: types.int64 if value is types.int64 else None, _emit_lowest)
"""Index of the lowest set bit of an int64 that is not 0."""


def _emit_highest(builder: Any, sig: Any, value: Any) -> Any:
    return builder.sub(ir.Constant(I64, 63), builder.ctlz(value, ir.Constant(I1, 1)))


highest_bit = make(lambda value: types.int64 if value is types.int64 else None, _emit_highest)
"""Index of the highest set bit of an int64 that is not 0."""


def _emit_count(builder: Any, sig: Any, value: Any) -> Any:
    declare: Any = cgutils.get_or_insert_function
    name = "i64" if value.type == I64 else f"v{LANES}i32"
    return builder.call(
        declare(builder.module, ir.FunctionType(value.type, [value.type]), f"llvm.ctpop.{name}"), [value]
    )


count_bits = make(lambda value: value if value in (types.int64, i32x8) else None, _emit_count)
"""How many bits of an int64, or of each int32, are set."""


def _reduction(name: str) -> Any:
    def emit(builder: Any, sig: Any, value: Any) -> Any:
        kind = ir.FunctionType(I32, [i32x8.llvm])
        declare: Any = cgutils.get_or_insert_function
        return builder.sext(
            builder.call(declare(builder.module, kind, f"llvm.vector.reduce.{name}.v8i32"), [value]), I64
        )

    return make(lambda a: types.int64 if a is i32x8 else None, emit)


minimum_of = _reduction("smin")
"""int64: the smallest of eight int32."""
maximum_of = _reduction("smax")


def _rounding(name: str) -> Any:
    def emit(builder: Any, sig: Any, value: Any) -> Any:
        vector = sig.return_type
        suffix = "v8f32" if vector is f32x8 else "v8f64"
        kind = ir.FunctionType(vector.llvm, [vector.llvm])
        declare: Any = cgutils.get_or_insert_function
        function = declare(builder.module, kind, f"llvm.{name}.{suffix}")
        return builder.call(function, [value])

    return make(lambda a: a if isinstance(a, Vector) and a.is_float else None, emit)


rint = _rounding("rint")
"""To the nearest integer, ties to even."""
ceil = _rounding("ceil")
floor = _rounding("floor")
absolute = _rounding("fabs")
sqrt = _rounding("sqrt")
"""Correctly rounded, on every machine."""


def _emit_to_f32(builder: Any, sig: Any, value: Any) -> Any:
    if sig.args[0] is i32x8:
        return builder.sitofp(value, f32x8.llvm)
    return builder.fptrunc(value, f32x8.llvm)


def _emit_to_f64(builder: Any, sig: Any, value: Any) -> Any:
    return builder.sitofp(value, f64x8.llvm) if sig.args[0] is i32x8 else builder.fpext(value, f64x8.llvm)


def _emit_to_i32(builder: Any, sig: Any, value: Any) -> Any:
    return builder.fptosi(value, i32x8.llvm)


float_bits = make(
    lambda a: i32x8 if a is f32x8 else None, lambda builder, sig, value: builder.bitcast(value, i32x8.llvm)
)
"""The bit patterns of float32 values."""
to_f32 = make(lambda a: f32x8 if a in (i32x8, f64x8) else None, _emit_to_f32)
to_f64 = make(lambda a: f64x8 if a in (i32x8, f32x8) else None, _emit_to_f64)
to_i32 = make(lambda a: i32x8 if a in (f32x8, f64x8) else None, _emit_to_i32)
"""Truncates; the value must fit."""
