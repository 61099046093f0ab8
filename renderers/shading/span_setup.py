"""Set-up of spans: weighted sums of the vertices' attributes at the first pixel of a span, and their change per pixel.

``interpolation`` divides the sums by the sum of the weights (``span_weights``).
"""

from __future__ import annotations

import math
from typing import Final, TypeVar

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel
from renderers.compiler.kernel_types import F32, I64, Address, Pointer, i64
from renderers.compiler.pointers import address, i32_at
from renderers.compiler.simd import F32x8, F32x8x3, F32x8x4, F32x8x8, F64x8, F64x8x3, I32x8, I32x8x3
from renderers.drawlist import Topology
from renderers.shading.layout import (
    E_COLUMNS,
    E_TANGENT,
    E_UV1,
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    SPAN_STRIDE,
    V_COLUMNS,
    V_NORMAL,
    V_UV0,
    Segment,
)
from renderers.shading.span_weights import TRIANGLES, Weights, rays_of, scaled_weights, weight_matrix
from renderers.shading.vec3 import cross, dot, minus, times, to_f32x3, transform_directions, transform_points

_LINES: Final = int(Topology.LINES)
_SIGN: Final = E_TANGENT + 3
"""Column of ``extras`` with the sign of the bitangent."""
Attributes = TypeVar("Attributes", F32x8x4, F32x8x8)
"""Colours, or the values of V_COLUMNS or E_COLUMNS, of one vertex of eight primitives."""


@inlined
def _vertex_indices(segment: Segment, primitive: I32x8) -> I32x8x3:
    """Return the indices of the three vertices of eight primitives. Lines and points repeat the last one.

    Args:
        primitive: indices among the primitives of the mesh.
    """
    indices = segment.instance.indices
    if segment.instance.topology == TRIANGLES:
        return vec.load_elements(indices, primitive * vec.i32(3))
    if segment.instance.topology == _LINES:
        second = vec.gather(indices, primitive + primitive + vec.i32(1))
        return vec.gather(indices, primitive + primitive), second, second
    only = vec.gather(indices, primitive)
    return only, only, only


@inlined
def _weighted_sum(weights: F32x8x3, a: F32x8, b: F32x8, c: F32x8) -> F32x8:
    """Return the weighted sum of one attribute of three vertices."""
    return weights[0] * a + weights[1] * b + weights[2] * c


@inlined
def _weighted_sum3(weights: F32x8x3, a: F32x8x8, b: F32x8x8, c: F32x8x8, k: I64) -> F32x8x3:
    """Return the weighted sums of the values k, k + 1 and k + 2 of three vertices."""
    return (
        _weighted_sum(weights, a[k], b[k], c[k]),
        _weighted_sum(weights, a[k + 1], b[k + 1], c[k + 1]),
        _weighted_sum(weights, a[k + 2], b[k + 2], c[k + 2]),
    )


@inlined
def _store_weighted_sums(
    rows: Pointer[F32],
    row: I64,
    count: I64,
    at: I64,
    weights: F32x8x3,
    weight_steps: F32x8x3,
    a: Attributes,
    b: Attributes,
    c: Attributes,
    k: I64,
) -> None:
    """Store weighted sums of the values ``k .. k + count`` of three vertices in ``count`` rows from ``row`` on.

    The sums with ``weight_steps`` are stored in the ``count`` rows after them.

    Args:
        weights, weight_steps: fields of Weights.
        a, b, c: values of the vertices, one f32x8 per column of ``vertices``, ``extras`` or ``colors``.
    """
    for j in range(count):
        vec.store(rows, (row + j) * SPAN_STRIDE + at, _weighted_sum(weights, a[k + j], b[k + j], c[k + j]))
        vec.store(rows, (row + count + j) * SPAN_STRIDE + at, _weighted_sum(weight_steps, a[k + j], b[k + j], c[k + j]))


@inlined
def _store3(rows: Pointer[F32], row: I64, at: I64, values: F32x8x3) -> None:
    """Store three f32x8 in the rows of Spans from ``row`` on."""
    vec.store(rows, row * SPAN_STRIDE + at, values[0])
    vec.store(rows, (row + 1) * SPAN_STRIDE + at, values[1])
    vec.store(rows, (row + 2) * SPAN_STRIDE + at, values[2])


@device_function
def _store_gradients(segment: Segment, at: I64, weights: Weights, a: F32x8x8, b: F32x8x8, c: F32x8x8) -> None:
    """Store how the sum of the weights and the weighted sum of uv0 change per column and per row of the image.

    Args:
        a, b, c: vertices, V_COLUMNS f32x8 each.
    """
    spans = segment.spans
    _store_sums(spans.weight_sum_gradient, 0, at, weights.per_column, weights.per_row)
    if segment.attributes & HAS_UV0:
        _store_weighted_sums(spans.uv_gradient, 0, 2, at, weights.per_column, weights.per_row, a, b, c, V_UV0)


@device_function
def _set_up_eight(segment: Segment, span: I64, count: I64, at: I64) -> bool:
    """Fill Spans with at most eight spans from ``span`` on.

    Args:
        count: number of spans, 1 .. 8.

    Returns:
        True if the normal is constant along each span.
    """
    X_camera_mesh, job, material = segment.X_camera_mesh, segment.job, segment.material
    starts, spans, attributes = segment.starts, segment.spans, segment.attributes
    # Lanes beyond the last span repeat it: the ids there belong to other instances.
    lane = vec.minimum(vec.iota(), vec.i32(count - 1))
    primitive_id = vec.permute(vec.load(segment.ids, span), lane)
    first_column = vec.permute(vec.load(starts, span), lane)
    step_count = vec.to_f64(vec.permute(vec.load(starts, span + 1), lane) - first_column - vec.i32(1))
    if segment.columns != 0:
        first_column = vec.gather(i32_at(segment.columns), first_column)
    indices = _vertex_indices(segment, primitive_id - vec.i32(segment.first_id))
    a, b, c = _load_vertices(segment.instance.vertices, indices)
    p0 = transform_points(X_camera_mesh, a)
    p1 = transform_points(X_camera_mesh, b)
    p2 = transform_points(X_camera_mesh, c)
    rays = rays_of(job, segment.y, first_column, step_count)
    matrix, determinant, sign = weight_matrix(segment.instance.topology, p0, p1, p2, rays)
    weights, scale = scaled_weights(matrix, sign, rays, step_count, job)
    mirror = vec.f32(segment.matrices.mirror)
    facing = vec.select(determinant > vec.f64(0.0), -mirror, mirror)
    vec.store(spans.begin, at, vec.to_f32(first_column))
    vec.store(spans.facing, at, facing)
    _store_sums(spans.weight_sum, 0, at, weights.first, weights.per_pixel)
    is_constant = True
    if attributes & HAS_NORMALS:
        is_constant = _store_normals(segment, at, weights, a, b, c, facing)
    if not attributes & HAS_NORMALS or material.has_surface != 0:
        _store_flat_normals(segment, at, p0, p1, p2, sign)
    if attributes & HAS_UV0:
        _store_weighted_sums(spans.uv, 0, 2, at, weights.first, weights.per_pixel, a, b, c, V_UV0)
    if material.has_surface != 0:
        vec.store(spans.depth, at, vec.to_f32(vec.absolute(determinant) * scale))
    if material.has_gradients != 0:
        _store_gradients(segment, at, weights, a, b, c)
    if attributes & HAS_COLORS:
        u, v, w = _load_colors(segment.instance.colors, indices)
        _store_weighted_sums(spans.color, 0, 4, at, weights.first, weights.per_pixel, u, v, w, 0)
    if attributes & (HAS_UV1 | HAS_TANGENTS):
        _store_extras(segment, at, weights, indices)
    return is_constant


@inlined
def _load_vertices(vertices: Pointer[F32], indices: I32x8x3) -> tuple[F32x8x8, F32x8x8, F32x8x8]:
    """Return the values of three vertices of eight primitives, V_COLUMNS f32x8 each."""
    columns = vec.i32(V_COLUMNS)
    return (
        vec.load_octets(vertices, indices[0] * columns),
        vec.load_octets(vertices, indices[1] * columns),
        vec.load_octets(vertices, indices[2] * columns),
    )


@inlined
def _load_colors(colors: Pointer[F32], indices: I32x8x3) -> tuple[F32x8x4, F32x8x4, F32x8x4]:
    """Return the colours of three vertices of eight primitives."""
    columns = vec.i32(4)
    return (
        vec.load_quads(colors, indices[0] * columns),
        vec.load_quads(colors, indices[1] * columns),
        vec.load_quads(colors, indices[2] * columns),
    )


@inlined
def _store_sums(rows: Pointer[F32], row: I64, at: I64, weights: F32x8x3, weight_steps: F32x8x3) -> None:
    """Store the sum of weights in a row of Spans, and that of their changes in the next one; three f32x8 each."""
    vec.store(rows, row * SPAN_STRIDE + at, weights[0] + weights[1] + weights[2])
    vec.store(rows, (row + 1) * SPAN_STRIDE + at, weight_steps[0] + weight_steps[1] + weight_steps[2])


@inlined
def _store_normals(
    segment: Segment, at: I64, weights: Weights, a: F32x8x8, b: F32x8x8, c: F32x8x8, facing: F32x8
) -> bool:
    """Store the normals of vertices; return True if they are constant along each span.

    Args:
        a, b, c: vertices, V_COLUMNS f32x8 each.
        facing: as Spans.facing.
    """
    spans, matrix, zero, k = segment.spans, segment.matrices.normal, vec.f32(0.0), V_NORMAL
    is_same = (a[k] == b[k]) & (a[k + 1] == b[k + 1]) & (a[k + 2] == b[k + 2])
    is_same = is_same & (a[k] == c[k]) & (a[k + 1] == c[k + 1]) & (a[k + 2] == c[k + 2])
    is_constant = vec.movemask(is_same) == 255
    normal, step = (a[k], a[k + 1], a[k + 2]), (zero, zero, zero)
    if not is_constant:
        normal, step = _weighted_sum3(weights.first, a, b, c, k), _weighted_sum3(weights.per_pixel, a, b, c, k)
    _store3(spans.normal, 0, at, times(transform_directions(matrix, normal), facing))
    _store3(spans.normal, 3, at, times(transform_directions(matrix, step), facing))
    return is_constant


@inlined
def _store_flat_normals(segment: Segment, at: I64, p0: F64x8x3, p1: F64x8x3, p2: F64x8x3, sign: F64x8) -> None:
    """Store the unit normals of triangles, also as those of vertices where a mesh has none.

    Args:
        p0, p1, p2: vertices, metres, optical frame.
        sign: of ``weight_matrix``.
    """
    spans, zero, one = segment.spans, vec.f64(0.0), vec.f64(1.0)
    plane_normal = cross(minus(p1, p0), minus(p2, p0))
    length = vec.sqrt(dot(plane_normal, plane_normal))
    has_length = (length > zero) & (length < vec.f64(math.inf))
    # plane_normal . p0 is the determinant, which is negative where plane_normal faces the camera.
    scale = vec.select(has_length, (zero - sign) / vec.select(has_length, length, one), zero)
    normal = to_f32x3(times(plane_normal, scale))
    if not segment.attributes & HAS_NORMALS:
        _store3(spans.normal, 0, at, normal)
        _store3(spans.normal, 3, at, (vec.f32(0.0), vec.f32(0.0), vec.f32(0.0)))
    _store3(spans.flat_normal, 0, at, normal)


@inlined
def _store_extras(segment: Segment, at: I64, weights: Weights, indices: I32x8x3) -> None:
    """Store weighted sums of uv1 and of tangents.

    Args:
        indices: of the vertices.
    """
    spans, matrix, extras = segment.spans, segment.matrices.tangent, segment.instance.extras
    columns = vec.i32(E_COLUMNS)
    a = vec.load_octets(extras, indices[0] * columns)
    b = vec.load_octets(extras, indices[1] * columns)
    c = vec.load_octets(extras, indices[2] * columns)
    if segment.attributes & HAS_UV1:
        _store_weighted_sums(spans.uv, 4, 2, at, weights.first, weights.per_pixel, a, b, c, E_UV1)
        if segment.material.has_gradients != 0:
            _store_weighted_sums(spans.uv_gradient, 4, 2, at, weights.per_column, weights.per_row, a, b, c, E_UV1)
    if segment.attributes & HAS_TANGENTS:
        _store3(spans.tangent, 0, at, transform_directions(matrix, _weighted_sum3(weights.first, a, b, c, E_TANGENT)))
        vec.store(spans.tangent, 3 * SPAN_STRIDE + at, _weighted_sum(weights.first, a[_SIGN], b[_SIGN], c[_SIGN]))
        _store3(
            spans.tangent, 4, at, transform_directions(matrix, _weighted_sum3(weights.per_pixel, a, b, c, E_TANGENT))
        )
        vec.store(spans.tangent, 7 * SPAN_STRIDE + at, _weighted_sum(weights.per_pixel, a[_SIGN], b[_SIGN], c[_SIGN]))


@inlined
def _prefetch(segment: Segment, span: I64, end_span: I64) -> None:
    """Prefetch vertices of the spans two batches ahead, and indices of those four batches ahead.

    Meshes of a million triangles do not fit the cache: without this, frames take a fifth longer.

    Args:
        end_span: end of the segment.
    """
    primitive_ids, first_id = segment.ids, segment.first_id
    indices, vertices = segment.instance.indices, segment.instance.vertices
    for k in range(min(span + 2 * vec.LANES, end_span), min(span + 3 * vec.LANES, end_span)):
        first_index = 3 * (i64(primitive_ids[k]) - first_id)
        for corner in range(3):
            vec.prefetch(vertices, i64(indices[first_index + corner]) * V_COLUMNS)
    for k in range(min(span + 4 * vec.LANES, end_span), min(span + 5 * vec.LANES, end_span)):
        vec.prefetch(indices, 3 * (i64(primitive_ids[k]) - first_id))


@device_function
def set_up_spans(segment: Segment, span: I64, part_end_span: I64, end_span: I64) -> bool:
    """Fill Spans with the spans ``span .. part_end_span``, at most PART.

    Args:
        end_span: end of the segment.

    Returns:
        True if the normal is constant along each span.
    """
    call_kernel(segment.job.span_setup_kernel, (address(segment), span, part_end_span, end_span))
    return segment.has_constant_normals != 0


@kernel
def set_up_part(segment_address: Address, span: I64, part_end_span: I64, end_span: I64) -> None:
    """``set_up_spans``, compiled once for all looks. Its result is in the segment's ``has_constant_normals``.

    Args:
        segment_address: address of a Segment.
    """
    segment, is_constant = Segment(segment_address), True
    prefetches = segment.instance.topology == TRIANGLES and end_span - span > 4 * vec.LANES
    for batch in range(span, part_end_span, vec.LANES):
        if prefetches:
            _prefetch(segment, batch, end_span)
        count = min(part_end_span - batch, vec.LANES)
        is_constant = _set_up_eight(segment, batch, count, batch - span) and is_constant
    segment.has_constant_normals = is_constant
