"""Weights of a primitive's vertices in spans: barycentric coordinates times their common denominator.

They are ``b = det(P) P^-1 d``. The columns of ``P`` are the vertices in the optical frame, ``d`` is the pixel's ray.
These weights are linear along a row of the image. They are computed in float64, eight spans at a time.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.drawlist import Topology
from renderers.shading.vec3 import cross, dot, minus, select3, times

_TRIANGLES: Final = int(Topology.TRIANGLES)


class Weights(NamedTuple):
    """Weights of the three vertices in eight spans, three f32x8 each."""

    first: Any
    """At the first pixel."""
    step: Any
    """Change per pixel of the span."""
    column: Any
    """Change per column of the image. Not ``step``, which is 0 in spans of a single pixel."""
    row: Any
    """Change per row of the image."""


class Rays(NamedTuple):
    """Rays (x, y, 1) through the pixels at both ends of eight spans, f64x8 each."""

    first_x: Any
    last_x: Any
    y: Any


@inlined
def rays_of(job, y, first_column, step_count):
    """Return the RAYS of spans in row ``y``.

    Args:
        first_column: i32x8.
        step_count: f64x8, number of pixels after the first one.
    """
    pixel_width, pixel_height = vec.f64(1.0 / job.fx), vec.f64(1.0 / job.fy)  # in the plane z = 1
    first_x = (vec.to_f64(first_column) + vec.f64(0.5 - job.cx)) * pixel_width
    return Rays(first_x=first_x, last_x=first_x + step_count * pixel_width, y=vec.f64(y + 0.5 - job.cy) * pixel_height)


@inlined
def _line_weights(p, q):
    """Return the rows of the weights of a line from p to q, and its determinant, as ``weight_rows`` returns them.

    The points of the line are p + t e with e = q - p. All of them project onto one line of the image, whose direction
    is s = e.xy p.z - p.xy e.z. The pixel shows the point whose projection has the same component along s as the ray.
    This gives t = numerator / denominator, where both are linear in the ray. The weight of q is the numerator, that of
    p is denominator - numerator. Their sum is the denominator, and the point's depth is s . s / denominator.
    """
    e = minus(q, p)
    sx, sy = e[0] * p[2] - p[0] * e[2], e[1] * p[2] - p[1] * e[2]
    zero = vec.f64(0.0)
    numerator = sx * p[2], sy * p[2], zero - (p[0] * sx + p[1] * sy)
    denominator = zero - sx * e[2], zero - sy * e[2], e[0] * sx + e[1] * sy
    return (minus(denominator, numerator), numerator, (zero, zero, zero)), sx * sx + sy * sy


@inlined
def _dot_ray(row, ray_x, ray_y):
    """Return the product of a row of three values with the ray (ray_x, ray_y, 1)."""
    return row[0] * ray_x + row[1] * ray_y + row[2]


@inlined
def weight_rows(topology, p0, p1, p2, rays):
    """Return the rows whose products with a ray are the weights of the vertices, their determinant, and their sign.

    The point's depth is the determinant divided by the sum of the weights. The sign makes the weights positive.

    Args:
        p0, p1, p2: vertices in the optical frame, three f64x8 each.
    """
    zero, one = vec.f64(0.0), vec.f64(1.0)
    if topology == _TRIANGLES:
        rows = cross(p1, p2), cross(p2, p0), cross(p0, p1)
        # Negative where the side is visible on which the vertices run counter-clockwise: the front, or the back if the
        # transform mirrors.
        determinant = dot(p0, rows[0])
        sign = vec.select(determinant < zero, zero - one, one)
    else:
        rows, determinant = _line_weights(p0, p1)
        # Positive in front of the camera.
        weight_sum = _dot_ray(rows[0], rays.first_x, rays.y) + _dot_ray(rows[1], rays.first_x, rays.y)
        sign = vec.select(weight_sum < zero, zero - one, one)
    return rows, determinant, sign


@inlined
def _weights_at(rows, sign, ray_x, ray_y):
    """Return the weights at a ray, three f64x8.

    Coverage is exact to 1/256 pixel, so that pixel centres may be a little outside of the triangle. Negative weights at
    the ends of a span become 0: nothing is extrapolated.
    """
    zero = vec.f64(0.0)
    return (
        vec.maximum(sign * _dot_ray(rows[0], ray_x, ray_y), zero),
        vec.maximum(sign * _dot_ray(rows[1], ray_x, ray_y), zero),
        vec.maximum(sign * _dot_ray(rows[2], ray_x, ray_y), zero),
    )


@inlined
def scaled_weights(rows, sign, rays, step_count, job):
    """Return the WEIGHTS, and the factor, f64x8, by which they are scaled.

    Scaled to the sum 1 at the first pixel, the weights fit float32. Any positive factor is valid, since the sums are
    divided by the sum of the weights.
    """
    zero, one, infinity = vec.f64(0.0), vec.f64(1.0), vec.f64(math.inf)
    b, e = _weights_at(rows, sign, rays.first_x, rays.y), _weights_at(rows, sign, rays.last_x, rays.y)
    first_sum, last_sum = b[0] + b[1] + b[2], e[0] + e[1] + e[2]
    is_usable = (first_sum > zero) & (first_sum < infinity) & (last_sum > zero) & (last_sum < infinity)
    scale = vec.select(is_usable, one / first_sum, zero)
    step_scale = scale / vec.maximum(step_count, one)
    third = vec.f64(1.0 / 3.0)  # weights that are not usable: the centroid
    x_scale, y_scale = scale * sign * vec.f64(1.0 / job.fx), scale * sign * vec.f64(1.0 / job.fy)
    weights = Weights(
        first=to_f32x3(select3(is_usable, times(b, scale), (third, third, third))),
        step=to_f32x3(select3(is_usable, times(minus(e, b), step_scale), (zero, zero, zero))),
        column=to_f32x3((rows[0][0] * x_scale, rows[1][0] * x_scale, rows[2][0] * x_scale)),
        row=to_f32x3((rows[0][1] * y_scale, rows[1][1] * y_scale, rows[2][1] * y_scale)),
    )
    return weights, scale


@inlined
def to_f32x3(values):
    return vec.to_f32(values[0]), vec.to_f32(values[1]), vec.to_f32(values[2])
