"""Set-up of spans: attributes of eight spans at a time, as linear functions of the pixel.

In: the spans of a segment, each with its first pixel and the primitive that it sees, and the vertices of the mesh.
Out: for each attribute and for the sum of the weights, two values a span, in rows of Spans:

    weighted sum
        │            ·     start + change * (pixel - first pixel)
        │       ·
        │  ·               start, change: sums of the attribute at the three vertices, weighted as ``span_weights`` says
        └─────────────── pixels of the span

Weighted attribute and sum of the weights are each linear in the pixel. ``interpolation`` divides one by the other, so
that attributes are perspective-correct.
"""

from __future__ import annotations

import math
from typing import Final, Generic, NamedTuple, TypeVar

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel
from renderers.compiler.kernel_types import F32, I64, U32, Address, Pointer, i64
from renderers.compiler.pointers import address, advance, i32_at
from renderers.compiler.simd import F32x8, F32x8x3, F32x8x4, F32x8x8, F64x8, F64x8x3, I32x8
from renderers.shading.layout import (
    E_TANGENT,
    E_UV1,
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    SPAN_STRIDE,
    UV_SET_ROWS,
    V_COLUMNS,
    V_NORMAL,
    V_UV0,
    ShadingContext,
)
from renderers.shading.span_weights import TRIANGLES, Weights, inverse_depths, rays_of, scaled_weights, weight_matrix
from renderers.shading.vec3 import cross, dot, minus, store3, times, to_f32x3, transform_directions, transform_points

_E_BITANGENT_SIGN: Final = E_TANGENT + 3
_COLOR_COLUMNS: Final = 4
_ALL_LANES: Final = (1 << vec.LANES) - 1
_PREFETCH_MIN_PRIMITIVES: Final = 1 << 16
"""Number of primitives from which an instance's vertices are prefetched: they have a megabyte or more."""
Columns = TypeVar("Columns", F32x8x4, F32x8x8)
"""Colours, or V_COLUMNS or E_COLUMNS values, of one vertex of each of eight primitives."""


class CornerAttributes(NamedTuple, Generic[Columns]):
    """Attributes at the three vertices of eight primitives."""

    a: Columns
    b: Columns
    c: Columns


class CornerIndices(NamedTuple):
    """Indices of the three vertices of eight primitives: those of lane k are ``a[position[k]]``, ``b[position[k]]`` and
    ``c[position[k]]``, where b and c point to later values of the same array."""

    a: Pointer[U32]
    b: Pointer[U32]
    c: Pointer[U32]
    position: I32x8


@device_function
def set_up_spans(context: ShadingContext, first_span: I64, part_end_span: I64, end_span: I64) -> bool:
    """Fill Spans with the spans ``first_span .. part_end_span``, at most PART, of a segment.

    Args:
        end_span: of the segment; bounds what is prefetched.

    Returns:
        True if the normal is constant along each span.
    """
    call_kernel(context.job.span_setup_kernel, (address(context), first_span, part_end_span, end_span))
    return context.has_constant_normals != 0


@kernel
def set_up_part(context_address: Address, first_span: I64, part_end_span: I64, end_span: I64) -> None:
    """Kernel behind ``set_up_spans``, compiled once for all shaders; the result is ``has_constant_normals``."""
    context, has_constant_normals = ShadingContext(context_address), True
    prefetches = context.instance.topology == TRIANGLES and context.end_id - context.first_id > _PREFETCH_MIN_PRIMITIVES
    for span in range(first_span, part_end_span, vec.LANES):
        if prefetches:
            _prefetch(context, span, end_span)
        count = min(part_end_span - span, vec.LANES)
        has_constant_normals = _set_up_eight_spans(context, span, count, span - first_span) and has_constant_normals
    context.has_constant_normals = has_constant_normals


@inlined
def _prefetch(context: ShadingContext, span: I64, end_span: I64) -> None:
    """Prefetch vertices of the eight spans 16 ahead of ``span``, and indices of those 32 ahead.

    Meshes of a million triangles do not fit the second-level cache: without this, frames take a third longer.
    """
    primitive_ids, first_id = context.span_ids, context.first_id
    indices, vertices = context.instance.indices, context.instance.vertices
    for k in range(min(span + 2 * vec.LANES, end_span), min(span + 3 * vec.LANES, end_span)):
        position = 3 * (i64(primitive_ids[k]) - first_id)
        for corner in range(3):
            vec.prefetch(vertices, i64(indices[position + corner]) * V_COLUMNS)
    for k in range(min(span + 4 * vec.LANES, end_span), min(span + 5 * vec.LANES, end_span)):
        vec.prefetch(indices, 3 * (i64(primitive_ids[k]) - first_id))


@device_function
def _set_up_eight_spans(context: ShadingContext, span: I64, count: I64, at: I64) -> bool:
    """Set up ``count`` spans, 1 to 8, from ``span`` on: the eight values from ``at`` on of each row of Spans.

    Returns:
        True if the normal is constant along each span.
    """
    spans, material, attributes = context.spans, context.material, context.attributes
    # Pixels and primitive. Lanes beyond the last span get its values: what follows it may belong to other instances.
    lane = vec.minimum(vec.iota(), vec.i32(count - 1))
    primitive_id = vec.permute(vec.load(context.span_ids, span), lane)
    first_pixel = vec.permute(vec.load(context.span_starts, span), lane)
    end_pixel = vec.permute(vec.load(context.span_starts, span + 1), lane)
    pixel_steps = vec.to_f64(end_pixel - first_pixel - vec.i32(1))
    first_column = first_pixel
    if context.columns != 0:
        first_column = vec.gather(i32_at(context.columns), first_pixel)

    # Vertices, in the camera's optical frame: x right, y down, z forward.
    corner_indices = _corner_indices(context, primitive_id)
    corners = _load_eight_columns(context.instance.vertices, corner_indices)
    p0 = transform_points(context.X_camera_mesh, corners.a)
    p1 = transform_points(context.X_camera_mesh, corners.b)
    p2 = transform_points(context.X_camera_mesh, corners.c)

    # Weights.
    rays = rays_of(context.job, context.y, first_column, pixel_steps)
    matrix, determinant, sign = weight_matrix(context.instance.topology, p0, p1, p2, rays)
    weights = scaled_weights(matrix, sign, rays, pixel_steps, context.job)
    # A positive determinant: the corners run clockwise as seen, so the back is visible, unless the transform mirrors.
    mirror = vec.f32(context.matrices.mirror)
    facing = vec.select(determinant > vec.f64(0.0), -mirror, mirror)

    # Attributes that the mesh has and the material reads.
    vec.store(spans.first_column, at, vec.to_f32(first_column))
    vec.store(spans.facing, at, facing)
    _store_weight_sums(advance(spans.weight_sum, at), weights.first, weights.per_pixel)
    has_constant_normals = True
    if attributes & HAS_NORMALS:
        has_constant_normals = _store_normals(context, at, weights, corners, facing)
    if not attributes & HAS_NORMALS or context.job.has_flat_normals != 0:
        _store_flat_normals(context, at, p0, p1, p2, sign)
    if attributes & HAS_UV0:
        _store_attributes(advance(spans.uv, at), 2, weights.first, weights.per_pixel, corners, V_UV0)
    if context.job.has_points != 0:
        inv_depth, change_to_last = inverse_depths(matrix, determinant, sign, rays, (p0[2], p1[2], p2[2]))
        vec.store(spans.inv_depth, at, vec.to_f32(inv_depth))
        vec.store(
            spans.inv_depth, SPAN_STRIDE + at, vec.to_f32(change_to_last / vec.maximum(pixel_steps, vec.f64(1.0)))
        )
    if material.has_gradients != 0:
        _store_gradients(context, at, weights, corners)
    if attributes & HAS_COLORS:
        colors = _load_colors(context.instance.colors, corner_indices)
        _store_attributes(advance(spans.color, at), _COLOR_COLUMNS, weights.first, weights.per_pixel, colors, 0)
    if attributes & (HAS_UV1 | HAS_TANGENTS):
        _store_extras(context, at, weights, _load_eight_columns(context.instance.extras, corner_indices))
    return has_constant_normals


@inlined
def _corner_indices(context: ShadingContext, primitive_id: I32x8) -> CornerIndices:
    """Return where the vertices of eight primitives are. The last vertex of lines and points counts twice or thrice."""
    indices, topology = context.instance.indices, context.instance.topology
    b, c = advance(indices, min(topology, 2) - 1), advance(indices, topology - 1)
    return CornerIndices(indices, b, c, (primitive_id - vec.i32(context.first_id)) * vec.i32(topology))


@inlined
def _load_eight_columns(table: Pointer[F32], corner_indices: CornerIndices) -> CornerAttributes[F32x8x8]:
    """Return the vertices' values in a table of eight columns."""
    a, b, c, position = corner_indices
    return CornerAttributes(
        vec.load_rows(table, a, position), vec.load_rows(table, b, position), vec.load_rows(table, c, position)
    )


@inlined
def _load_colors(colors: Pointer[F32], corner_indices: CornerIndices) -> CornerAttributes[F32x8x4]:
    """Return the vertices' colours."""
    a, b, c, position = corner_indices
    columns = vec.i32(_COLOR_COLUMNS)
    return CornerAttributes(
        vec.load_quads(colors, vec.gather(a, position) * columns),
        vec.load_quads(colors, vec.gather(b, position) * columns),
        vec.load_quads(colors, vec.gather(c, position) * columns),
    )


@inlined
def _weighted_sum(weights: F32x8x3, corners: CornerAttributes[Columns], k: I64) -> F32x8:
    """Return the weighted sum of value ``k``."""
    return weights[0] * corners.a[k] + weights[1] * corners.b[k] + weights[2] * corners.c[k]


@inlined
def _weighted_sum3(weights: F32x8x3, corners: CornerAttributes[F32x8x8], k: I64) -> F32x8x3:
    """Return the weighted sums of the values k, k + 1 and k + 2."""
    return (
        _weighted_sum(weights, corners, k),
        _weighted_sum(weights, corners, k + 1),
        _weighted_sum(weights, corners, k + 2),
    )


@inlined
def _store_attributes(
    rows: Pointer[F32],
    count: I64,
    weights: F32x8x3,
    later_weights: F32x8x3,
    corners: CornerAttributes[Columns],
    first_value: I64,
) -> None:
    """Store the sums of ``count`` values by ``weights`` in as many rows, those by ``later_weights`` in the next."""
    for j in range(count):
        vec.store(rows, j * SPAN_STRIDE, _weighted_sum(weights, corners, first_value + j))
        vec.store(rows, (count + j) * SPAN_STRIDE, _weighted_sum(later_weights, corners, first_value + j))


@inlined
def _store_weight_sums(rows: Pointer[F32], weights: F32x8x3, later_weights: F32x8x3) -> None:
    """Store the sum of ``weights`` in a row, and that of ``later_weights`` in the next one."""
    vec.store(rows, 0, weights[0] + weights[1] + weights[2])
    vec.store(rows, SPAN_STRIDE, later_weights[0] + later_weights[1] + later_weights[2])


@inlined
def _store_normals(
    context: ShadingContext, at: I64, weights: Weights, corners: CornerAttributes[F32x8x8], facing: F32x8
) -> bool:
    """Store the normals of vertices; return True if they are constant along each span. ``facing``: as Spans.facing."""
    normals, matrix, k = advance(context.spans.normal, at), context.matrices.normal, V_NORMAL
    a, b, c = corners.a, corners.b, corners.c
    is_same = (a[k] == b[k]) & (a[k + 1] == b[k + 1]) & (a[k + 2] == b[k + 2])
    is_same = is_same & (a[k] == c[k]) & (a[k + 1] == c[k + 1]) & (a[k + 2] == c[k + 2])
    is_constant = vec.movemask(is_same) == _ALL_LANES
    zero = vec.f32(0.0)
    start, change = (a[k], a[k + 1], a[k + 2]), (zero, zero, zero)
    if not is_constant:
        start = _weighted_sum3(weights.first, corners, k)
        change = _weighted_sum3(weights.per_pixel, corners, k)
    store3(normals, 0, SPAN_STRIDE, times(transform_directions(matrix, start), facing))
    store3(advance(normals, 3 * SPAN_STRIDE), 0, SPAN_STRIDE, times(transform_directions(matrix, change), facing))
    return is_constant


@inlined
def _store_flat_normals(context: ShadingContext, at: I64, p0: F64x8x3, p1: F64x8x3, p2: F64x8x3, sign: F64x8) -> None:
    """Store the unit normals of triangles; without HAS_NORMALS, in the rows of vertex normals, too.

    Args:
        p0, p1, p2: vertices, metres, optical frame.
        sign: of ``weight_matrix``.
    """
    spans, zero, one = context.spans, vec.f64(0.0), vec.f64(1.0)
    plane_normal = cross(minus(p1, p0), minus(p2, p0))
    length = vec.sqrt(dot(plane_normal, plane_normal))
    has_length = (length > zero) & (length < vec.f64(math.inf))
    # plane_normal . p0 is the determinant, which is negative where plane_normal faces the camera.
    scale = vec.select(has_length, (zero - sign) / vec.select(has_length, length, one), zero)
    normal = to_f32x3(times(plane_normal, scale))
    if not context.attributes & HAS_NORMALS:
        store3(advance(spans.normal, at), 0, SPAN_STRIDE, normal)
        no_change = vec.f32(0.0), vec.f32(0.0), vec.f32(0.0)
        store3(advance(spans.normal, 3 * SPAN_STRIDE + at), 0, SPAN_STRIDE, no_change)
    store3(advance(spans.flat_normal, at), 0, SPAN_STRIDE, normal)


@device_function
def _store_gradients(context: ShadingContext, at: I64, weights: Weights, corners: CornerAttributes[F32x8x8]) -> None:
    """Store how the sum of the weights and the weighted sum of uv0 change per column and per row of the image."""
    across, down = weights.per_column, weights.per_row
    _store_weight_sums(advance(context.spans.weight_sum_gradient, at), across, down)
    if context.attributes & HAS_UV0:
        _store_attributes(advance(context.spans.uv_gradient, at), 2, across, down, corners, V_UV0)


@inlined
def _store_extras(context: ShadingContext, at: I64, weights: Weights, extras: CornerAttributes[F32x8x8]) -> None:
    """Store weighted sums of uv1 and of tangents."""
    spans, uv1 = context.spans, UV_SET_ROWS * SPAN_STRIDE + at
    if context.attributes & HAS_UV1:
        _store_attributes(advance(spans.uv, uv1), 2, weights.first, weights.per_pixel, extras, E_UV1)
        if context.material.has_gradients != 0:
            across, down = weights.per_column, weights.per_row
            _store_attributes(advance(spans.uv_gradient, uv1), 2, across, down, extras, E_UV1)
    if context.attributes & HAS_TANGENTS:
        tangents = advance(spans.tangent, at)
        _store_tangents(context, tangents, weights.first, extras)
        _store_tangents(context, advance(tangents, 4 * SPAN_STRIDE), weights.per_pixel, extras)


@inlined
def _store_tangents(
    context: ShadingContext, rows: Pointer[F32], weights: F32x8x3, extras: CornerAttributes[F32x8x8]
) -> None:
    """Store the weighted sums of tangents, in the optical frame, and of the signs of the bitangent."""
    tangents = _weighted_sum3(weights, extras, E_TANGENT)
    store3(rows, 0, SPAN_STRIDE, transform_directions(context.matrices.tangent, tangents))
    vec.store(rows, 3 * SPAN_STRIDE, _weighted_sum(weights, extras, _E_BITANGENT_SIGN))
