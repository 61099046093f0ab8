"""Set-up of spans: attributes of eight spans at a time, as linear functions of the pixel.

In: the spans of a part (see ``spans``), each with its first pixel and the primitive that it sees, and the mesh.
Out: rows of PartSpans. The *weights* of a primitive's vertices are their barycentric coordinates times a common
factor, which makes them linear over the image: see the head of ``span_weights``. The sum of the weights is that factor.
Weighted sums of attributes are linear, too. Two values per span describe each sum::

    weighted sum
        │            ·     start + per_pixel * (pixel - first pixel)
        │       ·
        │  ·               start = sum of weights.start[v] * attribute[v] over the vertices v; per_pixel likewise
        └─────────────── pixels of the span

``interpolation`` divides them by the sum of the weights, so that attributes are perspective-correct. Three more kinds
of values are stored where shading reads them: 1/z, which is linear by itself, flat normals, and, for texture filters,
the changes of weighted sums per column and row of the image. Signs of a triangle, by the order of its vertices::

                         determinant    weight_sign    facing    facing in a mirrored instance
    counter-clockwise        < 0            -1            1          -1
    clockwise                > 0             1           -1           1
"""

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
    EXTRA_TANGENT,
    EXTRA_UV1,
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    ROW_STRIDE,
    TRIANGLE_VERTICES,
    UV_SET_ROWS,
    VERTEX_COLUMNS,
    VERTEX_NORMAL,
    VERTEX_UV0,
    ShadingContext,
)
from renderers.shading.span_weights import Weights, inv_z_along_span, rays_of, scaled_weights, weight_matrix
from renderers.shading.vec3 import cross, dot, minus, store3, times, to_f32x3, transform_directions, transform_points

_EXTRA_BITANGENT_SIGN: Final = EXTRA_TANGENT + 3
_COLOR_COLUMNS: Final = 4
_ALL_LANES: Final = (1 << vec.LANES) - 1
_PREFETCH_MIN_PRIMITIVES: Final = 1 << 16
"""Number of primitives from which an instance's vertices are prefetched: they have a megabyte or more."""
VertexValues = TypeVar("VertexValues", F32x8x4, F32x8x8)
"""Values of one vertex of each of eight primitives: a colour, or a row of ``vertices`` or ``extras``."""


class CornerAttributes(NamedTuple, Generic[VertexValues]):
    """Attributes at the three vertices of eight primitives."""

    a: VertexValues
    b: VertexValues
    c: VertexValues


class CornerIndexPointers(NamedTuple):
    """Where the indices of eight primitives' vertices are. Lane k has the vertices a[i], b[i] and c[i], with
    i = index_offset[k].

    Of triangles, b and c point 1 and 2 entries behind a. Lines and points repeat their last vertex."""

    a: Pointer[U32]
    b: Pointer[U32]
    c: Pointer[U32]
    index_offset: I32x8


@device_function
def set_up_part(context: ShadingContext, first_span: I64, part_end_span: I64, segment_end_span: I64) -> bool:
    """Fill PartSpans for a part of a segment: the spans ``first_span .. part_end_span``, at most MAX_PART_PIXELS.

    Return True if the normal is constant along each span. Spans from ``segment_end_span`` on are not prefetched.
    """
    call_kernel(context.inputs.span_setup_kernel, (address(context), first_span, part_end_span, segment_end_span))
    return context.has_constant_normals != 0


@kernel
def set_up_part_kernel(context_address: Address, first_span: I64, part_end_span: I64, segment_end_span: I64) -> None:
    """Kernel behind ``set_up_part``, compiled once for all looks; the result is ``has_constant_normals``."""
    context, has_constant_normals = ShadingContext(context_address), True
    is_triangle_mesh = context.instance.vertices_per_primitive == TRIANGLE_VERTICES
    is_large_mesh = is_triangle_mesh and context.end_id - context.first_id > _PREFETCH_MIN_PRIMITIVES
    for span in range(first_span, part_end_span, vec.LANES):
        if is_large_mesh:
            _prefetch(context, span, segment_end_span)
        span_count = min(part_end_span - span, vec.LANES)
        is_constant = _set_up_eight_spans(context, span, span_count, span - first_span)
        has_constant_normals = has_constant_normals and is_constant
    context.has_constant_normals = has_constant_normals


@inlined
def _prefetch(context: ShadingContext, span: I64, segment_end_span: I64) -> None:
    """Prefetch vertices of the eight spans 16 ahead of ``span``, and indices of those 32 ahead.

    Meshes of a million triangles do not fit the second-level cache: without this, frames take a third longer.
    """
    primitive_ids, first_id = context.span_primitive_ids, context.first_id
    indices, vertices = context.instance.indices, context.instance.vertices
    for k in range(min(span + 2 * vec.LANES, segment_end_span), min(span + 3 * vec.LANES, segment_end_span)):
        first_index = 3 * (i64(primitive_ids[k]) - first_id)
        for corner in range(3):
            vec.prefetch(vertices, i64(indices[first_index + corner]) * VERTEX_COLUMNS)
    for k in range(min(span + 4 * vec.LANES, segment_end_span), min(span + 5 * vec.LANES, segment_end_span)):
        vec.prefetch(indices, 3 * (i64(primitive_ids[k]) - first_id))


@device_function
def _set_up_eight_spans(context: ShadingContext, span: I64, span_count: I64, slot: I64) -> bool:
    """Set up 1 to 8 spans from ``span`` on, whose values in each row of PartSpans begin at ``slot``.

    Return True if the normal is constant along each span.
    """
    part_spans, material, attribute_bits = context.part_spans, context.material, context.used_attribute_bits
    # Pixels and primitives. Lanes beyond the last span repeat it: what follows may belong to other instances.
    source_lane = vec.minimum(vec.iota(), vec.i32(span_count - 1))
    primitive_id = vec.permute(vec.load(context.span_primitive_ids, span), source_lane)
    first_pixel = vec.permute(vec.load(context.span_starts, span), source_lane)
    end_pixel = vec.permute(vec.load(context.span_starts, span + 1), source_lane)
    steps_to_last = vec.to_f64(end_pixel - first_pixel - vec.i32(1))
    first_column = first_pixel
    if context.columns != 0:
        first_column = vec.gather(i32_at(context.columns), first_pixel)

    # Vertices, in the camera's optical frame: x right, y down, z forward.
    index_pointers = _corner_index_pointers(context, primitive_id)
    corner_values = _load_vertex_rows(context.instance.vertices, index_pointers)  # they begin with the position
    p0 = transform_points(context.X_camera_mesh, corner_values.a)
    p1 = transform_points(context.X_camera_mesh, corner_values.b)
    p2 = transform_points(context.X_camera_mesh, corner_values.c)

    # Weights, first column and facing.
    rays = rays_of(context.inputs, context.y, first_column, steps_to_last)
    matrix, determinant, weight_sign = weight_matrix(context.instance.vertices_per_primitive, p0, p1, p2, rays)
    weights = scaled_weights(matrix, weight_sign, rays, steps_to_last, context.inputs)
    # As in the table of signs. Any value will do for lines and points: they have no faces, and are not lit.
    mirror_sign = vec.f32(context.matrices.mirror_sign)
    facing = vec.select(determinant > vec.f64(0.0), -mirror_sign, mirror_sign)
    vec.store(part_spans.first_column, slot, vec.to_f32(first_column))
    vec.store(part_spans.facing, slot, facing)
    _store_weight_sums(advance(part_spans.weight_sum, slot), weights.start, weights.per_pixel)

    # Attributes that the mesh has and the material reads.
    has_vertex_normals = (attribute_bits & HAS_NORMALS) != 0
    has_constant_normals = True
    if has_vertex_normals:
        has_constant_normals = _store_normals(context, slot, weights, corner_values, facing)
    if not has_vertex_normals or context.inputs.reads_flat_normals != 0:
        _store_flat_normals(context, slot, p0, p1, p2, weight_sign)
    if attribute_bits & HAS_UV0:
        _store_attributes(advance(part_spans.uv, slot), 2, weights.start, weights.per_pixel, corner_values, VERTEX_UV0)
    if context.inputs.reads_positions != 0:
        depths = p0[2], p1[2], p2[2]
        inv_z, inv_z_per_pixel = inv_z_along_span(matrix, determinant, weight_sign, rays, steps_to_last, depths)
        vec.store(part_spans.inv_z, slot, vec.to_f32(inv_z))
        vec.store(part_spans.inv_z, ROW_STRIDE + slot, vec.to_f32(inv_z_per_pixel))
    if material.reads_gradients != 0:
        _store_gradients(context, slot, weights, corner_values)
    if attribute_bits & HAS_COLORS:
        colors = _load_colors(context.instance.colors, index_pointers)
        _store_attributes(advance(part_spans.color, slot), _COLOR_COLUMNS, weights.start, weights.per_pixel, colors, 0)
    if attribute_bits & (HAS_UV1 | HAS_TANGENTS):
        _store_extras(context, slot, weights, _load_vertex_rows(context.instance.extras, index_pointers))
    return has_constant_normals


@inlined
def _corner_index_pointers(context: ShadingContext, primitive_id: I32x8) -> CornerIndexPointers:
    """Return where the indices of eight primitives' vertices are."""
    indices, vertices_per_primitive = context.instance.indices, context.instance.vertices_per_primitive
    b = advance(indices, min(vertices_per_primitive, 2) - 1)
    c = advance(indices, vertices_per_primitive - 1)
    primitive_in_mesh = primitive_id - vec.i32(context.first_id)
    return CornerIndexPointers(indices, b, c, primitive_in_mesh * vec.i32(vertices_per_primitive))


@inlined
def _load_vertex_rows(table: Pointer[F32], pointers: CornerIndexPointers) -> CornerAttributes[F32x8x8]:
    """Return the vertices' rows in a table of eight columns."""
    a, b, c, offset = pointers
    return CornerAttributes(
        vec.load_rows(table, a, offset), vec.load_rows(table, b, offset), vec.load_rows(table, c, offset)
    )


@inlined
def _load_colors(colors: Pointer[F32], pointers: CornerIndexPointers) -> CornerAttributes[F32x8x4]:
    """Return the vertices' colours."""
    a, b, c, offset = pointers
    value_count = vec.i32(_COLOR_COLUMNS)
    return CornerAttributes(
        vec.load_quads(colors, vec.gather(a, offset) * value_count),
        vec.load_quads(colors, vec.gather(b, offset) * value_count),
        vec.load_quads(colors, vec.gather(c, offset) * value_count),
    )


@inlined
def _weighted_sum(weights: F32x8x3, corner_values: CornerAttributes[VertexValues], k: I64) -> F32x8:
    """Return the weighted sum of value ``k``."""
    return weights[0] * corner_values.a[k] + weights[1] * corner_values.b[k] + weights[2] * corner_values.c[k]


@inlined
def _weighted_sum3(weights: F32x8x3, corner_values: CornerAttributes[F32x8x8], k: I64) -> F32x8x3:
    """Return the weighted sums of the values k, k + 1 and k + 2."""
    return (
        _weighted_sum(weights, corner_values, k),
        _weighted_sum(weights, corner_values, k + 1),
        _weighted_sum(weights, corner_values, k + 2),
    )


@inlined
def _store_attributes(
    rows: Pointer[F32],
    component_count: I64,
    upper_weights: F32x8x3,
    lower_weights: F32x8x3,
    corner_values: CornerAttributes[VertexValues],
    first_component: I64,
) -> None:
    """Store weighted sums of ``component_count`` components, one a row: by ``upper_weights``, and below them in as many
    rows by ``lower_weights``."""
    for j in range(component_count):
        vec.store(rows, j * ROW_STRIDE, _weighted_sum(upper_weights, corner_values, first_component + j))
        lower_row = (component_count + j) * ROW_STRIDE
        vec.store(rows, lower_row, _weighted_sum(lower_weights, corner_values, first_component + j))


@inlined
def _store_weight_sums(rows: Pointer[F32], upper_weights: F32x8x3, lower_weights: F32x8x3) -> None:
    """Store the sum of ``upper_weights``, and in the row below it that of ``lower_weights``."""
    vec.store(rows, 0, upper_weights[0] + upper_weights[1] + upper_weights[2])
    vec.store(rows, ROW_STRIDE, lower_weights[0] + lower_weights[1] + lower_weights[2])


@inlined
def _store_normals(
    context: ShadingContext, slot: I64, weights: Weights, corner_values: CornerAttributes[F32x8x8], facing: F32x8
) -> bool:
    """Store sums of vertex normals, any length; return True if constant along spans. ``facing``: as in PartSpans."""
    normals, normal_matrix = advance(context.part_spans.normal, slot), context.matrices.normal
    a, b, c = corner_values
    nx, ny, nz = VERTEX_NORMAL, VERTEX_NORMAL + 1, VERTEX_NORMAL + 2
    is_same = (a[nx] == b[nx]) & (a[ny] == b[ny]) & (a[nz] == b[nz])
    is_same = is_same & (a[nx] == c[nx]) & (a[ny] == c[ny]) & (a[nz] == c[nz])
    is_constant = vec.movemask(is_same) == _ALL_LANES
    zero = vec.f32(0.0)
    # Only a normal's direction matters, so equal ones need no weights: their weighted sum has the same direction.
    start, per_pixel = (a[nx], a[ny], a[nz]), (zero, zero, zero)
    if not is_constant:
        start = _weighted_sum3(weights.start, corner_values, VERTEX_NORMAL)
        per_pixel = _weighted_sum3(weights.per_pixel, corner_values, VERTEX_NORMAL)
    store3(normals, 0, ROW_STRIDE, times(transform_directions(normal_matrix, start), facing))
    changes = advance(normals, 3 * ROW_STRIDE)
    store3(changes, 0, ROW_STRIDE, times(transform_directions(normal_matrix, per_pixel), facing))
    return is_constant


@inlined
def _store_flat_normals(
    context: ShadingContext, slot: I64, p0: F64x8x3, p1: F64x8x3, p2: F64x8x3, weight_sign: F64x8
) -> None:
    """Fill ``flat_normal``, and ``normal`` if the mesh has no normals that the material reads."""
    part_spans, zero, one = context.part_spans, vec.f64(0.0), vec.f64(1.0)
    plane_normal = cross(minus(p1, p0), minus(p2, p0))
    length = vec.sqrt(dot(plane_normal, plane_normal))
    has_length = (length > zero) & (length < vec.f64(math.inf))
    # plane_normal . p0 is the determinant. It is negative, and weight_sign -1, where plane_normal faces the camera.
    scale = vec.select(has_length, (zero - weight_sign) / vec.select(has_length, length, one), zero)
    normal = to_f32x3(times(plane_normal, scale))
    if (context.used_attribute_bits & HAS_NORMALS) == 0:  # ``interpolate`` reads ``normal`` even for unlit materials
        store3(advance(part_spans.normal, slot), 0, ROW_STRIDE, normal)
        no_change = vec.f32(0.0), vec.f32(0.0), vec.f32(0.0)
        store3(advance(part_spans.normal, 3 * ROW_STRIDE + slot), 0, ROW_STRIDE, no_change)
    store3(advance(part_spans.flat_normal, slot), 0, ROW_STRIDE, normal)


@inlined
def _store_gradients(
    context: ShadingContext, slot: I64, weights: Weights, corner_values: CornerAttributes[F32x8x8]
) -> None:
    """Store how the sums of the weights and of uv0 change per column and row of the image; uv1's: ``_store_extras``."""
    part_spans, per_column, per_row = context.part_spans, weights.per_column, weights.per_row
    _store_weight_sums(advance(part_spans.weight_sum_gradient, slot), per_column, per_row)
    if context.used_attribute_bits & HAS_UV0:
        _store_attributes(advance(part_spans.uv_gradient, slot), 2, per_column, per_row, corner_values, VERTEX_UV0)


@inlined
def _store_extras(context: ShadingContext, slot: I64, weights: Weights, extras: CornerAttributes[F32x8x8]) -> None:
    """Store weighted sums of uv1 and of tangents."""
    part_spans, uv1_offset = context.part_spans, UV_SET_ROWS * ROW_STRIDE + slot
    if context.used_attribute_bits & HAS_UV1:
        _store_attributes(advance(part_spans.uv, uv1_offset), 2, weights.start, weights.per_pixel, extras, EXTRA_UV1)
        if context.material.reads_gradients != 0:
            per_column, per_row = weights.per_column, weights.per_row
            _store_attributes(advance(part_spans.uv_gradient, uv1_offset), 2, per_column, per_row, extras, EXTRA_UV1)
    if context.used_attribute_bits & HAS_TANGENTS:
        tangents = advance(part_spans.tangent, slot)
        _store_tangents(context, tangents, weights.start, extras)
        _store_tangents(context, advance(tangents, 4 * ROW_STRIDE), weights.per_pixel, extras)


@inlined
def _store_tangents(
    context: ShadingContext, rows: Pointer[F32], weights: F32x8x3, extras: CornerAttributes[F32x8x8]
) -> None:
    """Store the weighted sums of tangents, in the optical frame, and of the signs of the bitangent."""
    tangents = _weighted_sum3(weights, extras, EXTRA_TANGENT)
    store3(rows, 0, ROW_STRIDE, transform_directions(context.matrices.tangent, tangents))
    vec.store(rows, 3 * ROW_STRIDE, _weighted_sum(weights, extras, _EXTRA_BITANGENT_SIGN))
