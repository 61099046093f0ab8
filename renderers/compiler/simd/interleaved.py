"""Loads and stores of small structures: arrays of structures in memory, one vector per field in kernels.

A structure is loaded by one load per lane; eight of them are then transposed, in a third of the instructions that one
gather per field takes. Shuffles stay within the 16-byte halves of registers where possible, which is faster.
"""

from collections.abc import Callable
from typing import Any, Final

from renderers.compiler.numba_typing import intrinsic, ir, types
from renderers.compiler.simd.load_store import vector_address, vector_behind
from renderers.compiler.simd.vectors import F32, I8, I32, I64, LANES, define, f32x8, i32x8, offset_of, shuffle

_LOW_VALUES: Final = [0, 8, 1, 9, 4, 12, 5, 13]
"""Interleaves the first two values of the halves of two vectors."""
_HIGH_VALUES: Final = [2, 10, 3, 11, 6, 14, 7, 15]
_LOW_PAIRS: Final = [0, 1, 8, 9, 4, 5, 12, 13]
"""Interleaves the first pairs of the halves of two vectors."""
_HIGH_PAIRS: Final = [2, 3, 10, 11, 6, 7, 14, 15]
_LOW_HALVES: Final = [0, 1, 2, 3, 8, 9, 10, 11]
"""Joins the first halves of two vectors."""
_HIGH_HALVES: Final = [4, 5, 6, 7, 12, 13, 14, 15]


def _columns_of_quads(builder: Any, quads: list[Any], count: int) -> list[Any]:
    """Return the first ``count`` columns of eight rows of four values, one vector of eight each."""
    rows = [shuffle(builder, quads[k], quads[k + 4], list(range(LANES))) for k in range(4)]
    columns01 = [shuffle(builder, rows[k], rows[k + 1], _LOW_VALUES) for k in (0, 2)]
    columns23 = [shuffle(builder, rows[k], rows[k + 1], _HIGH_VALUES) for k in (0, 2)]
    parts = ((columns01, _LOW_PAIRS), (columns01, _HIGH_PAIRS), (columns23, _LOW_PAIRS), (columns23, _HIGH_PAIRS))
    return [shuffle(builder, pair[0], pair[1], picks) for pair, picks in parts[:count]]


def _columns_of_octets(builder: Any, rows: list[Any]) -> list[Any]:
    """Return the columns of eight rows of eight values."""
    pairs = [
        shuffle(builder, rows[k], rows[k + 1], picks)
        for k in range(0, LANES, 2)
        for picks in (_LOW_VALUES, _HIGH_VALUES)
    ]
    quads = [
        shuffle(builder, pairs[k + j], pairs[k + j + 2], picks)
        for k in (0, 4)
        for j in range(2)
        for picks in (_LOW_PAIRS, _HIGH_PAIRS)
    ]
    return [shuffle(builder, quads[j], quads[j + 4], picks) for picks in (_LOW_HALVES, _HIGH_HALVES) for j in range(4)]


def _load_quad(builder: Any, pointer: Any, offset: Any) -> Any:
    quad = ir.VectorType(F32, 4)
    return builder.load(builder.bitcast(builder.gep(pointer, [offset]), quad.as_pointer()), align=4)


@intrinsic
def load_corners(typing_context: Any, vertices: Any, indices: Any, corner: Any) -> Any:
    """Return three f32x8: the first three values of the vertex at one corner of each of eight triangles.

    Args:
        vertices: pointer to (N, 4) float32.
        indices: pointer to (8, 3) uint32, the triangles' vertices.
        corner: 0, 1 or 2.
    """
    result: Any = types.UniTuple(f32x8, 3)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vertices, indices, corner = args
        quads = []
        for lane in range(LANES):
            place = builder.add(corner, ir.Constant(I64, 3 * lane))
            vertex = builder.zext(builder.load(builder.gep(indices, [place])), I64)
            quads.append(_load_quad(builder, vertices, builder.shl(vertex, ir.Constant(I64, 2))))
        return context.make_tuple(builder, result, _columns_of_quads(builder, quads, 3))

    return result(vertices, indices, types.int64), generate


def _loader(vector: Any, count: int, columns: Callable[[Any, Any, list[Any]], list[Any]]) -> Any:
    """Return a function for kernels: ``count`` neighbouring values at eight offsets behind a pointer.

    ``columns`` returns the vectors, from the builder, the pointer and the offsets as int64.
    """

    def build(typing_context: Any, values: Any, offsets: Any) -> Any:
        result: Any = types.UniTuple(vector, count)

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            each_offset = [offset_of(builder, args[1], lane) for lane in range(LANES)]
            return context.make_tuple(builder, result, columns(builder, args[0], each_offset))

        return result(values, offsets), generate

    return intrinsic(build)


def _quad_columns(builder: Any, pointer: Any, offsets: list[Any]) -> list[Any]:
    return _columns_of_quads(builder, [_load_quad(builder, pointer, offset) for offset in offsets], 4)


def _octet_columns(builder: Any, pointer: Any, offsets: list[Any]) -> list[Any]:
    rows = [builder.load(vector_address(builder, f32x8, pointer, offset), align=4) for offset in offsets]
    return _columns_of_octets(builder, rows)


load_quads = _loader(f32x8, 4, _quad_columns)
"""``load_quads(pointer, offsets)``: four f32x8, the float32 at each offset (an i32x8) and the three after it."""
load_octets = _loader(f32x8, LANES, _octet_columns)
"""``load_octets(pointer, offsets)``: eight f32x8, the float32 at each offset (an i32x8) and the seven after it."""


@intrinsic
def load_rows(typing_context: Any, table: Any, indices: Any, positions: Any) -> Any:
    """Return eight f32x8: rows of (N, 8) float32, whose uint32 indices are at eight positions, an i32x8."""
    result: Any = types.UniTuple(f32x8, LANES)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        table, indices, positions = args
        places = [builder.gep(indices, [offset_of(builder, positions, lane)]) for lane in range(LANES)]
        offsets = [builder.mul(builder.zext(builder.load(at), I64), ir.Constant(I64, LANES)) for at in places]
        return context.make_tuple(builder, result, _octet_columns(builder, table, offsets))

    return result(table, indices, positions), generate


@intrinsic
def load_pairs(typing_context: Any, values: Any, offsets: Any, index: Any) -> Any:
    """Return two i32x8: the int32 at each of eight offsets, and the one after it.

    Offsets are loaded one by one: a processor begins all loads before those of earlier vectors have ended.

    Args:
        values: pointer to int32.
        offsets: pointer to int32, at least 0; the offsets ``index .. index + 8`` are read.
    """
    result: Any = types.UniTuple(i32x8, 2)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        values, offsets, index = args
        fours = [ir.Constant(ir.VectorType(I64, 4), ir.Undefined)] * 2
        for lane in range(LANES):
            place = builder.gep(offsets, [builder.add(index, ir.Constant(I64, lane))])
            address = builder.gep(values, [builder.zext(builder.load(place), I64)])
            pair = builder.load(builder.bitcast(address, I64.as_pointer()), align=4)
            # Lanes 0, 1, 4, 5 go to the first vector, 2, 3, 6, 7 to the second: then each half is shuffled by itself.
            which, position = lane // 2 % 2, ir.Constant(I32, lane // 4 * 2 + lane % 2)
            fours[which] = builder.insert_element(fours[which], pair, position)
        first, second = (builder.bitcast(four, i32x8.llvm) for four in fours)
        columns = [
            shuffle(builder, first, second, [pick + k for pick in (0, 2, 8, 10, 4, 6, 12, 14)]) for k in range(2)
        ]
        return context.make_tuple(builder, result, columns)

    return result(values, offsets, types.int64), generate


@intrinsic
def decode_pairs(typing_context: Any, table: Any, texels: Any, offsets: Any, index: Any) -> Any:
    """Return six f32x8: red, green and blue of ``load_pairs``' texels, of the first one and of the one after it.

    Twelve bytes are loaded for each lane, and each is looked up by another load: on Zen 4 in half the time of
    ``load_pairs`` and six ``gather``.

    Args:
        table: pointer to (256,) float32, values of the bytes.
        texels: pointer to int32, bytes red, green, blue and alpha.
        offsets, index: as in ``load_pairs``.
    """
    result: Any = types.UniTuple(f32x8, 6)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        table, texels, offsets, index = args
        columns = [ir.Constant(f32x8.llvm, ir.Undefined)] * 6
        for lane in range(LANES):
            place = builder.gep(offsets, [builder.add(index, ir.Constant(I64, lane))])
            pair = builder.bitcast(builder.gep(texels, [builder.zext(builder.load(place), I64)]), I8.as_pointer())
            for k, byte in enumerate((0, 1, 2, 4, 5, 6)):
                level = builder.zext(builder.load(builder.gep(pair, [ir.Constant(I64, byte)])), I64)
                value = builder.load(builder.gep(table, [level]), align=4)
                columns[k] = builder.insert_element(columns[k], value, ir.Constant(I32, lane))
        return context.make_tuple(builder, result, columns)

    return result(table, texels, offsets, types.int64), generate


def _emit_third(builder: Any, sig: Any, pointer: Any, index: Any, k: Any) -> Any:
    vector = sig.return_type
    triples = ir.VectorType(vector.llvm.element, 3 * LANES)
    values = builder.load(builder.bitcast(builder.gep(pointer, [index]), triples.as_pointer()), align=4)
    thirds = [
        shuffle(builder, values, ir.Constant(triples, ir.Undefined), [3 * lane + j for lane in range(LANES)])
        for j in range(3)
    ]
    is_first, is_second = (builder.icmp_signed("==", k, ir.Constant(k.type, j)) for j in range(2))
    return builder.select(is_first, thirds[0], builder.select(is_second, thirds[1], thirds[2]))


load_third = define(
    lambda pointer, index, k: vector_behind(pointer) if isinstance(k, types.Integer) else None, _emit_third
)
"""``load_third(pointer, i, k)``: every third of the 24 values i .. i + 24, beginning with value i + k (k: 0, 1, 2)."""


@intrinsic
def store_vertices(typing_context: Any, vertices: Any, index: Any, x: Any, y: Any, w: Any) -> Any:
    """``store_vertices(vertices, i, x, y, w)``: write (x, y, w, w) of each lane, float32, from value i on."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vertices, index, x, y, w = args
        pairs = [(shuffle(builder, x, y, p), shuffle(builder, w, w, p)) for p in (_LOW_VALUES, _HIGH_VALUES)]
        rows = [shuffle(builder, xy, ww, picks) for xy, ww in pairs for picks in (_LOW_PAIRS, _HIGH_PAIRS)]
        parts = ((0, _LOW_HALVES), (2, _LOW_HALVES), (0, _HIGH_HALVES), (2, _HIGH_HALVES))
        for k, (first, halves) in enumerate(parts):
            two_rows = shuffle(builder, rows[first], rows[first + 1], halves)
            place = builder.add(index, ir.Constant(I64, LANES * k))
            builder.store(two_rows, vector_address(builder, f32x8, vertices, place), align=4)
        return ir.Constant(I32, 0)

    return types.int32(vertices, types.int64, x, y, w), generate


@intrinsic
def store_rgb(typing_context: Any, pointer: Any, index: Any, pixels: Any) -> Any:
    """``store_rgb(pointer, i, pixels)``: write the low three bytes of each lane, lowest first, from byte i on.

    The four bytes after these 24 are overwritten too. Two byte shuffles and two stores of 16 bytes.
    """

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer, index, pixels = args
        rgba = builder.bitcast(pixels, ir.VectorType(I8, 4 * LANES))
        picks = [4 * pixel + byte for pixel in range(4) for byte in range(3)] + [3] * 4
        for half in range(2):
            rgb = shuffle(builder, rgba, rgba, [16 * half + pick for pick in picks])
            address = builder.gep(pointer, [builder.add(index, ir.Constant(I64, 12 * half))])
            builder.store(rgb, builder.bitcast(address, ir.VectorType(I8, 16).as_pointer()), align=1)
        return ir.Constant(I32, 0)

    return types.int32(pointer, types.int64, pixels), generate
