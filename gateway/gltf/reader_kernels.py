"""The compiled loops of the reader. Nothing is compiled at import: ``warm_up`` does it, or loads it from the cache."""

from __future__ import annotations

from typing import Any, Final

import numba
import numpy as np
from llvmlite import ir
from numba import extending, types
from numba.core import cgutils
from numpy.typing import NDArray

from gateway.scene.transforms import SQUARE_SAFE
from renderers.compiler.cache_locator import cached_njit
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import f32_at, f64_at, i64_at, u8_at, u16_at, u32_at

intrinsic: Any = extending.intrinsic

_BLOCK: Final = np.uint64(4096)
"""Bytes that are compared before a difference is looked for."""
STRETCH: Final = np.uint64(512)
"""Bytes; half of what makes a string a long one."""
_QUOTE: Final = np.uint8(0x22)
_LOOK: Final = 1 << 16
"""Vertices or triangles between two looks at the ``StopFlag``: a mesh of millions takes a second."""
ROW: Final = 10
"""What ``read_meshes`` is told of a mesh. Addresses are 0 where there is nothing.

0. address of its positions, (n, 3) float32
1. n
2. address of its indices; 0: they are 0, 1, 2 ...
3. how many, a multiple of 3
4. bytes of an index: 1, 2 or 4
5. address of (n, 2) float32 texture coordinates
6. address of (n, 3) float32 normals that it comes with
7. address of uint32 to write the indices to; 0: they are aligned uint32, and read where they are
8. address of (n, 3) float32 to write normals to, where it comes without
9. a limit that all indices must be below; negative: it is known that all is sound
"""
GATHER: Final = 9
"""What ``gather`` is told of an attribute.

0. address of its first value
1. elements
2. bytes from one to the next
3. glTF's component type but float64
4. components
5. components that are written; those that there are not are 1
6. ``SIGNED`` ... ``TANGENT``
7. address of (elements, components) float32, written
8. float64: a factor for all values
"""
SIGNED: Final = 1
"""Values are -1 at least."""
FINITE: Final = 2
"""What is not finite becomes 0."""
CLIPPED: Final = 4
"""Values become 0 .. 1."""
TANGENT: Final = 8
"""The first three of four components are looked at, whether they are of unit length; the last becomes 1 or -1."""
AFFINE_TOLERANCE: Final = 1e-6
"""How far the last row of a node's matrix may be from (0, 0, 0, 1)."""

# Arrays of meshes are read-only, and Numba compiles again for writable ones: callers pass read-only views.
_BYTES: Final = types.Array(types.uint8, 1, "C", readonly=True)
_INFINITE: Final = np.uint32(0x7F800000)
"""Bits of an infinite float32; those of NaN, without the sign, are larger."""
_UNIT: Final = np.float32(1.999e-3)
"""How far a squared length may be from 1; a little less than what ``normals.unit_rows`` allows, which decides then."""

_SPARE: Final = 4 * 3 + 6
"""float64 beyond the last sum: of three more, and twelve float32."""


@cached_njit(nogil=True, fastmath=False)
def equal_arrays(x: NDArray[np.uint8], y: NDArray[np.uint8]) -> bool:
    """Whether two arrays of one length agree.

    In blocks, so that a difference ends the work early. Indices are unsigned and the difference stays 8 bits wide: only
    then does LLVM use vectors, which makes it 20 times as fast.
    """
    n = np.uint64(len(x))
    whole = n // _BLOCK
    for block in range(np.uint64(0), whole):
        begin = np.uint64(block) * _BLOCK
        difference = np.uint8(0)
        for i in range(np.uint64(0), _BLOCK):
            at = begin + np.uint64(i)
            difference = np.uint8(difference | np.uint8(x[at] ^ y[at]))
        if difference != 0:
            return False
    for last in range(whole * _BLOCK, n):  # noqa: SIM110 - compiled, where all() is none
        if x[last] != y[last]:
            return False
    return True


@cached_njit(nogil=True, fastmath=False, error_model="numpy")
def long_strings(address: int, count: int, to_places: int) -> int:
    """Finds what lies between two quotes that are ``2 * STRETCH`` bytes apart or more.

    Such a stretch has an aligned one of ``STRETCH`` bytes without any quote in it: only those are looked at closely,
    and the others at the speed of memory.

    Args:
        address: of the text, bytes.
        count: of its bytes.
        to_places: address of (count // STRETCH, 2) int64, written: where each begins, after its quote, and where the
            next quote is.

    Returns:
        How many there are.
    """
    text, places = u8_at(address), i64_at(to_places)
    found = np.int64(0)
    length, end = np.uint64(count), np.uint64(0)
    for stretch in range(np.uint64(0), length // STRETCH):
        first = np.uint64(stretch) * STRETCH
        if first < end:
            continue
        quotes = np.uint8(0)
        for i in range(np.uint64(0), STRETCH):
            quotes = np.uint8(quotes | np.uint8(text[first + np.uint64(i)] == _QUOTE))
        if quotes != 0:
            continue
        begin, end = first, first + STRETCH
        while begin > 0 and text[begin - np.uint64(1)] != _QUOTE:
            begin -= np.uint64(1)
        while end + STRETCH <= length:
            quotes = np.uint8(0)
            for i in range(np.uint64(0), STRETCH):
                quotes = np.uint8(quotes | np.uint8(text[end + np.uint64(i)] == _QUOTE))
            if quotes != 0:
                break
            end += STRETCH
        while end < length and text[end] != _QUOTE:
            end += np.uint64(1)
        if begin > 0 and end < length and end - begin >= np.uint64(2) * STRETCH:
            places[2 * found], places[2 * found + 1] = begin, end
            found += 1
    return int(found)


@intrinsic
def _add_normal(typing_context: Any, points: Any, sums: Any, a: Any, b: Any, c: Any) -> Any:
    """``_add_normal(points, sums, a, b, c)``: add the cross product of a triangle to its three vertices.

    A point is three float32, a sum four float64, the last of no meaning: one instruction works on x, y and z then,
    where scalars take twice the time.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        four = ir.VectorType(ir.DoubleType(), 4).as_pointer()
        pair = ir.VectorType(ir.FloatType(), 2)
        lanes = ir.Constant(ir.VectorType(ir.IntType(32), 4), [1, 2, 0, 3])
        joined = ir.Constant(ir.VectorType(ir.IntType(32), 4), [0, 1, 2, 2])

        def place(first: Any, index: Any, size: int) -> Any:
            return builder.gep(first, [builder.mul(index, ir.Constant(ir.IntType(64), size))])

        def point(index: Any) -> Any:
            begin = place(args[0], index, 3)
            xy = builder.load(builder.bitcast(begin, pair.as_pointer()), align=4)
            last = builder.load(builder.gep(begin, [ir.Constant(ir.IntType(64), 2)]), align=4)
            z = builder.insert_element(ir.Constant(pair, ir.Undefined), last, ir.Constant(ir.IntType(32), 0))
            return builder.fpext(builder.shuffle_vector(xy, z, joined), ir.VectorType(ir.DoubleType(), 4))

        p, q, r = (point(index) for index in args[2:])
        u, v = builder.fsub(q, p), builder.fsub(r, p)
        u_yzx, v_yzx = (builder.shuffle_vector(x, x, lanes) for x in (u, v))
        zxy = builder.fsub(builder.fmul(u, v_yzx), builder.fmul(u_yzx, v))
        normal = builder.shuffle_vector(zxy, zxy, lanes)
        for index in args[2:]:  # one after the other: corners can be the same vertex
            sum_ = builder.bitcast(place(args[1], index, 4), four)
            builder.store(builder.fadd(builder.load(sum_, align=8), normal), sum_, align=8)
        return ir.Constant(ir.IntType(32), 0)

    return types.int32(points, sums, types.uint64, types.uint64, types.uint64), generate


@intrinsic
def _unit_rows(typing_context: Any, sums: Any, first: Any, normals: Any) -> Any:
    """``_unit_rows(sums, first, normals)``: four sums from the ``first`` on, at unit length as twelve float32;
    (0, 0, 1) where that cannot be.

    Four roots and four divisions at once: what the compiler makes of rows takes more than twice as long.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        four, floats = ir.VectorType(ir.DoubleType(), 4), ir.VectorType(ir.FloatType(), 4)

        def mixed(a: Any, b: Any, *lanes: int) -> Any:
            return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), lanes))

        def all_of(value: float) -> Any:
            return ir.Constant(four, [value] * 4)

        def row(number: int) -> Any:
            place = builder.gep(args[0], [builder.mul(args[1], ir.Constant(ir.IntType(64), 4))])
            place = builder.gep(place, [ir.Constant(ir.IntType(64), 4 * number)])
            return builder.load(builder.bitcast(place, four.as_pointer()), align=8)

        a, b, c, d = (row(number) for number in range(4))
        ab, cd = (mixed(*pair, 0, 4, 2, 6) for pair in ((a, b), (c, d)))
        x, z = mixed(ab, cd, 0, 1, 4, 5), mixed(ab, cd, 2, 3, 6, 7)
        y = mixed(*(mixed(*pair, 1, 5, 3, 7) for pair in ((a, b), (c, d))), 0, 1, 4, 5)
        xx, yy, zz = (builder.fmul(value, value) for value in (x, y, z))
        root = cgutils.get_or_insert_function(builder.module, ir.FunctionType(four, [four]), "llvm.sqrt.v4f64")
        length = builder.call(root, [builder.fadd(builder.fadd(xx, yy), zz)])
        scale = builder.fdiv(all_of(1.0), length)  # divisions of all three would take half of the time
        longer, finite = (
            builder.fcmp_ordered(*asked) for asked in ((">", length, all_of(0.0)), ("<", length, all_of(np.inf)))
        )
        usable = builder.and_(longer, finite)
        u, v, w = (
            builder.fptrunc(builder.select(usable, builder.fmul(value, scale), all_of(other)), floats)
            for value, other in ((x, 0.0), (y, 0.0), (z, 1.0))
        )
        uv, ww = mixed(u, v, *range(8)), mixed(w, w, *range(8))
        rows = mixed(uv, ww, 0, 4, 8, 1, 5, 9, 2, 6, 10, 3, 7, 11)
        builder.store(rows, builder.bitcast(args[2], rows.type.as_pointer()), align=4)
        return ir.Constant(ir.IntType(32), 0)

    return types.int32(sums, types.int64, normals), generate


@numba.njit(inline="never", error_model="numpy")
def _in_range(elements: Any, count: int, vertices: int, limit: int) -> bool:
    """Whether all indices are below ``limit`` and more than half of the vertices lie between the first and the last."""
    low, high = np.uint32(0xFFFFFFFF), np.uint32(0)
    for i in range(np.uint64(count)):
        low, high = min(low, elements[i]), max(high, elements[i])
    return bool(np.int64(high) < limit and 2 * (np.int64(high) + 1 - np.int64(low)) > vertices)


@numba.njit(inline="never", error_model="numpy")
def _finite(bits: Any, count: int) -> bool:
    largest = np.uint32(0)
    for i in range(np.uint64(count)):
        largest = max(largest, bits[i] & np.uint32(0x7FFFFFFF))
    return bool(largest < _INFINITE)


@numba.njit(inline="never", error_model="numpy")
def _units(vectors: Any, count: int) -> bool:
    sound = True
    for i in range(np.uint64(count)):
        x, y, z = vectors[3 * i], vectors[3 * i + 1], vectors[3 * i + 2]
        sound &= abs(x * x + y * y + z * z - np.float32(1.0)) <= _UNIT  # false for what is not finite
    return sound


@numba.njit(inline="never", error_model="numpy")
def _sum_normals(points: Any, n: int, elements: Any, count: int, to_sums: int, to_normals: int, stop: int) -> None:
    """``to_sums``: room for ``4 * n + _SPARE`` float64. ``stop``: as in ``read_meshes``."""
    sums = f64_at(to_sums)
    for i in range(np.uint64(4 * n)):
        sums[i] = 0.0
    for t in range(np.uint64(count)):
        if t % _LOOK == 0 and is_set(stop):
            return
        first = np.uint64(3) * t
        _add_normal(
            points,
            sums,
            np.uint64(elements[first]),
            np.uint64(elements[first + np.uint64(1)]),
            np.uint64(elements[first + np.uint64(2)]),
        )
    whole = n & ~3
    for i in range(0, whole, 4):
        if i % _LOOK == 0 and is_set(stop):
            return
        _unit_rows(sums, i, f32_at(to_normals + 12 * i))
    if whole < n:  # what is beyond the last sum may be anything
        normals, last = f32_at(to_normals + 12 * whole), f32_at(to_sums + 32 * (whole + 4))
        _unit_rows(sums, whole, last)
        for i in range(3 * (n - whole)):
            normals[i] = last[i]


@numba.njit(inline="never", error_model="numpy")
def _widen(source: Any, count: int, target: Any) -> None:
    for i in range(np.uint64(count)):
        target[i] = np.uint32(source[i])


@numba.njit(inline="never", error_model="numpy")
def _count_up(count: int, target: Any) -> None:
    for i in range(np.uint64(count)):
        target[i] = np.uint32(i)


@cached_njit(nogil=True, fastmath=False, error_model="numpy")
def read_meshes(rows: int, count: int, to_sound: int, stop: int) -> None:
    """Triangles of many meshes: looks whether they are sound, widens their indices, makes normals.

    Normals are the cross products of the triangles, summed at each of their vertices in float64, one triangle after the
    other, at unit length; (0, 0, 1) where nothing was added.

    Args:
        rows: address of (count, ``ROW``) int64, one for each mesh, contents as ``ROW`` tells. Whoever fills them keeps
            the arrays alive.
        to_sound: address of (count,) bytes, written: 1, or 0 where something is not finite, out of range, of another
            length than 1, or less than half of the vertices are in use: no normals then.
        stop: address of a ``StopFlag``; what is written is of no use once it is set.
    """
    most = np.int64(0)
    for number in range(count):
        row = i64_at(rows + 8 * ROW * number)
        if row[6] == 0:
            most = max(most, row[1])
    room = np.empty(4 * most + _SPARE, np.float64)
    for number in range(count):
        if is_set(stop):
            break
        row = i64_at(rows + 8 * ROW * number)
        n, indices, size, limit = row[1], row[3], row[4], row[9]
        if size == 1:
            _widen(u8_at(row[2]), indices, u32_at(row[7]))
        elif size == 2:
            _widen(u16_at(row[2]), indices, u32_at(row[7]))
        elif row[7] != 0 and row[2] != 0:
            _widen(u32_at(row[2]), indices, u32_at(row[7]))
        elif row[7] != 0:
            _count_up(indices, u32_at(row[7]))
        elements = u32_at(row[2] if row[7] == 0 else row[7])
        points = f32_at(row[0])
        sound = limit < 0 or (
            _in_range(elements, indices, n, limit)
            and _finite(u32_at(row[0]), 3 * n)
            and (row[5] == 0 or _finite(u32_at(row[5]), 2 * n))
            and (row[6] == 0 or _units(f32_at(row[6]), n))
        )
        if sound and row[6] == 0:
            _sum_normals(points, n, elements, indices // 3, room.ctypes.data, row[8], stop)
        u8_at(to_sound)[number] = np.uint8(sound)


@numba.njit(error_model="numpy")
def _number(address: int, code: int) -> Any:
    """A component of glTF's type ``code`` as float32."""
    if code == 5126:
        return f32_at(address)[0]
    if code == 5121:
        return np.float32(u8_at(address)[0])
    if code == 5123:
        return np.float32(u16_at(address)[0])
    if code == 5120:
        return np.float32(np.int8(u8_at(address)[0]))
    if code == 5122:
        return np.float32(np.int16(u16_at(address)[0]))
    if code == 5124:
        return np.float32(np.int32(u32_at(address)[0]))
    return np.float32(u32_at(address)[0])


@cached_njit(nogil=True, fastmath=False, error_model="numpy")
def gather(rows: int, count: int, to_sound: int, stop: int) -> None:
    """Attributes that do not lie as meshes want them, as tight float32.

    Args:
        rows: address of (count, ``GATHER``) numbers, one row for each attribute, contents as ``GATHER`` tells.
        to_sound: address of (count,) bytes, written: 0 where a tangent has another length than 1, else 1.
        stop: address of a ``StopFlag``; what is written is of no use once it is set.
    """
    for number in range(count):
        row = i64_at(rows + 8 * GATHER * number)
        first, n, stride, code, given, wanted, purpose = row[0], row[1], row[2], row[3], row[4], row[5], row[6]
        target, scale = f32_at(row[7]), np.float32(f64_at(rows + 8 * GATHER * number)[8])
        size = 1 if code <= 5121 else (2 if code <= 5123 else 4)
        sound = True
        for i in range(n):
            if i % _LOOK == 0 and is_set(stop):
                break
            for c in range(wanted):
                value = np.float32(1.0)
                if c < given:
                    value = _number(first + stride * i + size * c, code) * scale
                    if purpose & SIGNED and value < np.float32(-1.0):
                        value = np.float32(-1.0)
                    if purpose & FINITE and not abs(value) < np.float32(np.inf):
                        value = np.float32(0.0)
                    if purpose & CLIPPED:
                        value = np.float32(0.0) if value < np.float32(0.0) else min(value, np.float32(1.0))
                target[wanted * i + c] = value
            if purpose & TANGENT:
                x, y, z = target[4 * i], target[4 * i + 1], target[4 * i + 2]
                sound &= abs(x * x + y * y + z * z - np.float32(1.0)) <= _UNIT
                target[4 * i + 3] = np.float32(-1.0) if target[4 * i + 3] < np.float32(0.0) else np.float32(1.0)
        u8_at(to_sound)[number] = np.uint8(sound)


@numba.njit(inline="never", error_model="numpy")
def _compose(n: Any) -> bool:
    """``transforms.trs_numbers`` in place, of translation, rotation and scale; False: the quaternion is an odd one."""
    x, y, z, w = n[3], n[4], n[5], n[6]
    norm2 = w * w + x * x + y * y + z * z
    s = 2.0 / norm2
    wx, wy, wz = s * w * x, s * w * y, s * w * z
    xx, xy, xz = s * x * x, s * x * y, s * x * z
    yy, yz, zz = s * y * y, s * y * z, s * z * z
    n[12], n[13], n[14], n[15] = n[0], n[1], n[2], 1.0
    p, q, r = n[7], n[8], n[9]
    n[0], n[1], n[2], n[3] = (1.0 - (yy + zz)) * p, (xy + wz) * p, (xz - wy) * p, 0.0
    n[4], n[5], n[6], n[7] = (xy - wz) * q, (1.0 - (xx + zz)) * q, (yz + wx) * q, 0.0
    n[8], n[9], n[10], n[11] = (xz + wy) * r, (yz - wx) * r, (1.0 - (xx + yy)) * r, 0.0
    return bool(SQUARE_SAFE[0] < norm2 < SQUARE_SAFE[1])


@cached_njit(fastmath=False, error_model="numpy")  # brief: with the GIL
def arrange(count: int, from_numbers: int, from_parents: int, to_matrices: int, to_worlds: int, to_moves: int) -> bool:
    """Matrices of nodes, row-major, their last rows exact, and their products from the roots down.

    Args:
        count: of nodes, parents first.
        from_numbers: address of (count, 16) float64, changed: a column-major matrix; where ``to_moves`` is 1, a
            translation, a rotation [x, y, z, w] and a scale. 0: the matrices are there.
        from_parents: address of (count,) int64: each node's parent, -1: none.
        to_matrices: address of (count, 4, 4) float64, written: X_parent_node.
        to_worlds: address of (count, 4, 4) float64, written: X_world_node. 0: nobody asks.
        to_moves: address of (count,) bytes, written: 1 where a matrix differs from the identity, and 2 more where one
            of its parents' does.

    Returns:
        False: a number is not finite, a matrix not affine, or the square of a quaternion's length near no float64.
    """
    numbers, matrices, moves = f64_at(from_numbers), f64_at(to_matrices), u8_at(to_moves)
    parents = i64_at(from_parents)
    sound = True
    for node in range(count if from_numbers != 0 else 0):
        moved = False
        if moves[node] != 0:
            sound &= _compose(f64_at(from_numbers + 128 * node))
        for row in range(4):
            for column in range(4):
                value, unit = numbers[16 * node + 4 * column + row], np.float64(row == column)
                sound &= abs(value) < np.inf  # false for NaN, too
                if row == 3:
                    sound &= abs(value - unit) <= AFFINE_TOLERANCE
                    value = unit
                moved |= value != unit
                matrices[16 * node + 4 * row + column] = value
        moves[node] = np.uint8(moved)
    for node in range(count if to_worlds != 0 else 0):
        parent = parents[node]
        carried = parent >= 0 and moves[parent] != 0
        own, X, Y = f64_at(to_matrices + 128 * node), f64_at(to_worlds + 128 * parent), f64_at(to_worlds + 128 * node)
        for at in range(16):
            Y[at] = X[at] if carried and moves[node] == 0 else own[at]
        if carried and moves[node] != 0:
            for at in range(12):
                row, column = at & 12, at & 3
                value = X[row] * own[column] + X[row + 1] * own[column + 4] + X[row + 2] * own[column + 8]
                Y[at] = value + X[row + 3] if column == 3 else value
        if carried:
            moves[node] |= np.uint8(2)
    return sound


def warm_up() -> None:
    """Compiles the kernels, or loads them from Numba's cache. Takes a few seconds of one core when that is empty."""
    equal_arrays.compile((_BYTES, _BYTES))
    long_strings.compile((types.int64, types.int64, types.int64))
    read_meshes.compile((types.int64,) * 4)
    gather.compile((types.int64,) * 4)
    arrange.compile((types.int64,) * 6)
