"""The vector types and their operators, and what the other files of this package build vector functions with."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Final, Self, TypeVar

import numpy as np

from renderers.compiler.numba_typing import define_operator, extending, intrinsic, ir, types

LANES: Final = 8

I1, I8, I32, I64 = ir.IntType(1), ir.IntType(8), ir.IntType(32), ir.IntType(64)
F32, F64 = ir.FloatType(), ir.DoubleType()


class Vector(types.Type):
    """Numba type of eight values of one scalar type."""

    def __init__(self, name: str, element: Any, llvm: ir.Type) -> None:
        self.element = element
        self.llvm = ir.VectorType(llvm, LANES)
        self.is_float = isinstance(llvm, (ir.FloatType, ir.DoubleType))
        super().__init__(name)


f32x8: Final = Vector("f32x8", types.float32, F32)
f64x8: Final = Vector("f64x8", types.float64, F64)
i32x8: Final = Vector("i32x8", types.int32, I32)
m8: Final = Vector("m8", types.boolean, I1)


class _Lanes:
    """Operators of vectors, lane by lane."""

    if TYPE_CHECKING:

        def __lt__(self, other: Self) -> Mask8: ...
        def __le__(self, other: Self) -> Mask8: ...
        def __gt__(self, other: Self) -> Mask8: ...
        def __ge__(self, other: Self) -> Mask8: ...
        def __eq__(self, other: Self) -> Mask8: ...  # type: ignore[override]  # compares lanes
        def __ne__(self, other: Self) -> Mask8: ...  # type: ignore[override]  # compares lanes
        def __add__(self, other: Self) -> Self: ...
        def __sub__(self, other: Self) -> Self: ...
        def __mul__(self, other: Self) -> Self: ...
        def __neg__(self) -> Self: ...


class _Bits(_Lanes):
    """Operators of vectors of integers."""

    if TYPE_CHECKING:

        def __and__(self, other: Self) -> Self: ...
        def __or__(self, other: Self) -> Self: ...
        def __xor__(self, other: Self) -> Self: ...
        def __lshift__(self, other: Self) -> Self: ...
        def __rshift__(self, other: Self) -> Self: ...
        def __invert__(self) -> Self: ...


class F32x8(_Lanes):
    """Eight float32."""

    numba_type: ClassVar[Any] = f32x8

    if TYPE_CHECKING:

        def __truediv__(self, other: Self) -> Self: ...


class F64x8(_Lanes):
    """Eight float64."""

    numba_type: ClassVar[Any] = f64x8

    if TYPE_CHECKING:

        def __truediv__(self, other: Self) -> Self: ...


class I32x8(_Bits):
    """Eight int32."""

    numba_type: ClassVar[Any] = i32x8


class Mask8(_Bits):
    """Eight booleans: the result of a comparison."""

    numba_type: ClassVar[Any] = m8


F32x8x2 = tuple[F32x8, F32x8]
F32x8x3 = tuple[F32x8, F32x8, F32x8]
F32x8x4 = tuple[F32x8, F32x8, F32x8, F32x8]
F32x8x6 = tuple[F32x8, F32x8, F32x8, F32x8, F32x8, F32x8]
F32x8x8 = tuple[F32x8, F32x8, F32x8, F32x8, F32x8, F32x8, F32x8, F32x8]
F64x8x2 = tuple[F64x8, F64x8]
F64x8x3 = tuple[F64x8, F64x8, F64x8]
I32x8x2 = tuple[I32x8, I32x8]
I32x8x3 = tuple[I32x8, I32x8, I32x8]
Lanes = TypeVar("Lanes", F32x8, F64x8, I32x8)
"""Type variable of functions for several types of vectors."""

_Float = float | np.floating[Any]


@extending.register_model(Vector)
class _VectorModel(extending.models.PrimitiveModel):  # type: ignore[misc]  # without stubs
    def __init__(self, manager: Any, numba_type: Vector) -> None:
        super().__init__(manager, numba_type, numba_type.llvm)


_FLOAT_INSTRUCTIONS: Final[dict[Any, str]] = {
    operator.add: "fadd",
    operator.sub: "fsub",
    operator.mul: "fmul",
    operator.truediv: "fdiv",
    operator.neg: "fneg",
}
_INTEGER_INSTRUCTIONS: Final[dict[Any, str]] = {
    operator.add: "add",
    operator.sub: "sub",
    operator.mul: "mul",
    operator.and_: "and_",
    operator.or_: "or_",
    operator.xor: "xor",
    operator.rshift: "ashr",
    operator.lshift: "shl",
    operator.neg: "neg",
    operator.invert: "not_",
}
_COMPARISONS: Final[dict[Any, str]] = {
    operator.lt: "<",
    operator.le: "<=",
    operator.gt: ">",
    operator.ge: ">=",
    operator.eq: "==",
    operator.ne: "!=",
}


def compare(builder: Any, vector: Vector, comparison: str, a: Any, b: Any) -> Any:
    """Emit ``a < b`` (or another comparison): ordered for floats, signed for integers."""
    emit = builder.fcmp_ordered if vector.is_float else builder.icmp_signed
    return emit(comparison, a, b)


def _define_vector_operator(key: Any) -> None:
    """Define an operator for vectors of the same type."""

    def signature_of(vector: Any, *others: Any) -> Any:
        if not isinstance(vector, Vector) or any(other is not vector for other in others):
            return None
        return (m8 if key in _COMPARISONS else vector)(vector, *others)

    def emit(builder: Any, sig: Any, *operands: Any) -> Any:
        vector = sig.args[0]
        if key in _COMPARISONS:
            return compare(builder, vector, _COMPARISONS[key], *operands)
        instructions = _FLOAT_INSTRUCTIONS if vector.is_float else _INTEGER_INSTRUCTIONS
        return getattr(builder, instructions[key])(*operands)

    define_operator(key, (Vector,) * (1 if key in (operator.neg, operator.invert) else 2), signature_of, emit)


for _key in {**_FLOAT_INSTRUCTIONS, **_INTEGER_INSTRUCTIONS, **_COMPARISONS}:
    _define_vector_operator(_key)


def define(result_type: Callable[..., Any], emit: Callable[..., Any]) -> Any:
    """Return a function for kernels.

    ``result_type`` returns the result's type for the arguments' types, or None if they are wrong. ``emit(builder,
    signature, *arguments)`` emits its instructions and returns the result.
    """

    def build(typing_context: Any, *argument_types: Any) -> Any:
        result = result_type(*argument_types)
        if result is None:
            return None

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return emit(builder, sig, *args)

        return result(*argument_types), generate

    return intrinsic(build)


def call_llvm(builder: Any, name: str, result: Any, args: list[Any]) -> Any:
    """Call one of LLVM's intrinsic functions."""
    function = builder.module.globals.get(name)
    if function is None:
        function = ir.Function(builder.module, ir.FunctionType(result, [arg.type for arg in args]), name)
    return builder.call(function, args)


def has_feature(context: Any, name: str) -> bool:
    """Return whether the CPU that a kernel is compiled for has a feature, in LLVM's name."""
    return f"+{name}" in context.codegen().magic_tuple()[2]


def insert(builder: Any, instruction: Any) -> None:
    """Insert an instruction of a class that llvmlite's builder has no method for."""
    builder._insert(instruction)  # noqa: SLF001 - llvmlite has no public way


def shuffle(builder: Any, a: Any, b: Any, picks: list[int]) -> Any:
    """Return the lanes ``picks`` of the lanes of ``a`` followed by those of ``b``."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(I32, len(picks)), picks))


def lane_of(builder: Any, vector: Any, lane: int) -> Any:
    """Return one lane of a vector."""
    return builder.extract_element(vector, ir.Constant(I32, lane))


def offset_of(builder: Any, offsets: Any, lane: int) -> Any:
    """Return one lane of an i32x8 as int64."""
    return builder.sext(lane_of(builder, offsets, lane), I64)


def _broadcast(vector: Vector) -> Any:
    def emit(builder: Any, sig: Any, value: Any) -> Any:
        scalar, element = sig.args[0], vector.llvm.element
        if isinstance(scalar, types.Integer):
            if vector.is_float:
                value = builder.sitofp(value, element)
            elif value.type.width > 32:
                value = builder.trunc(value, element)
        elif value.type != element:
            value = builder.fptrunc(value, element) if element == F32 else builder.fpext(value, element)
        lane0 = builder.insert_element(ir.Constant(vector.llvm, ir.Undefined), value, ir.Constant(I32, 0))
        return shuffle(builder, lane0, ir.Constant(vector.llvm, ir.Undefined), [0] * LANES)

    def result_type(a: Any) -> Any:
        return vector if isinstance(a, types.Integer) or (vector.is_float and isinstance(a, types.Float)) else None

    return define(result_type, emit)


f32: Callable[[_Float], F32x8] = _broadcast(f32x8)
"""``f32(scalar)``: f32x8, the value, rounded to float32, in all lanes."""
f64: Callable[[_Float], F64x8] = _broadcast(f64x8)
"""``f64(scalar)``: f64x8, the value in all lanes."""
i32: Callable[[int], I32x8] = _broadcast(i32x8)
"""``i32(integer)``: i32x8, the value's low 32 bits in all lanes."""


@intrinsic
def iota(typing_context: Any) -> Any:
    """Return the i32x8 0, 1, .. 7."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return ir.Constant(i32x8.llvm, list(range(LANES)))

    return i32x8(), generate
