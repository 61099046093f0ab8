"""The compiled loops of the reader. Nothing is compiled at import: ``warm_up`` does it, or loads it from the cache."""

from __future__ import annotations

from typing import Any, Final

import numba
import numpy as np
from llvmlite import ir
from numba import extending, types
from numpy.typing import NDArray

intrinsic: Any = extending.intrinsic

_BLOCK: Final = np.uint64(4096)
"""Bytes that are compared before a difference is looked for."""
STRETCH: Final = np.uint64(512)
"""Bytes; half of what makes a string a long one."""
_QUOTE: Final = np.uint8(0x22)
AFFINE_TOLERANCE: Final = 1e-6
"""How far the last row of a node's matrix may be from (0, 0, 0, 1)."""

# Arrays of meshes are read-only, and Numba compiles again for writable ones: callers pass read-only views.
_BYTES: Final = types.Array(types.uint8, 1, "C", readonly=True)
_FLOATS: Final = types.Array(types.float32, 2, "C", readonly=True)
_TRIANGLES: Final = types.Array(types.uint32, 2, "C", readonly=True)
_NORMALS: Final = types.Array(types.float32, 2, "C")
_INFINITE: Final = np.uint32(0x7F800000)
"""Bits of an infinite float32; those of NaN, without the sign, are larger."""
_UNIT: Final = np.float32(1.999e-3)
"""How far a squared length may be from 1; a little less than what ``normals.unit_rows`` allows, which decides then."""


@numba.njit(nogil=True, cache=True, fastmath=False)
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


@numba.njit(nogil=True, cache=True, fastmath=False, error_model="numpy")
def long_strings(text: NDArray[np.uint8], places: NDArray[np.int64]) -> int:
    """Finds what lies between two quotes that are ``2 * STRETCH`` bytes apart or more.

    Such a stretch has an aligned one of ``STRETCH`` bytes without any quote in it: only those are looked at closely,
    and the others at the speed of memory.

    Args:
        places: (len(text) // STRETCH, 2), written: where each begins, after its quote, and where the next quote is.

    Returns:
        How many there are.
    """
    found = np.int64(0)
    length, end = np.uint64(len(text)), np.uint64(0)
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
            places[found, 0], places[found, 1] = begin, end
            found += 1
    return int(found)


@intrinsic
def _add_normal(typing_context: Any, records: Any, a: Any, b: Any, c: Any) -> Any:
    """``_add_normal(records, a, b, c)``: add the cross product of a triangle to its three vertices.

    A record, a row of a C-contiguous array, is eight float64: a place and a sum, each with a fourth value of no
    meaning. All of a vertex is one line of the cache then, and one instruction works on x, y and z: scalars take twice
    the time.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        four = ir.VectorType(ir.DoubleType(), 4).as_pointer()
        lanes = ir.Constant(ir.VectorType(ir.IntType(32), 4), [1, 2, 0, 3])
        eight = ir.Constant(ir.IntType(64), 8)
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        places = [builder.gep(data, [builder.mul(index, eight)]) for index in args[1:]]
        p, q, r = (builder.load(builder.bitcast(place, four), align=8) for place in places)
        u, v = builder.fsub(q, p), builder.fsub(r, p)
        u_yzx, v_yzx = (builder.shuffle_vector(x, x, lanes) for x in (u, v))
        zxy = builder.fsub(builder.fmul(u, v_yzx), builder.fmul(u_yzx, v))
        normal = builder.shuffle_vector(zxy, zxy, lanes)
        for place in places:  # one after the other: corners can be the same vertex
            sums = builder.bitcast(builder.gep(place, [ir.Constant(ir.IntType(64), 4)]), four)
            builder.store(builder.fadd(builder.load(sums, align=8), normal), sums, align=8)
        return ir.Constant(ir.IntType(32), 0)

    return types.int32(records, types.uint64, types.uint64, types.uint64), generate


@numba.njit(inline="never", error_model="numpy")
def _in_range(elements: NDArray[np.uint32], vertices: int, limit: int) -> bool:
    """Whether all indices are below ``limit`` and more than half of the vertices lie between the first and the last."""
    flat = elements.reshape(elements.size)
    low, high = np.uint32(0xFFFFFFFF), np.uint32(0)
    for i in range(np.uint64(len(flat))):
        low, high = min(low, flat[i]), max(high, flat[i])
    return bool(np.int64(high) < limit and 2 * (np.int64(high) + 1 - np.int64(low)) > vertices)


@numba.njit(inline="never", error_model="numpy")
def _finite(values: NDArray[np.float32]) -> bool:
    bits = values.reshape(values.size).view(np.uint32)
    largest = np.uint32(0)
    for i in range(np.uint64(len(bits))):
        largest = max(largest, bits[i] & np.uint32(0x7FFFFFFF))
    return bool(largest < _INFINITE)


@numba.njit(nogil=True, cache=True, fastmath=False, error_model="numpy")
def sum_normals(
    positions: NDArray[np.float32],
    triangles: NDArray[np.uint32],
    uv: NDArray[np.float32],
    limit: int,
    normals: NDArray[np.float32],
) -> bool:
    """Adds each triangle's cross product to its three vertices, then normalises; (0, 0, 1) where nothing was added.

    Args:
        positions, triangles: (N, 3), (M, 3).
        uv: (N or 0, 2).
        limit: indices must be below it; negative: it is known that all is sound.
        normals: (N, 3), written.

    Returns:
        False: something is not finite, out of range, or less than half of the vertices are in use. Nothing is written.
    """
    n = positions.shape[0]
    if limit >= 0 and not (_in_range(triangles, n, limit) and _finite(positions) and _finite(uv)):
        return False
    records = np.empty((n, 8), np.float64)
    for i in range(n):
        for k in range(3):
            records[i, k] = np.float64(positions[i, k])
            records[i, 4 + k] = 0.0
        records[i, 3] = records[i, 7] = 0.0
    for t in range(triangles.shape[0]):
        _add_normal(records, triangles[t, 0], triangles[t, 1], triangles[t, 2])
    for i in range(n):
        x, y, z = records[i, 4], records[i, 5], records[i, 6]
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0.0 and length < np.inf:
            scale = 1.0 / length  # divisions would take half of the time
            normals[i, 0] = np.float32(x * scale)
            normals[i, 1] = np.float32(y * scale)
            normals[i, 2] = np.float32(z * scale)
        else:
            normals[i, 0] = np.float32(0.0)
            normals[i, 1] = np.float32(0.0)
            normals[i, 2] = np.float32(1.0)
    return True


@numba.njit(nogil=True, cache=True, fastmath=False, error_model="numpy")
def is_sound(
    positions: NDArray[np.float32],
    elements: NDArray[np.uint32],
    uv: NDArray[np.float32],
    limit: int,
    normals: NDArray[np.float32],
) -> bool:
    """The same questions of a mesh that comes with normals; False also when these have not unit length."""
    n = positions.shape[0]
    if not (_in_range(elements, n, limit) and _finite(positions) and _finite(uv)):
        return False
    sound = True
    for i in range(n):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        sound &= abs(x * x + y * y + z * z - np.float32(1.0)) <= _UNIT  # false for what is not finite
    return sound


@numba.njit(nogil=True, cache=True, fastmath=False, error_model="numpy")
def arrange(numbers: NDArray[np.float64], matrices: NDArray[np.float64], moves: NDArray[np.bool_]) -> bool:
    """Column-major matrices of nodes as row-major ones, their last rows exact.

    Args:
        numbers: (16 N,).
        matrices: (N, 4, 4), written.
        moves: (N,), written: whether a matrix differs from the identity.

    Returns:
        False: a number is not finite, or a matrix not affine.
    """
    sound = True
    for node in range(len(matrices)):
        moved = False
        for row in range(4):
            for column in range(4):
                value, unit = numbers[16 * node + 4 * column + row], np.float64(row == column)
                sound &= abs(value) < np.inf  # false for NaN, too
                if row == 3:
                    sound &= abs(value - unit) <= AFFINE_TOLERANCE
                    value = unit
                moved |= value != unit
                matrices[node, row, column] = value
        moves[node] = moved
    return sound


def warm_up() -> None:
    """Compiles the kernels, or loads them from Numba's cache. Takes a few seconds of one core when that is empty."""
    equal_arrays.compile((_BYTES, _BYTES))
    long_strings.compile((_BYTES, types.int64[:, ::1]))
    sum_normals.compile((_FLOATS, _TRIANGLES, _FLOATS, types.int64, _NORMALS))
    arrange.compile((types.float64[::1], types.float64[:, :, ::1], types.boolean[::1]))
    is_sound.compile((_FLOATS, _TRIANGLES, _FLOATS, types.int64, _FLOATS))
