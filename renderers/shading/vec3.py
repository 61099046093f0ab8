"""Three-component vectors, each component a vector of lanes or a scalar."""

from __future__ import annotations

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined


@inlined
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def times(a, scale):
    return a[0] * scale, a[1] * scale, a[2] * scale


@inlined
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def scale_to(a, length):
    """Factor that gives f32x8 vectors this length; 0 for vectors without a direction."""
    own, zero = vec.sqrt(dot(a, a)), vec.f32(0.0)
    return vec.select(own > zero, length / own, zero)


@inlined
def transform_points(m, p):
    """Points (f32x8) transformed by a (4, 4) float64 matrix (a pointer), f64x8."""
    x, y, z = vec.to_f64(p[0]), vec.to_f64(p[1]), vec.to_f64(p[2])
    return (
        vec.f64(m[0]) * x + vec.f64(m[1]) * y + vec.f64(m[2]) * z + vec.f64(m[3]),
        vec.f64(m[4]) * x + vec.f64(m[5]) * y + vec.f64(m[6]) * z + vec.f64(m[7]),
        vec.f64(m[8]) * x + vec.f64(m[9]) * y + vec.f64(m[10]) * z + vec.f64(m[11]),
    )


@inlined
def transform_directions(m, k, d):
    """Directions (f32x8) transformed by the (3, 3) matrix that begins at value ``k`` of a pointer."""
    return (
        vec.f32(m[k]) * d[0] + vec.f32(m[k + 1]) * d[1] + vec.f32(m[k + 2]) * d[2],
        vec.f32(m[k + 3]) * d[0] + vec.f32(m[k + 4]) * d[1] + vec.f32(m[k + 5]) * d[2],
        vec.f32(m[k + 6]) * d[0] + vec.f32(m[k + 7]) * d[1] + vec.f32(m[k + 8]) * d[2],
    )


@inlined
def load3(rows, at, stride):
    """Three rows at eight pixels."""
    return vec.load(rows, at), vec.load(rows, at + stride), vec.load(rows, at + 2 * stride)


@inlined
def store3(rows, at, stride, values):
    vec.store(rows, at, values[0])
    vec.store(rows, at + stride, values[1])
    vec.store(rows, at + 2 * stride, values[2])
