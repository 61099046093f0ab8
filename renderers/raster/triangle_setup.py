"""Setup of triangles, eight at a time, one per lane.

    vertices of a draw ─▶ corners ─▶ on the grid of 1/256 pixel ─▶ box ─▶ by size:

        tiny     at most 4 x 4 pixels     ``tiny_triangles`` rasterizes them here, if the Chunk has room for fragments
        small    at most 64 x 128         SmallTriangle: edge functions in int32, plane of 1/z in float32
        general  larger, with very different depths, or to be clipped    Primitive, one at a time: ``primitive_setup``

Dropped on the way: triangles nearer than the near plane, beyond the far plane, off the image or without area; back
faces that a convex mesh hides; and those that are culled, unless depth and labels show them.
"""

from typing import NamedTuple

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, I32, I64, Pointer, i64
from renderers.compiler.pointers import address, i32_at, stack_array
from renderers.compiler.simd import F32x8x3, I32x8, I32x8x3, Mask8
from renderers.raster.chunks import append_primitive, bin_range
from renderers.raster.grid import Box, box_of
from renderers.raster.layout import (
    BEFORE_NEAR_PLANE,
    KIND_SMALL,
    MAX_SMALL_DEPTH_RATIO,
    MAX_SMALL_HEIGHT,
    MAX_SMALL_WIDTH,
    SMALL_FIELD_COUNT,
    SMALL_FIELD_INDEX,
    Chunk,
    RasterFrame,
    SmallTriangle,
    vertex_of,
)
from renderers.raster.primitive_setup import set_up_general_triangle
from renderers.raster.tiny_triangles import can_rasterize_tiny, is_tiny, rasterize_tiny
from renderers.raster.triangle_geometry import (
    Corners,
    EightTriangles,
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

_small_fields_array = stack_array(I32, SMALL_FIELD_COUNT * vec.LANES)


class _LaneBits(NamedTuple):
    """Which of eight triangles become primitives, a bit for each."""

    small: I64
    general: I64
    """Other primitives: large triangles, and those to be clipped or with depths beyond MAX_SMALL_DEPTH_RATIO."""
    culled: I64
    """Triangles whose side towards the camera is culled. They are in ``small`` only if the frame keeps culled faces."""


@device_function
def set_up_triangles(frame: RasterFrame, draw_index: I64, begin: I64, end: I64, chunk: Chunk) -> None:
    """Set up the triangles ``begin .. end`` of a draw's mesh, and append what may be visible to a Chunk."""
    vertices = vertex_of(frame, frame.draws[draw_index], 0)
    for first_triangle in range(begin, end, vec.LANES):
        count = min(end - first_triangle, vec.LANES)
        # Inlined: a call makes invisible triangles 20 % slower.
        _set_up_eight_triangles(frame, draw_index, vertices, first_triangle, count, chunk)


@inlined
def _set_up_eight_triangles(
    frame: RasterFrame, draw_index: I64, vertices: Pointer[F32], first_triangle: I64, count: I64, chunk: Chunk
) -> None:
    """Set up ``count`` triangles of a draw, at most eight, from ``first_triangle`` of its mesh on.

    Args:
        vertices: the draw's vertices, as for ``load_triangles``.
    """
    draw = frame.draws[draw_index]
    # Load; drop what is nearer than the near plane or farther than the far plane.
    corners = load_triangles(draw, first_triangle, count, vertices)
    passes_unclipped = _passes_unclipped(frame, corners.inv_z, count)
    needs_clipping = _needs_clipping(corners.inv_z, count)
    if vec.movemask(passes_unclipped | needs_clipping) == 0:
        return

    # Snap; drop what is off the image. Other lanes get 0: they may be NaN or not fit int32.
    zeros = vec.f32(0.0), vec.f32(0.0), vec.f32(0.0)
    corners = Corners(
        select3(passes_unclipped, corners.x, zeros), select3(passes_unclipped, corners.y, zeros), corners.inv_z
    )
    gx, gy = snap_to_grid_3(corners.x), snap_to_grid_3(corners.y)
    box = bounding_box(gx, gy, frame.sample_reach)
    in_image = passes_unclipped & overlaps_image(frame, box)

    # Tell small from general.
    fits_small = _fits_small(box, corners.inv_z)
    general_bits = vec.movemask((in_image & ~fits_small) | needs_clipping)

    # Cull small ones. The area of general ones may overflow int32: primitive_setup culls them.
    area = (gx[1] - gx[0]) * (gy[2] - gy[0]) - (gx[2] - gx[0]) * (gy[1] - gy[0])
    is_counterclockwise = area < vec.i32(0)
    area_sign = vec.select(is_counterclockwise, vec.i32(-1), vec.i32(1))
    is_culled = area_sign == vec.i32(draw.culled_area_sign)
    visible_small = in_image & fits_small & (area != vec.i32(0)) & (area_sign != vec.i32(draw.hidden_area_sign))
    if frame.first_back_bin == 0:  # culled faces are not kept
        visible_small = visible_small & ~is_culled
    if vec.movemask(visible_small) == 0 and general_bits == 0:
        return

    # Edge functions, of corners in clockwise order, and planes of 1/z, to which the order does not matter.
    triangles = EightTriangles(
        ids=vec.i32(draw.first_id + first_triangle) + vec.iota(),
        box=box,
        edges=edge_functions(_swap_last_two(is_counterclockwise, gx), _swap_last_two(is_counterclockwise, gy), box),
        plane=inv_z_plane(corners, box),
    )

    # Draw tiny ones; the others become primitives.
    small_bits = vec.movemask(visible_small)
    if can_rasterize_tiny(frame, chunk):
        tiny = visible_small & is_tiny(frame, box)
        if vec.movemask(tiny) != 0:
            rasterize_tiny(frame, triangles, tiny, is_culled, chunk)
            small_bits &= ~vec.movemask(tiny)
    if (small_bits | general_bits) != 0:
        small_fields = _small_fields_array()  # the same memory for every eight triangles
        _store_small_fields(small_fields, triangles)
        bits = _LaneBits(small=small_bits, general=general_bits, culled=vec.movemask(is_culled))
        _append_primitives(frame, draw_index, first_triangle, bits, small_fields, chunk)


@inlined
def _passes_unclipped(frame: RasterFrame, inv_z: F32x8x3, count: I64) -> Mask8:
    """Return which of the first ``count`` triangles may be visible and need no clipping: all corners have a positive
    1/z, not BEFORE_NEAR_PLANE or OUTSIDE_GUARD_BAND, and at least one corner is nearer than the far plane."""
    is_used = vec.iota() < vec.i32(count)
    return is_used & (minimum_of_3(inv_z) > vec.f32(0.0)) & (maximum_of_3(inv_z) >= vec.f32(frame.inv_z_far))


@inlined
def _needs_clipping(inv_z: F32x8x3, count: I64) -> Mask8:
    """Return which of the first ``count`` triangles have a corner BEFORE_NEAR_PLANE or OUTSIDE_GUARD_BAND, but not all
    BEFORE_NEAR_PLANE."""
    is_used = vec.iota() < vec.i32(count)
    return is_used & (minimum_of_3(inv_z) < vec.f32(0.0)) & (maximum_of_3(inv_z) > vec.f32(BEFORE_NEAR_PLANE))


@inlined
def _fits_small(box: Box[I32x8], inv_z: F32x8x3) -> Mask8:
    """Return the triangles whose edge functions fit int32, and whose plane of 1/z is exact enough in float32."""
    fits = (box.right - box.left <= vec.i32(MAX_SMALL_WIDTH)) & (box.bottom - box.top <= vec.i32(MAX_SMALL_HEIGHT))
    return fits & (maximum_of_3(inv_z) <= minimum_of_3(inv_z) * vec.f32(MAX_SMALL_DEPTH_RATIO))


@inlined
def _swap_last_two(swapped: Mask8, coordinate: I32x8x3) -> I32x8x3:
    """Return a coordinate of the three corners, the last two exchanged in the lanes of ``swapped``."""
    return select3(swapped, (coordinate[0], coordinate[2], coordinate[1]), coordinate)


@inlined
def _store_small_fields(small_fields: Pointer[I32], triangles: EightTriangles) -> None:
    """Write eight SmallTriangles as (SMALL_FIELD_COUNT, 8): one row per field, one column per triangle."""
    ids, box, edges, plane = triangles
    row_shift = vec.i32(16)
    packed_origin = (box.top << row_shift) | (box.left & vec.i32(0xFFFF))
    packed_size = ((box.bottom - box.top) << row_shift) | (box.right - box.left)
    _store_row(small_fields, SMALL_FIELD_INDEX.edge_base, edges.base[0])
    _store_row(small_fields, SMALL_FIELD_INDEX.edge_base + 1, edges.base[1])
    _store_row(small_fields, SMALL_FIELD_INDEX.edge_base + 2, edges.base[2])
    _store_row(small_fields, SMALL_FIELD_INDEX.edge_dx, edges.dx[0])
    _store_row(small_fields, SMALL_FIELD_INDEX.edge_dx + 1, edges.dx[1])
    _store_row(small_fields, SMALL_FIELD_INDEX.edge0_dy, edges.dy[0])
    _store_row(small_fields, SMALL_FIELD_INDEX.edge1_dy, edges.dy[1])
    _store_row(small_fields, SMALL_FIELD_INDEX.id, ids)
    _store_row(small_fields, SMALL_FIELD_INDEX.kind, vec.i32(KIND_SMALL))
    _store_row(small_fields, SMALL_FIELD_INDEX.box_origin, packed_origin)
    _store_row(small_fields, SMALL_FIELD_INDEX.box_size, packed_size)
    _store_row(small_fields, SMALL_FIELD_INDEX.inv_z_base, vec.float_bits(plane.base))
    _store_row(small_fields, SMALL_FIELD_INDEX.inv_z_dx, vec.float_bits(plane.dx))
    _store_row(small_fields, SMALL_FIELD_INDEX.inv_z_dy, vec.float_bits(plane.dy))
    _store_row(small_fields, SMALL_FIELD_INDEX.inv_z_min, vec.float_bits(plane.min))
    _store_row(small_fields, SMALL_FIELD_INDEX.inv_z_max, vec.float_bits(plane.max))


@inlined
def _store_row(small_fields: Pointer[I32], field: I64, words: I32x8) -> None:
    vec.store(small_fields, vec.LANES * field, words)


@inlined
def _append_primitives(
    frame: RasterFrame, draw_index: I64, first_triangle: I64, bits: _LaneBits, small_fields: Pointer[I32], chunk: Chunk
) -> None:
    """Append triangles to a Chunk in the order of their lanes; ``first_triangle``: that of lane 0."""
    pending = bits.small | bits.general
    while pending != 0:
        lane = vec.lowest_bit(pending)
        bit = i64(1) << lane
        pending &= pending - 1
        primitive = chunk.primitives[chunk.primitive_count]  # append_primitive keeps it only if it touches a bin
        if bit & bits.small:
            # Word by word: often few of eight are kept, so that transposing all would not pay.
            words = i32_at(address(primitive))
            for field in range(SMALL_FIELD_COUNT):
                words[field] = small_fields[vec.LANES * field + lane]
            _, top, _, bottom = box_of(SmallTriangle(address(primitive)))
            base_bin = frame.first_back_bin if bit & bits.culled else 0
            first_bin, last_bin = bin_range(max(top, 0), min(bottom, frame.height), base_bin)
        else:
            first_bin, last_bin = set_up_general_triangle(frame, draw_index, first_triangle + lane, primitive)
            primitive.id = frame.draws[draw_index].first_id + first_triangle + lane
        append_primitive(chunk, first_bin, last_bin)
