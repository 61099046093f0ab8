"""Transformation of vertices from a mesh's frame to pixels: the first phase of a frame."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import advance
from renderers.raster.layout import GUARD_BAND, frame_at

_BLOCK: Final = 1 << 18
"""Vertices between two checks of the stop flag: about a millisecond."""
BEHIND: Final = -2.0
"""Replaces 1/z of a vertex that is nearer than the near plane, or not a number."""
OUTSIDE: Final = -1.0
"""Replaces 1/z of a vertex that is outside the guard band."""


@device_function
def _draw_of_vertex(frame, vertex):
    """Return the index of the draw that a drawn vertex belongs to."""
    low = 0
    high = frame.draw_count
    while high - low > 1:
        middle = (low + high) >> 1
        if frame.draws[middle].first_vertex <= vertex:
            low = middle
        else:
            high = middle
    return low


@device_function
def _transform(frame, matrix, positions, count, out):
    """Transform vertices, eight at a time and the last few one by one with the same arithmetic.

    Args:
        matrix: pointer to the first three rows of ``X_camera_mesh``, float64.
        positions: pointer to (count, 3) float32.
        out: pointer to (count, 4) float32: x, y, 1/z, unused.
    """
    fx, fy, cx, cy, near = frame.fx, frame.fy, frame.cx, frame.cy, frame.near
    m00, m01, m02, m03 = matrix[0], matrix[1], matrix[2], matrix[3]
    m10, m11, m12, m13 = matrix[4], matrix[5], matrix[6], matrix[7]
    m20, m21, m22, m23 = matrix[8], matrix[9], matrix[10], matrix[11]
    guard, one = vec.f64(GUARD_BAND), vec.f64(1.0)
    whole = count - count % vec.LANES
    for k in range(0, whole, vec.LANES):
        px = vec.to_f64(vec.load_third(positions, 3 * k, 0))
        py = vec.to_f64(vec.load_third(positions, 3 * k, 1))
        pz = vec.to_f64(vec.load_third(positions, 3 * k, 2))
        z = vec.f64(m20) * px + vec.f64(m21) * py + vec.f64(m22) * pz + vec.f64(m23)
        in_front = z >= vec.f64(near)
        inv_z = vec.select(in_front, one / z, one)
        x = vec.f64(fx) * (vec.f64(m00) * px + vec.f64(m01) * py + vec.f64(m02) * pz + vec.f64(m03)) * inv_z + vec.f64(
            cx
        )
        y = vec.f64(fy) * (vec.f64(m10) * px + vec.f64(m11) * py + vec.f64(m12) * pz + vec.f64(m13)) * inv_z + vec.f64(
            cy
        )
        inside = (vec.absolute(x) <= guard) & (vec.absolute(y) <= guard)
        inv_z = vec.select(inside, inv_z, vec.f64(OUTSIDE))
        inv_z = vec.select(in_front, inv_z, vec.f64(BEHIND))
        vec.store_vertices(out, 4 * k, vec.to_f32(x), vec.to_f32(y), vec.to_f32(inv_z))
    for k in range(whole, count):
        px = np.float64(positions[3 * k])
        py = np.float64(positions[3 * k + 1])
        pz = np.float64(positions[3 * k + 2])
        depth = m20 * px + m21 * py + m22 * pz + m23
        scale = 1.0 / depth if depth >= near else 1.0
        column = fx * (m00 * px + m01 * py + m02 * pz + m03) * scale + cx
        row = fy * (m10 * px + m11 * py + m12 * pz + m13) * scale + cy
        is_inside = abs(column) <= GUARD_BAND and abs(row) <= GUARD_BAND
        out[4 * k] = column
        out[4 * k + 1] = row
        out[4 * k + 2] = BEHIND if not depth >= near else scale if is_inside else OUTSIDE


@kernel("void(int64, int64, int64)")
def transform(frame_address, begin, end):
    """Compute pixel coordinates and 1/z of the drawn vertices ``begin .. end``."""
    frame = frame_at(frame_address)
    draw_index = _draw_of_vertex(frame, begin)
    while begin < end and not is_set(frame.stop):
        draw = frame.draws[draw_index]
        draw_end = frame.draws[draw_index + 1].first_vertex
        stop = min(end, draw_end, begin + _BLOCK)
        offset = begin - draw.first_vertex
        positions, out = advance(draw.positions, 3 * offset), advance(frame.vertices, 4 * begin)
        _transform(frame, draw.X_camera_mesh, positions, stop - begin, out)
        begin = max(begin, stop)
        draw_index += begin >= draw_end
