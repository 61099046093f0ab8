"""Eight lanes at a time: ``f32x8``, ``f64x8``, ``i32x8`` and ``m8`` as Numba types on LLVM vectors.

LLVM lowers them to whatever the machine has (AVX2: one register, f64x8 two; SSE2 and NEON: two and four). Operators
work lane by lane on operands of the same type; comparisons give ``m8``. Nothing is ever contracted to fused
multiply-adds, so that all machines, and the scalar kernels of the tests, round alike.

Traps, all measured on Zen 3 with LLVM 22:

* ``store(p, select(m, new, load(p)))`` becomes a masked store (vpmaskmovd), which is microcoded on Zen 1 to 3: 5 to 15
  times slower. ``load_again`` is a volatile load that keeps LLVM from seeing the pattern (llvm-project issue 213195;
  mended by pull request 214187, which llvmlite 0.50 does not have).
* gathers are eight scalar loads and inserts: faster than vgatherdps.
* scalar ``math.floor`` and ``ceil`` of float32 are calls into libm; ``floor`` and ``ceil`` here are one instruction.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, Final

from llvmlite import ir
from numba import extending, types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model

LANES: Final = 8

intrinsic: Any = extending.intrinsic

_I1, _I8, _I32, _I64 = ir.IntType(1), ir.IntType(8), ir.IntType(32), ir.IntType(64)
_F32, _F64 = ir.FloatType(), ir.DoubleType()


class Vector(types.Type):
    """Eight values of one scalar type."""

    def __init__(self, name: str, element: Any, llvm: ir.Type) -> None:
        self.element = element
        self.llvm = ir.VectorType(llvm, LANES)
        self.is_float = isinstance(llvm, (ir.FloatType, ir.DoubleType))
        super().__init__(name)


f32x8: Final = Vector("f32x8", types.float32, _F32)
f64x8: Final = Vector("f64x8", types.float64, _F64)
i32x8: Final = Vector("i32x8", types.int32, _I32)
m8: Final = Vector("m8", types.boolean, _I1)


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Vector) -> None:
        super().__init__(manager, numba_type, numba_type.llvm)  # type: ignore[no-untyped-call]


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


def _make(result: Callable[..., Any], emit: Callable[..., Any]) -> Any:
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
    first = builder.insert_element(ir.Constant(vector.llvm, ir.Undefined), value, ir.Constant(_I32, 0))
    zeros = ir.Constant(ir.VectorType(_I32, LANES), [0] * LANES)
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
            value = builder.fptrunc(value, wanted) if wanted == _F32 else builder.fpext(value, wanted)
        return _splat_of(builder, vector, value)

    def result(a: Any) -> Any:
        return vector if isinstance(a, types.Integer) or (vector.is_float and isinstance(a, types.Float)) else None

    return _make(result, emit)


f32 = _splat(f32x8)
"""``f32(scalar)``: the value, rounded to float32, in all lanes."""
f64 = _splat(f64x8)
"""``f64(scalar)``: the value in all lanes."""
i32 = _splat(i32x8)
"""``i32(integer)``: the value's low 32 bits in all lanes."""


@intrinsic  # type: ignore[untyped-decorator]
def iota(typing_context: Any) -> Any:
    """i32x8: 0, 1, .. 7."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return ir.Constant(i32x8.llvm, list(range(LANES)))

    return i32x8(), generate


_OF_POINTER: Final = {types.float32: f32x8, types.float64: f64x8, types.int32: i32x8, types.uint32: i32x8}


def _vector_behind(pointer: Any) -> Any:
    return _OF_POINTER.get(pointer.dtype) if isinstance(pointer, types.CPointer) else None


def _address(builder: Any, vector: Vector, pointer: Any, index: Any) -> Any:
    return builder.bitcast(builder.gep(pointer, [index]), vector.llvm.as_pointer())


class _VolatileLoad(ir.instructions.LoadInstr):  # type: ignore[misc]
    """A load that is neither removed nor merged with others."""

    def descr(self, buffer: list[str]) -> None:
        super().descr(buffer)
        buffer[-1] = buffer[-1].replace("load ", "load volatile ", 1)


def _loader(*, volatile: bool) -> Any:
    def emit(builder: Any, sig: Any, pointer: Any, index: Any) -> Any:
        vector = sig.return_type
        address = _address(builder, vector, pointer, index)
        align = 8 if vector is f64x8 else 4
        if not volatile:
            return builder.load(address, align=align)
        load = _VolatileLoad(builder.block, address)
        load.align = align
        builder._insert(load)
        return load

    return _make(lambda pointer, index: _vector_behind(pointer), emit)


load = _loader(volatile=False)
"""``load(pointer, i)``: the values i .. i + 7 behind it, unaligned."""
load_again = _loader(volatile=True)
"""As ``load``, for the old values of a blend that is stored back; see the module's notes."""


def _emit_store(builder: Any, sig: Any, pointer: Any, index: Any, value: Any) -> Any:
    builder.store(value, _address(builder, sig.args[2], pointer, index), align=8 if sig.args[2] is f64x8 else 4)
    return ir.Constant(_I32, 0)


store = _make(
    lambda pointer, index, value: types.int32 if _vector_behind(pointer) is value else None,
    _emit_store,
)
"""``store(pointer, i, v)``: writes the values i .. i + 7 behind it, unaligned. The result means nothing."""


def _emit_gather(builder: Any, sig: Any, pointer: Any, indices: Any) -> Any:
    vector = sig.return_type
    out = ir.Constant(vector.llvm, ir.Undefined)
    for lane in range(LANES):
        k = ir.Constant(_I32, lane)
        index = builder.sext(builder.extract_element(indices, k), _I64)
        out = builder.insert_element(out, builder.load(builder.gep(pointer, [index])), k)
    return out


gather = _make(lambda pointer, indices: _vector_behind(pointer) if indices is i32x8 else None, _emit_gather)
"""``gather(pointer, i32x8)``: one value per lane, by scalar loads."""


def _shuffle(builder: Any, a: Any, b: Any, picks: list[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_I32, len(picks)), picks))


@intrinsic  # type: ignore[untyped-decorator]
def load_corners(typing_context: Any, vertices: Any, indices: Any, corner: Any) -> Any:
    """Three f32x8, the first three of the four float32 of a vertex, for one corner (0, 1 or 2) of eight triangles.

    ``vertices`` points to (N, 4) float32, ``indices`` to (8, 3) uint32. One load per vertex and a transposition:
    a third of the instructions of three gathers, and one cache line instead of three.
    """
    out: Any = types.UniTuple(f32x8, 3)  # type: ignore[no-untyped-call]

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        quad = ir.VectorType(_F32, 4)
        quads = []
        for lane in range(LANES):
            place = builder.add(args[2], ir.Constant(_I64, 3 * lane))
            index = builder.zext(builder.load(builder.gep(args[1], [place])), _I64)
            place = builder.gep(args[0], [builder.shl(index, ir.Constant(_I64, 2))])
            quads.append(builder.load(builder.bitcast(place, quad.as_pointer()), align=4))
        pairs = [_shuffle(builder, quads[k], quads[k + 4], list(range(8))) for k in range(4)]
        low, high = [0, 8, 1, 9, 4, 12, 5, 13], [2, 10, 3, 11, 6, 14, 7, 15]
        xy = [_shuffle(builder, pairs[k], pairs[k + 1], low) for k in (0, 2)]
        w = [_shuffle(builder, pairs[k], pairs[k + 1], high) for k in (0, 2)]
        first, second = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]
        parts = [_shuffle(builder, a[0], a[1], picks) for a, picks in ((xy, first), (xy, second), (w, first))]
        return context.make_tuple(builder, out, parts)

    return out(vertices, indices, types.int64), generate


@intrinsic  # type: ignore[untyped-decorator]
def store_vertices(typing_context: Any, vertices: Any, index: Any, x: Any, y: Any, w: Any) -> Any:
    """Write eight vertices (x, y, w and an unused value) from float32 ``index`` on; the result means nothing."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer, begin, x, y, w = args
        low, high = [0, 8, 1, 9, 4, 12, 5, 13], [2, 10, 3, 11, 6, 14, 7, 15]
        first, second = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]
        rows = []
        for half in (low, high):
            xy, ww = _shuffle(builder, x, y, half), _shuffle(builder, w, w, half)
            rows += [_shuffle(builder, xy, ww, first), _shuffle(builder, xy, ww, second)]
        lower, upper = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
        for k, (a, b, half) in enumerate(((0, 1, lower), (2, 3, lower), (0, 1, upper), (2, 3, upper))):
            place = builder.add(begin, ir.Constant(_I64, 8 * k))
            builder.store(_shuffle(builder, rows[a], rows[b], half), _address(builder, f32x8, pointer, place), align=4)
        return ir.Constant(_I32, 0)

    return types.int32(vertices, types.int64, x, y, w), generate


def _emit_triples(builder: Any, sig: Any, pointer: Any, index: Any, k: Any) -> Any:
    vector = sig.return_type
    wide = ir.VectorType(vector.llvm.element, 3 * LANES)
    address = builder.bitcast(builder.gep(pointer, [index]), wide.as_pointer())
    whole = builder.load(address, align=4)
    picks = [ir.Constant(ir.VectorType(_I32, LANES), [3 * lane + j for lane in range(LANES)]) for j in range(3)]
    parts = [builder.shuffle_vector(whole, ir.Constant(wide, ir.Undefined), pick) for pick in picks]
    return builder.select(
        builder.icmp_signed("==", k, ir.Constant(k.type, 0)),
        parts[0],
        builder.select(builder.icmp_signed("==", k, ir.Constant(k.type, 1)), parts[1], parts[2]),
    )


load_third = _make(
    lambda pointer, index, k: _vector_behind(pointer) if isinstance(k, types.Integer) else None, _emit_triples
)
"""``load_third(pointer, i, k)``: from the 24 values i .. i + 23, every third from ``k`` (0, 1 or 2) on."""


def _emit_select(builder: Any, sig: Any, mask: Any, a: Any, b: Any) -> Any:
    return builder.select(mask, a, b)


select = _make(lambda mask, a, b: a if mask is m8 and isinstance(a, Vector) and a is b else None, _emit_select)
"""``select(m8, a, b)``: a where the mask is set, else b."""


def _emit_min(builder: Any, sig: Any, a: Any, b: Any) -> Any:
    compare = builder.fcmp_ordered if sig.return_type.is_float else builder.icmp_signed
    return builder.select(compare("<", a, b), a, b)


def _emit_max(builder: Any, sig: Any, a: Any, b: Any) -> Any:
    compare = builder.fcmp_ordered if sig.return_type.is_float else builder.icmp_signed
    return builder.select(compare(">", a, b), a, b)


least = _make(lambda a, b: a if isinstance(a, Vector) and a is b else None, _emit_min)
"""The smaller of two, lane by lane; the second where one is not a number."""
most = _make(lambda a, b: a if isinstance(a, Vector) and a is b else None, _emit_max)
"""The larger of two, lane by lane; the second where one is not a number."""


def _emit_bits(builder: Any, sig: Any, mask: Any) -> Any:
    return builder.zext(builder.bitcast(mask, _I8), _I64)


bits = _make(lambda mask: types.int64 if mask is m8 else None, _emit_bits)
"""int64: bit k is set where lane k of the mask is."""


def _emit_lowest(builder: Any, sig: Any, value: Any) -> Any:
    return builder.cttz(value, ir.Constant(_I1, 1))


lowest_bit = _make(lambda value: types.int64 if value is types.int64 else None, _emit_lowest)
"""Index of the lowest set bit of an int64 that is not 0."""


def _rounding(name: str) -> Any:
    def emit(builder: Any, sig: Any, value: Any) -> Any:
        vector = sig.return_type
        suffix = "v8f32" if vector is f32x8 else "v8f64"
        kind = ir.FunctionType(vector.llvm, [vector.llvm])
        declare: Any = cgutils.get_or_insert_function
        function = declare(builder.module, kind, f"llvm.{name}.{suffix}")
        return builder.call(function, [value])

    return _make(lambda a: a if isinstance(a, Vector) and a.is_float else None, emit)


rint = _rounding("rint")
"""To the nearest integer, ties to even."""
ceil = _rounding("ceil")
floor = _rounding("floor")
absolute = _rounding("fabs")


def _emit_to_f32(builder: Any, sig: Any, value: Any) -> Any:
    if sig.args[0] is i32x8:
        return builder.sitofp(value, f32x8.llvm)
    return builder.fptrunc(value, f32x8.llvm)


def _emit_to_f64(builder: Any, sig: Any, value: Any) -> Any:
    return builder.sitofp(value, f64x8.llvm) if sig.args[0] is i32x8 else builder.fpext(value, f64x8.llvm)


def _emit_to_i32(builder: Any, sig: Any, value: Any) -> Any:
    return builder.fptosi(value, i32x8.llvm)


to_f32 = _make(lambda a: f32x8 if a in (i32x8, f64x8) else None, _emit_to_f32)
to_f64 = _make(lambda a: f64x8 if a in (i32x8, f32x8) else None, _emit_to_f64)
to_i32 = _make(lambda a: i32x8 if a in (f32x8, f64x8) else None, _emit_to_i32)
"""Truncates; the value must fit."""
