"""Setup of triangles, eight at a time, one per lane.

Load corners, snap them to the grid, cull, tell small triangles from others, compute edge functions and planes of 1/z.
Tiny triangles leave their pixels (``tiny_triangles``), small ones become SMALL_TRIANGLEs, and large and clipped ones
are set up one by one (``primitive_setup``).
"""

from __future__ import annotations

from typing import Final

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, I32, I64, Pointer, i64
from renderers.compiler.pointers import address, advance, i32_at, stack_array
from renderers.compiler.simd import F32x8x3, I32x8, I32x8x3, Mask8
from renderers.raster.chunks import append_primitive, bin_range
from renderers.raster.grid import Box
from renderers.raster.layout import (
    BEHIND,
    KIND_SMALL,
    MAX_SMALL_DEPTH_RATIO,
    MAX_SMALL_HEIGHT,
    MAX_SMALL_WIDTH,
    Chunk,
    RasterFrame,
    SmallTriangle,
    box_of,
)
from renderers.raster.primitive_setup import set_up_triangle
from renderers.raster.tiny_triangles import has_room_for_tiny, is_tiny, rasterize_tiny
from renderers.raster.triangle_geometry import (
    Edges,
    InvZPlane,
    bounding_box,
    edge_functions,
    inv_z_plane,
    load_triangles,
    maximum_of_3,
    minimum_of_3,
    overlaps_image,
    snap_to_grid_3,
)
from renderers.shading.vec3 import select3

_SMALL_FIELDS: Final = SmallTriangle.nbytes // 4
"""Fields of a SmallTriangle, of four bytes each."""
_field_rows_array = stack_array(I32, _SMALL_FIELDS * vec.LANES)


@device_function
def set_up_triangles(frame: RasterFrame, draw_index: I64, begin: I64, end: I64, chunk: Chunk) -> None:
    """Set up some triangles of a draw, and append what may be visible to a Chunk.

    Args:
        begin, end: range of indices among the triangles of its mesh.
    """
    vertices = advance(frame.vertices, 4 * frame.draws[draw_index].first_vertex)
    for first in range(begin, end, vec.LANES):
        # Inlined: a call would cost a fifth of the time of triangles that are not visible.
        _set_up_eight(frame, draw_index, vertices, first, min(end - first, vec.LANES), chunk)


@inlined
def _set_up_eight(
    frame: RasterFrame, draw_index: I64, vertices: Pointer[F32], first: I64, count: I64, chunk: Chunk
) -> None:
    """Set up at most eight triangles of a draw.

    Args:
        vertices: pointer to the draw's vertices, as for ``load_triangles``.
        first: index of the first one in its mesh.
        count: number of triangles.
    """
    draw = frame.draws[draw_index]
    x, y, w = load_triangles(draw, first, count, vertices)
    in_front, clipped_bits = _in_front(frame, w, count)
    if vec.movemask(in_front) == 0 and clipped_bits == 0:
        return
    zeros = vec.f32(0.0), vec.f32(0.0), vec.f32(0.0)
    x, y = select3(in_front, x, zeros), select3(in_front, y, zeros)  # those of the other lanes may be infinite
    gx, gy = snap_to_grid_3(x), snap_to_grid_3(y)
    box = bounding_box(gx, gy, frame.sample_reach)
    in_image = in_front & overlaps_image(frame, box)
    fits = _fits_small(box, w)
    large_bits = vec.movemask(in_image & ~fits) | clipped_bits
    # In lanes that do not fit, the area has wrapped around: only small triangles may use its sign.
    area = (gx[1] - gx[0]) * (gy[2] - gy[0]) - (gx[2] - gx[0]) * (gy[1] - gy[0])
    is_counterclockwise = area < vec.i32(0)
    sign = vec.select(is_counterclockwise, vec.i32(-1), vec.i32(1))
    is_culled = sign == vec.i32(draw.culled_sign)
    small = in_image & fits & (area != vec.i32(0)) & (sign != vec.i32(draw.hidden_sign))
    if frame.first_back_bin == 0:  # culled faces are not kept
        small = small & ~is_culled
    if vec.movemask(small) == 0 and large_bits == 0:
        return
    edges = edge_functions(_swap_last_two(is_counterclockwise, gx), _swap_last_two(is_counterclockwise, gy), box)
    plane = inv_z_plane(x, y, w, box)
    ids = vec.i32(draw.first_id + first) + vec.iota()
    small_bits = vec.movemask(small)
    if has_room_for_tiny(frame, chunk):
        tiny = small & is_tiny(frame, box)
        if vec.movemask(tiny) != 0:
            # Culled ones that are left are kept back faces.
            rasterize_tiny(frame, tiny, is_culled, ids, box, edges, plane, chunk)
            small_bits &= ~vec.movemask(tiny)
    if small_bits | large_bits != 0:
        field_rows = _field_rows_array()
        _store_field_rows(field_rows, ids, box, edges, plane)
        culled_bits = vec.movemask(is_culled)
        _append_primitives(frame, draw_index, first, small_bits, large_bits, culled_bits, field_rows, chunk)


@inlined
def _in_front(frame: RasterFrame, w: F32x8x3, count: I64) -> tuple[Mask8, I64]:
    """Return which triangles have all corners within near and far plane and guard band, and which need clipping, a
    bit for each.

    Args:
        w: 1/z of the corners, or BEHIND or OUTSIDE.
        count: number of triangles.
    """
    zero, used = vec.f32(0.0), vec.iota() < vec.i32(count)
    inv_z_min, inv_z_max = minimum_of_3(w), maximum_of_3(w)
    clipped = used & (inv_z_min < zero) & (inv_z_max > vec.f32(BEHIND))
    return used & (inv_z_min > zero) & (inv_z_max >= vec.f32(frame.inv_z_far)), vec.movemask(clipped)


@inlined
def _fits_small(box: Box[I32x8], w: F32x8x3) -> Mask8:
    """Return m8: triangles whose edge functions fit int32, and 1/z float32.

    Args:
        w: 1/z of the corners.
    """
    fits = (box.right - box.left <= vec.i32(MAX_SMALL_WIDTH)) & (box.bottom - box.top <= vec.i32(MAX_SMALL_HEIGHT))
    return fits & (maximum_of_3(w) <= minimum_of_3(w) * vec.f32(MAX_SMALL_DEPTH_RATIO))


@inlined
def _swap_last_two(swapped: Mask8, corners: I32x8x3) -> I32x8x3:
    """Return a coordinate of the three corners, the last two exchanged in the lanes of ``swapped``."""
    return select3(swapped, (corners[0], corners[2], corners[1]), corners)


@inlined
def _store_field_rows(field_rows: Pointer[I32], ids: I32x8, box: Box[I32x8], edges: Edges, plane: InvZPlane) -> None:
    """Write eight SMALL_TRIANGLEs, transposed: the eight values of a field, then those of the next one.

    Args:
        field_rows: (_SMALL_FIELDS, 8).
        box, edges, plane: Box, Edges and InvZPlane of the eight triangles.
    """
    low_half = vec.i32(0xFFFF)
    fields = (
        *edges.base,  # edges
        edges.dx[0],  # edge_dx
        edges.dx[1],
        edges.dy[0],  # edge0_dy
        ids,  # id
        vec.i32(KIND_SMALL),  # kind
        edges.dy[1],  # edge1_dy
        (box.top << vec.i32(16)) | (box.left & low_half),  # box_corner
        ((box.bottom - box.top) << vec.i32(16)) | (box.right - box.left),  # box_size
        vec.float_bits(plane.base),  # inv_z_base
        vec.float_bits(plane.dx),  # inv_z_dx
        vec.float_bits(plane.dy),  # inv_z_dy
        vec.float_bits(plane.min),  # inv_z_min
        vec.float_bits(plane.max),  # inv_z_max
    )
    offset = 0
    for field in fields:
        vec.store(field_rows, offset, field)
        offset += vec.LANES


@inlined
def _append_primitives(
    frame: RasterFrame,
    draw_index: I64,
    first: I64,
    small_bits: I64,
    large_bits: I64,
    culled_bits: I64,
    field_rows: Pointer[I32],
    chunk: Chunk,
) -> None:
    """Append the small triangles in ``field_rows``, and the large ones, to a Chunk in the order of their lanes.

    Args:
        first: index of the first of the eight triangles in its mesh.
        small_bits, large_bits, culled_bits: a bit for each triangle that is small, large or clipped, a back face.
        field_rows: as from ``_store_field_rows``.
    """
    pending = small_bits | large_bits
    while pending != 0:
        k = vec.lowest_bit(pending)
        bit = i64(1) << k
        pending &= pending - 1
        primitive = chunk.primitives[chunk.count]
        if bit & small_bits:
            values = i32_at(address(primitive))
            for field in range(_SMALL_FIELDS):
                values[field] = field_rows[vec.LANES * field + k]
            _, top, _, row_count = box_of(SmallTriangle(address(primitive)))
            base_bin = frame.first_back_bin if bit & culled_bits else 0
            first_bin, last_bin = bin_range(max(top, 0), min(top + row_count, frame.height), base_bin)
        else:
            first_bin, last_bin = set_up_triangle(frame, draw_index, first + k, primitive)
            primitive.id = frame.draws[draw_index].first_id + first + k
        append_primitive(chunk, first_bin, last_bin)
