"""Weights of a primitive's vertices in spans: barycentric coordinates times their common denominator.

Let r = (x, y, 1) be a pixel's ray, z r the point that it sees, and P the matrix whose columns are the vertices in the
optical frame. The point's barycentric coordinates b fulfil P b = z r, so b / z = P^-1 r. The weights are

    w = det(P) P^-1 r = (p1 x p2, p2 x p0, p0 x p1) . r

which are linear over the image. Their sum is det(P) / z, since that of b is 1. Weighted sums of attributes, divided by
it, are perspective-correct. All is computed in float64, eight spans at a time.
"""

import math
from typing import NamedTuple

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import I64
from renderers.compiler.simd import F32x8x3, F64x8, F64x8x3, I32x8
from renderers.shading.layout import TRIANGLE_VERTICES, ShadingInputs
from renderers.shading.vec3 import cross, dot, minus, select3, times, to_f32x3


class Weights(NamedTuple):
    """Weights of the three vertices in eight spans, three f32x8 each."""

    start: F32x8x3
    """At the first pixel."""
    per_pixel: F32x8x3
    """Change from each pixel of the span to the next; 0 in spans of a single pixel."""
    per_column: F32x8x3
    """Change per column of the image."""
    per_row: F32x8x3
    """Change per row of the image."""


class Rays(NamedTuple):
    """Rays (x, y, 1) through the pixels at both ends of eight spans, in the optical frame, f64x8 each."""

    first_x: F64x8
    last_x: F64x8
    y: F64x8


@inlined
def rays_of(inputs: ShadingInputs, y: I64, first_column: I32x8, steps_to_last: F64x8) -> Rays:
    """Return the Rays of spans in row ``y`` of the image, which are ``steps_to_last`` + 1 pixels long."""
    pixel_width, pixel_height = vec.f64(1.0 / inputs.fx), vec.f64(1.0 / inputs.fy)  # in the plane z = 1
    first_x = (vec.to_f64(first_column) + vec.f64(0.5 - inputs.cx)) * pixel_width
    ray_y = vec.f64(y + 0.5 - inputs.cy) * pixel_height
    return Rays(first_x=first_x, last_x=first_x + steps_to_last * pixel_width, y=ray_y)


@inlined
def _line_weights(p: F64x8x3, q: F64x8x3) -> tuple[tuple[F64x8x3, F64x8x3, F64x8x3], F64x8]:
    """Return the matrix of the weights of a line from p to q, and its determinant, as ``weight_matrix`` does.

    Let e = q - p. The points p + t e of the line are seen on one line of the image, of the direction of
    q.xy / q.z - p.xy / p.z. Times p.z q.z, this is

        s = p.z e.xy - e.z p.xy.

    A pixel near the line shows the point that has the same component along s as the pixel's ray r = (x, y, 1):

        s . (p + t e).xy = (s . r.xy) (p + t e).z

    Solved for t, this is numerator / denominator, both linear in the ray:

        numerator   = (s . r.xy) p.z - s . p.xy
        denominator = s . e.xy - (s . r.xy) e.z

    The weight of q is the numerator, that of p is denominator - numerator. Their sum is the denominator, and the
    point's depth is s . s / denominator.

    Args:
        p, q: metres, optical frame.
    """
    e = minus(q, p)
    sx, sy = e[0] * p[2] - p[0] * e[2], e[1] * p[2] - p[1] * e[2]
    zero = vec.f64(0.0)
    numerator = sx * p[2], sy * p[2], zero - (p[0] * sx + p[1] * sy)
    denominator = zero - sx * e[2], zero - sy * e[2], e[0] * sx + e[1] * sy
    return (minus(denominator, numerator), numerator, (zero, zero, zero)), sx * sx + sy * sy


@inlined
def _dot_ray(row: F64x8x3, ray_x: F64x8, ray_y: F64x8) -> F64x8:
    """Return the product of a row of a matrix with the ray (ray_x, ray_y, 1)."""
    return row[0] * ray_x + row[1] * ray_y + row[2]


@inlined
def weight_matrix(
    vertices_per_primitive: I64, p0: F64x8x3, p1: F64x8x3, p2: F64x8x3, rays: Rays
) -> tuple[tuple[F64x8x3, F64x8x3, F64x8x3], F64x8, F64x8]:
    """Return the matrix whose product with a ray are the weights of the vertices, its determinant, and ``weight_sign``.

    The matrix has one row for each vertex. The sign, 1 or -1, makes the weights positive. The point's depth, metres, is
    the determinant divided by the sum of the weights.
    """
    zero, one = vec.f64(0.0), vec.f64(1.0)
    if vertices_per_primitive == TRIANGLE_VERTICES:
        matrix = cross(p1, p2), cross(p2, p0), cross(p0, p1)
        determinant = dot(p0, matrix[0])
        # Negative where the vertices run counter-clockwise as seen, which is the front unless the transform mirrors.
        weight_sign = vec.select(determinant < zero, -one, one)
    else:
        # Points are lines of length 0: their weights are all 0, and scaled_weights takes the mean of equal vertices.
        matrix, determinant = _line_weights(p0, p1)
        # The determinant s . s is positive, so the sum of the weights is positive in front of the camera.
        weight_sum = _dot_ray(matrix[0], rays.first_x, rays.y) + _dot_ray(matrix[1], rays.first_x, rays.y)
        weight_sign = vec.select(weight_sum < zero, -one, one)
    return matrix, determinant, weight_sign


@inlined
def _weights_at(matrix: tuple[F64x8x3, F64x8x3, F64x8x3], weight_sign: F64x8, ray_x: F64x8, ray_y: F64x8) -> F64x8x3:
    """Return the weights at the ray (ray_x, ray_y, 1).

    Coverage is exact to 1/256 pixel, so that pixel centres may be a little outside of the triangle. Negative weights at
    the ends of a span become 0: nothing is extrapolated.
    """
    zero = vec.f64(0.0)
    return (
        vec.maximum(weight_sign * _dot_ray(matrix[0], ray_x, ray_y), zero),
        vec.maximum(weight_sign * _dot_ray(matrix[1], ray_x, ray_y), zero),
        vec.maximum(weight_sign * _dot_ray(matrix[2], ray_x, ray_y), zero),
    )


@inlined
def inv_z_along_span(
    matrix: tuple[F64x8x3, F64x8x3, F64x8x3],
    determinant: F64x8,
    weight_sign: F64x8,
    rays: Rays,
    steps_to_last: F64x8,
    depths: F64x8x3,
) -> tuple[F64x8, F64x8]:
    """Return 1/z at the first pixel of spans, 1/m, and its change per pixel; ``depths``: of the vertices.

    It is that of the primitive's plane, limited to those of the vertices. Where ``_weights_at`` limits weights, their
    sum gives another depth: with several samples per pixel, slivers are shaded as if they were many pixels away.
    """
    zero, one, infinity = vec.f64(0.0), vec.f64(1.0), vec.f64(math.inf)
    nearest = vec.minimum(vec.minimum(depths[0], depths[1]), depths[2])
    farthest = vec.maximum(vec.maximum(depths[0], depths[1]), depths[2])
    lower = vec.select(farthest > zero, one / farthest, zero)
    upper = vec.select(nearest > zero, one / nearest, infinity)
    scale = weight_sign / vec.absolute(determinant)
    plane = (
        matrix[0][0] + matrix[1][0] + matrix[2][0],
        matrix[0][1] + matrix[1][1] + matrix[2][1],
        matrix[0][2] + matrix[1][2] + matrix[2][2],
    )
    first = scale * _dot_ray(plane, rays.first_x, rays.y)
    last = scale * _dot_ray(plane, rays.last_x, rays.y)
    # Points, and triangles seen from their edge, have the determinant 0.
    first = vec.select(first == first, vec.maximum(vec.minimum(first, upper), lower), upper)
    last = vec.select(last == last, vec.maximum(vec.minimum(last, upper), lower), upper)
    change = last - first
    return first, vec.select(vec.absolute(change) < infinity, change, zero) / vec.maximum(steps_to_last, one)


@inlined
def scaled_weights(
    matrix: tuple[F64x8x3, F64x8x3, F64x8x3],
    weight_sign: F64x8,
    rays: Rays,
    steps_to_last: F64x8,
    inputs: ShadingInputs,
) -> Weights:
    """Return the Weights.

    Scaled to the sum 1 at the first pixel, the weights fit float32. Any positive factor is valid, since the sums of
    attributes are divided by the sum of the weights.
    """
    zero, one, infinity = vec.f64(0.0), vec.f64(1.0), vec.f64(math.inf)
    first = _weights_at(matrix, weight_sign, rays.first_x, rays.y)
    last = _weights_at(matrix, weight_sign, rays.last_x, rays.y)
    first_sum, last_sum = first[0] + first[1] + first[2], last[0] + last[1] + last[2]
    is_usable = (first_sum > zero) & (first_sum < infinity) & (last_sum > zero) & (last_sum < infinity)
    scale = vec.select(is_usable, one / first_sum, zero)
    step_scale = scale / vec.maximum(steps_to_last, one)  # in spans of one pixel, last - first is 0
    third = vec.f64(1.0 / 3.0)  # weights that are not usable: the centroid
    # Infinite rows make these NaN, which ``sampling`` takes for a magnified texture.
    x_scale, y_scale = scale * weight_sign * vec.f64(1.0 / inputs.fx), scale * weight_sign * vec.f64(1.0 / inputs.fy)
    return Weights(
        start=to_f32x3(select3(is_usable, times(first, scale), (third, third, third))),
        per_pixel=to_f32x3(select3(is_usable, times(minus(last, first), step_scale), (zero, zero, zero))),
        per_column=to_f32x3((matrix[0][0] * x_scale, matrix[1][0] * x_scale, matrix[2][0] * x_scale)),
        per_row=to_f32x3((matrix[0][1] * y_scale, matrix[1][1] * y_scale, matrix[2][1] * y_scale)),
    )
