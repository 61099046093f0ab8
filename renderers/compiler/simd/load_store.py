"""Vectors from memory and back."""

from __future__ import annotations

from typing import Any, Final

from llvmlite import ir
from numba import types
from numba.core import cgutils

from renderers.compiler.simd.vectors import (
    F32,
    I1,
    I8,
    I32,
    I64,
    LANES,
    Vector,
    f32x8,
    f64x8,
    i32x8,
    insert,
    intrinsic,
    m8,
    make,
    shuffle,
)

_OF_POINTER: Final = {types.float32: f32x8, types.float64: f64x8, types.int32: i32x8, types.uint32: i32x8}


def _vector_behind(pointer: Any) -> Any:
    return _OF_POINTER.get(pointer.dtype) if isinstance(pointer, types.CPointer) else None


def _address(builder: Any, vector: Vector, pointer: Any, index: Any) -> Any:
    return builder.bitcast(builder.gep(pointer, [index]), vector.llvm.as_pointer())


class VolatileLoad(ir.instructions.LoadInstr):  # type: ignore[misc]  # llvmlite has no types
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
        load = VolatileLoad(builder.block, address)
        load.align = align
        insert(builder, load)
        return load

    return make(lambda pointer, index: _vector_behind(pointer), emit)


load = _loader(volatile=False)
"""``load(pointer, i)``: the values i .. i + 7 behind it, unaligned."""
load_volatile = _loader(volatile=True)
"""As ``load``, for the old values of a blend that is stored back; see the module's notes."""


def _emit_store(builder: Any, sig: Any, pointer: Any, index: Any, value: Any) -> Any:
    builder.store(value, _address(builder, sig.args[2], pointer, index), align=8 if sig.args[2] is f64x8 else 4)
    return ir.Constant(I32, 0)


store = make(
    lambda pointer, index, value: types.int32 if _vector_behind(pointer) is value else None,
    _emit_store,
)
"""``store(pointer, i, v)``: writes the values i .. i + 7 behind it, unaligned. The result means nothing."""


@intrinsic
def store_where(typing_context: Any, pointer: Any, index: Any, mask: Any, value: Any) -> Any:
    """``store_where(pointer, i, m8, v)``: writes the lanes in the mask. The result means nothing.

    One masked store where the machine has AVX-512's, which cost what others do; elsewhere all lanes are stored, the
    others as they were, see the module's notes. What is loaded again soon is better blended by the caller: a masked
    store does not forward to a load.
    """
    if _vector_behind(pointer) is not value or mask is not m8 or value is f64x8:
        return None

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        address = _address(builder, value, args[0], args[1])
        if "+avx512vl" in context.codegen().magic_tuple()[2]:
            lanes = ir.VectorType(I1, LANES)
            kind = ir.FunctionType(ir.VoidType(), [value.llvm, address.type, I32, lanes])
            declare: Any = cgutils.get_or_insert_function
            name = f"llvm.masked.store.v8{value.llvm.element.intrinsic_name}.p0"
            builder.call(declare(builder.module, kind, name), [args[3], address, ir.Constant(I32, 4), args[2]])
        else:
            old = VolatileLoad(builder.block, address)
            old.align = 4
            insert(builder, old)
            builder.store(builder.select(args[2], args[3], old), address, align=4)
        return ir.Constant(I32, 0)

    return types.int32(pointer, types.int64, mask, value), generate


class _ManyPlaces(ir.instructions.GEPInstr):  # type: ignore[misc]  # llvmlite has no types
    """The addresses of values behind a pointer, one for each lane of a vector of indices."""

    def __init__(self, builder: Any, pointer: Any, indices: Any) -> None:
        super().__init__(builder.block, pointer, [ir.Constant(I32, 0)], False, "")
        self.type = ir.VectorType(pointer.type, LANES)
        self.indices = [indices]
        self.operands = [pointer, indices]


def _emit_gather(builder: Any, sig: Any, pointer: Any, indices: Any) -> Any:
    vector = sig.return_type
    places = _ManyPlaces(builder, pointer, indices)
    insert(builder, places)
    lanes = ir.VectorType(I1, LANES)
    kind = ir.FunctionType(vector.llvm, [places.type, I32, lanes, vector.llvm])
    declare: Any = cgutils.get_or_insert_function
    gathering = declare(builder.module, kind, f"llvm.masked.gather.v8{vector.llvm.element.intrinsic_name}.v8p0")
    align, every = ir.Constant(I32, 8 if vector is f64x8 else 4), ir.Constant(lanes, [1] * LANES)
    return builder.call(gathering, [places, align, every, ir.Constant(vector.llvm, ir.Undefined)])


gather = make(lambda pointer, indices: _vector_behind(pointer) if indices is i32x8 else None, _emit_gather)
"""``gather(pointer, i32x8)``: one value per lane. LLVM knows on which machines one instruction is faster than eight
loads: on Intel's since Skylake (half the time), not on Zen."""


def _emit_prefetch(builder: Any, sig: Any, pointer: Any, index: Any) -> Any:
    place = builder.bitcast(builder.gep(pointer, [index]), I8.as_pointer())
    kind = ir.FunctionType(ir.VoidType(), [I8.as_pointer(), I32, I32, I32])
    declare: Any = cgutils.get_or_insert_function
    read, soon, data = ir.Constant(I32, 0), ir.Constant(I32, 3), ir.Constant(I32, 1)
    builder.call(declare(builder.module, kind, "llvm.prefetch.p0"), [place, read, soon, data])
    return ir.Constant(I32, 0)


prefetch = make(
    lambda pointer, index: types.int32 if isinstance(pointer, types.CPointer) else None,
    _emit_prefetch,
)
"""``prefetch(pointer, i)``: fetch the cache line of value i, which may lie anywhere. The result means nothing."""


def _emit_scatter(builder: Any, sig: Any, pointer: Any, indices: Any, value: Any) -> Any:
    for lane in range(LANES):
        k = ir.Constant(I32, lane)
        index = builder.sext(builder.extract_element(indices, k), I64)
        builder.store(builder.extract_element(value, k), builder.gep(pointer, [index]))
    return ir.Constant(I32, 0)


scatter = make(
    lambda pointer, indices, value: (
        types.int32 if _vector_behind(pointer) is value and indices is i32x8 and value is not f64x8 else None
    ),
    _emit_scatter,
)
"""``scatter(pointer, i32x8, v)``: writes one value per lane, lane 0 first. The result means nothing."""


def _transposed(builder: Any, quads: list[Any], columns: int = 3) -> list[Any]:
    """The first columns of eight rows of four."""
    pairs = [shuffle(builder, quads[k], quads[k + 4], list(range(8))) for k in range(4)]
    low, high = [0, 8, 1, 9, 4, 12, 5, 13], [2, 10, 3, 11, 6, 14, 7, 15]
    xy = [shuffle(builder, pairs[k], pairs[k + 1], low) for k in (0, 2)]
    w = [shuffle(builder, pairs[k], pairs[k + 1], high) for k in (0, 2)]
    first, second = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]
    pairs_of = ((xy, first), (xy, second), (w, first), (w, second))
    return [shuffle(builder, a[0], a[1], picks) for a, picks in pairs_of[:columns]]


@intrinsic
def load_corners(typing_context: Any, vertices: Any, indices: Any, corner: Any) -> Any:
    """Three f32x8, the first three of the four float32 of a vertex, for one corner (0, 1 or 2) of eight triangles.

    ``vertices`` points to (N, 4) float32, ``indices`` to (8, 3) uint32. One load per vertex and a transposition:
    a third of the instructions of three gathers, and one cache line instead of three.
    """
    out: Any = types.UniTuple(f32x8, 3)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        quad = ir.VectorType(F32, 4)
        quads = []
        for lane in range(LANES):
            place = builder.add(args[2], ir.Constant(I64, 3 * lane))
            index = builder.zext(builder.load(builder.gep(args[1], [place])), I64)
            place = builder.gep(args[0], [builder.shl(index, ir.Constant(I64, 2))])
            quads.append(builder.load(builder.bitcast(place, quad.as_pointer()), align=4))
        return context.make_tuple(builder, out, _transposed(builder, quads))

    return out(vertices, indices, types.int64), generate


@intrinsic
def load_triples(typing_context: Any, values: Any, offsets: Any) -> Any:
    """Three f32x8: the float32 at ``offsets[lane]`` behind a pointer and the two after it, for every lane.

    Four values are read per lane, so that one more must exist. ``offsets`` is an i32x8.
    """
    out: Any = types.UniTuple(f32x8, 3)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        quad = ir.VectorType(F32, 4)
        quads = []
        for lane in range(LANES):
            offset = builder.sext(builder.extract_element(args[1], ir.Constant(I32, lane)), I64)
            place = builder.gep(args[0], [offset])
            quads.append(builder.load(builder.bitcast(place, quad.as_pointer()), align=4))
        return context.make_tuple(builder, out, _transposed(builder, quads))

    return out(values, offsets), generate


@intrinsic
def load_quads(typing_context: Any, values: Any, offsets: Any) -> Any:
    """Four f32x8: the float32 at ``offsets[lane]`` (an i32x8) behind a pointer and the three after it."""
    out: Any = types.UniTuple(f32x8, 4)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        quad = ir.VectorType(F32, 4)
        quads = []
        for lane in range(LANES):
            offset = builder.sext(builder.extract_element(args[1], ir.Constant(I32, lane)), I64)
            quads.append(builder.load(builder.bitcast(builder.gep(args[0], [offset]), quad.as_pointer()), align=4))
        return context.make_tuple(builder, out, _transposed(builder, quads, 4))

    return out(values, offsets), generate


@intrinsic
def load_vertices(
    typing_context: Any, records: Any, at: Any, first: Any, elements: Any, vertices: Any, corner: Any
) -> Any:
    """Six f32x8, the first six values of a vertex of eight float32, for one corner (0, 1 or 2) of eight triangles.

    Args:
        records: pointer to int32, of which the eight from ``at`` on are triangles' numbers plus ``first``.
        elements: pointer to (M, 3) uint32. vertices: pointer to (N, 8) float32.
    """
    out: Any = types.UniTuple(f32x8, 6)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer, at, first, elements, vertices, corner = args
        quad = ir.VectorType(F32, 4)
        halves: tuple[list[Any], list[Any]] = ([], [])
        for lane in range(LANES):
            place = builder.gep(pointer, [builder.add(at, ir.Constant(I64, lane))])
            element = builder.sub(builder.sext(builder.load(place), I64), first)
            place = builder.gep(elements, [builder.add(builder.mul(element, ir.Constant(I64, 3)), corner)])
            value = builder.shl(builder.zext(builder.load(place), I64), ir.Constant(I64, 3))
            for half in range(2):
                place = builder.gep(vertices, [builder.add(value, ir.Constant(I64, 4 * half))])
                halves[half].append(builder.load(builder.bitcast(place, quad.as_pointer()), align=4))
        columns = _transposed(builder, halves[0], 4) + _transposed(builder, halves[1], 2)
        return context.make_tuple(builder, out, columns)

    return out(records, types.int64, types.int64, elements, vertices, types.int64), generate


@intrinsic
def store_rows(typing_context: Any, pointer: Any, places: Any, values: Any) -> Any:
    """Write lane k of eight f32x8 (a tuple) as eight neighbouring float32, from value ``places[k]`` on (an i32x8), lane
    0 first. The result means nothing."""
    one: Any = types.int32

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        columns = [builder.extract_value(args[2], k) for k in range(LANES)]
        low, high = [0, 8, 1, 9, 4, 12, 5, 13], [2, 10, 3, 11, 6, 14, 7, 15]
        first, second = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]
        # By blocks of two columns, of four, of eight.
        pairs = [[shuffle(builder, columns[k], columns[k + 1], picks) for picks in (low, high)] for k in range(0, 8, 2)]
        fours = [
            [
                shuffle(builder, pairs[k][half], pairs[k + 1][half], picks)
                for half in range(2)
                for picks in (first, second)
            ]
            for k in (0, 2)
        ]
        halves = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
        for lane in range(LANES):
            row = shuffle(builder, fours[0][lane % 4], fours[1][lane % 4], halves[lane // 4])
            place = builder.sext(builder.extract_element(args[1], ir.Constant(I32, lane)), I64)
            place = builder.bitcast(builder.gep(args[0], [place]), f32x8.llvm.as_pointer())
            builder.store(row, place, align=4)
        return ir.Constant(I32, 0)

    return one(pointer, places, values), generate


def columns_of(builder: Any, rows: list[Any]) -> list[Any]:
    """Eight vectors of eight, rows and columns exchanged."""
    low, high = [0, 8, 1, 9, 4, 12, 5, 13], [2, 10, 3, 11, 6, 14, 7, 15]
    pairs = [shuffle(builder, rows[k], rows[k + 1], picks) for k in range(0, LANES, 2) for picks in (low, high)]
    first, second = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]
    quads = [
        shuffle(builder, pairs[k + j], pairs[k + j + 2], picks)
        for k in (0, 4)
        for j in range(2)
        for picks in (first, second)
    ]
    lower, upper = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
    return [shuffle(builder, quads[j], quads[j + 4], picks) for picks in (lower, upper) for j in range(4)]


@intrinsic
def load_octets(typing_context: Any, values: Any, offsets: Any) -> Any:
    """Eight f32x8: the float32 at ``offsets[lane]`` (an i32x8) behind a pointer and the seven after it, for every lane.

    One load per lane and a transposition.
    """
    out: Any = types.UniTuple(f32x8, LANES)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        rows = []
        for lane in range(LANES):
            offset = builder.sext(builder.extract_element(args[1], ir.Constant(I32, lane)), I64)
            rows.append(builder.load(_address(builder, f32x8, args[0], offset), align=4))
        return context.make_tuple(builder, out, columns_of(builder, rows))

    return out(values, offsets), generate


@intrinsic
def load_elements(typing_context: Any, values: Any, offsets: Any) -> Any:
    """Three i32x8: the int32 or uint32 at ``offsets[lane]`` (an i32x8) behind a pointer and the two after it."""
    out: Any = types.UniTuple(i32x8, 3)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        parts = [ir.Constant(i32x8.llvm, ir.Undefined)] * 3
        for lane in range(LANES):
            k = ir.Constant(I32, lane)
            offset = builder.sext(builder.extract_element(args[1], k), I64)
            for j in range(3):
                place = builder.gep(args[0], [builder.add(offset, ir.Constant(I64, j))])
                parts[j] = builder.insert_element(parts[j], builder.load(place), k)
        return context.make_tuple(builder, out, parts)

    return out(values, offsets), generate


@intrinsic
def gather_pairs(typing_context: Any, values: Any, indices: Any) -> Any:
    """Two i32x8: the int32 at ``indices[lane]`` (an i32x8) behind a pointer, and the one after it."""
    out: Any = types.UniTuple(i32x8, 2)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        quarters: list[Any] = []
        pairs = ir.VectorType(I64, 4)
        for half in range(2):
            four: Any = ir.Constant(pairs, ir.Undefined)
            for lane in range(4):
                offset = builder.sext(builder.extract_element(args[1], ir.Constant(I32, 4 * half + lane)), I64)
                place = builder.bitcast(builder.gep(args[0], [offset]), I64.as_pointer())
                four = builder.insert_element(four, builder.load(place, align=4), ir.Constant(I32, lane))
            quarters.append(builder.bitcast(four, i32x8.llvm))
        parts = [shuffle(builder, quarters[0], quarters[1], [2 * lane + k for lane in range(LANES)]) for k in range(2)]
        return context.make_tuple(builder, out, parts)

    return out(values, indices), generate


@intrinsic
def store_rgb(typing_context: Any, pointer: Any, index: Any, pixels: Any) -> Any:
    """Write the low three bytes of eight i32 (red lowest) as 24 bytes from byte ``index`` on.

    Four more bytes behind them are overwritten with anything. Two byte shuffles and two stores of 16 bytes.
    """

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        wide = ir.VectorType(I8, 4 * LANES)
        whole = builder.bitcast(args[2], wide)
        picks = [4 * pixel + byte for pixel in range(4) for byte in range(3)] + [3] * 4
        for half in range(2):
            part = shuffle(builder, whole, whole, [16 * half + pick for pick in picks])
            place = builder.gep(args[0], [builder.add(args[1], ir.Constant(I64, 12 * half))])
            builder.store(part, builder.bitcast(place, ir.VectorType(I8, 16).as_pointer()), align=1)
        return ir.Constant(I32, 0)

    return types.int32(pointer, types.int64, pixels), generate


def _emit_compressed(builder: Any, sig: Any, mask: Any, value: Any) -> Any:
    lanes = ir.VectorType(I1, LANES)
    kind = ir.FunctionType(value.type, [value.type, lanes, value.type])
    declare: Any = cgutils.get_or_insert_function
    name = f"llvm.experimental.vector.compress.v8{sig.return_type.llvm.element.intrinsic_name}"
    return builder.call(declare(builder.module, kind, name), [value, mask, ir.Constant(value.type, ir.Undefined)])


compress = make(
    lambda mask, value: value if mask is m8 and value in (f32x8, i32x8) else None,
    _emit_compressed,
)
"""``compress(m8, v)``: the lanes in the mask, in their order, as the first lanes; the others mean nothing. One
instruction with AVX-512; elsewhere each lane is stored where the ones before it end."""


@intrinsic
def store_quads(typing_context: Any, pointer: Any, index: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """Write eight times (a, b, c, d), four int32 each, from value ``index`` on. The result means nothing."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer, index, a, b, c, d = args
        halves = [0, 8, 1, 9, 4, 12, 5, 13], [2, 10, 3, 11, 6, 14, 7, 15]
        picks = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]
        pairs = [(shuffle(builder, a, b, half), shuffle(builder, c, d, half)) for half in halves]
        quads = [shuffle(builder, ab, cd, pick) for ab, cd in pairs for pick in picks]
        lower, upper = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
        for k, (first, half) in enumerate(((0, lower), (2, lower), (0, upper), (2, upper))):
            place = builder.add(index, ir.Constant(I64, 8 * k))
            row = shuffle(builder, quads[first], quads[first + 1], half)
            builder.store(row, _address(builder, i32x8, pointer, place), align=4)
        return ir.Constant(I32, 0)

    return types.int32(pointer, types.int64, a, b, c, d), generate


@intrinsic
def store_vertices(typing_context: Any, vertices: Any, index: Any, x: Any, y: Any, w: Any) -> Any:
    """Write eight vertices (x, y, w and an unused value) from float32 ``index`` on; the result means nothing."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer, begin, x, y, w = args
        low, high = [0, 8, 1, 9, 4, 12, 5, 13], [2, 10, 3, 11, 6, 14, 7, 15]
        first, second = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]
        rows = []
        for half in (low, high):
            xy, ww = shuffle(builder, x, y, half), shuffle(builder, w, w, half)
            rows += [shuffle(builder, xy, ww, first), shuffle(builder, xy, ww, second)]
        lower, upper = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
        for k, (a, b, half) in enumerate(((0, 1, lower), (2, 3, lower), (0, 1, upper), (2, 3, upper))):
            place = builder.add(begin, ir.Constant(I64, 8 * k))
            builder.store(shuffle(builder, rows[a], rows[b], half), _address(builder, f32x8, pointer, place), align=4)
        return ir.Constant(I32, 0)

    return types.int32(vertices, types.int64, x, y, w), generate


def _emit_triples(builder: Any, sig: Any, pointer: Any, index: Any, k: Any) -> Any:
    vector = sig.return_type
    wide = ir.VectorType(vector.llvm.element, 3 * LANES)
    address = builder.bitcast(builder.gep(pointer, [index]), wide.as_pointer())
    whole = builder.load(address, align=4)
    picks = [ir.Constant(ir.VectorType(I32, LANES), [3 * lane + j for lane in range(LANES)]) for j in range(3)]
    parts = [builder.shuffle_vector(whole, ir.Constant(wide, ir.Undefined), pick) for pick in picks]
    return builder.select(
        builder.icmp_signed("==", k, ir.Constant(k.type, 0)),
        parts[0],
        builder.select(builder.icmp_signed("==", k, ir.Constant(k.type, 1)), parts[1], parts[2]),
    )


load_third = make(
    lambda pointer, index, k: _vector_behind(pointer) if isinstance(k, types.Integer) else None, _emit_triples
)
"""``load_third(pointer, i, k)``: from the 24 values i .. i + 23, every third from ``k`` (0, 1 or 2) on."""
