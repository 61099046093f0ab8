"""Transformation of vertices from a mesh's frame to pixels: the first phase of a frame."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import types

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import advance, stack_array
from renderers.raster.layout import BEHIND, GUARD_BAND, OUTSIDE, frame_at

_BLOCK: Final = 1 << 18
"""Vertices between two checks of the stop flag: about a millisecond."""

_position_array = stack_array(types.float32, 3 * vec.LANES)
_vertex_array = stack_array(types.float32, 4 * vec.LANES)


@device_function
def _draw_of_vertex(frame, vertex):
    """Return the index of the draw that a vertex belongs to: the last one with ``first_vertex <= vertex``.

    Args:
        vertex: index among the vertices of all draws.
    """
    low = 0
    high = frame.draw_count
    while high - low > 1:
        middle = (low + high) >> 1
        if frame.draws[middle].first_vertex <= vertex:
            low = middle
        else:
            high = middle
    return low


@inlined
def _dot(row, x, y, z):
    """Return the product of a row of an affine transform, pointer to four float64, and eight points x, y, z; f64x8."""
    return vec.f64(row[0]) * x + vec.f64(row[1]) * y + vec.f64(row[2]) * z + vec.f64(row[3])


@inlined
def _transform_eight(frame, matrix, positions, out):
    """Transform eight vertices.

    Args:
        matrix: pointer to the first three rows of ``X_camera_mesh``, float64.
        positions: pointer to (8, 3) float32, metres in the mesh's frame.
        out: pointer to (8, 4) float32: x, y (pixels), 1/z (1/m), unused.
    """
    px = vec.to_f64(vec.load_third(positions, 0, 0))
    py = vec.to_f64(vec.load_third(positions, 0, 1))
    pz = vec.to_f64(vec.load_third(positions, 0, 2))
    one, guard = vec.f64(1.0), vec.f64(GUARD_BAND)
    z = _dot(advance(matrix, 8), px, py, pz)
    in_front = z >= vec.f64(frame.near)
    inv_z = vec.select(in_front, one / z, one)
    x = vec.f64(frame.fx) * _dot(matrix, px, py, pz) * inv_z + vec.f64(frame.cx)
    y = vec.f64(frame.fy) * _dot(advance(matrix, 4), px, py, pz) * inv_z + vec.f64(frame.cy)
    inside = (vec.absolute(x) <= guard) & (vec.absolute(y) <= guard)
    inv_z = vec.select(inside, inv_z, vec.f64(OUTSIDE))
    inv_z = vec.select(in_front, inv_z, vec.f64(BEHIND))
    vec.store_vertices(out, 0, vec.to_f32(x), vec.to_f32(y), vec.to_f32(inv_z))


@device_function
def _transform(frame, matrix, positions, count, out):
    """Transform ``count`` vertices; ``matrix``, ``positions`` and ``out`` as for ``_transform_eight``."""
    whole = count - count % vec.LANES
    for k in range(0, whole, vec.LANES):
        _transform_eight(frame, matrix, advance(positions, 3 * k), advance(out, 4 * k))
    if whole < count:  # with whole vectors of their own: what follows in memory belongs to others
        last_positions, last_out = _position_array(), _vertex_array()
        for k in range(3 * vec.LANES):
            last_positions[k] = positions[3 * whole + k] if k < 3 * (count - whole) else np.float32(0.0)
        _transform_eight(frame, matrix, last_positions, last_out)
        for k in range(4 * (count - whole)):
            out[4 * whole + k] = last_out[k]


@kernel("void(int64, int64, int64)")
def transform(frame_address, begin, end):
    """Compute pixel coordinates and 1/z of some vertices.

    Args:
        frame_address: address of a FRAME.
        begin, end: range of indices among the vertices of all draws.
    """
    frame = frame_at(frame_address)
    draw_index = _draw_of_vertex(frame, begin)
    first = begin
    while first < end and not is_set(frame.stop):
        draw = frame.draws[draw_index]
        draw_end = frame.draws[draw_index + 1].first_vertex
        stop = min(end, draw_end, first + _BLOCK)
        offset = first - draw.first_vertex
        positions, out = advance(draw.positions, 3 * offset), advance(frame.vertices, 4 * first)
        _transform(frame, draw.X_camera_mesh, positions, stop - first, out)
        first = max(first, stop)
        draw_index += first >= draw_end
