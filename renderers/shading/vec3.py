"""Vectors of three: each coordinate a vector of lanes, or a scalar."""

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
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def optical(m, v):
    """Eight vertices (f32x8 each coordinate) in the optical frame, f64x8; m: pointer to a (4, 4) float64 map."""
    x, y, z = vec.to_f64(v[0]), vec.to_f64(v[1]), vec.to_f64(v[2])
    return (
        vec.f64(m[0]) * x + vec.f64(m[1]) * y + vec.f64(m[2]) * z + vec.f64(m[3]),
        vec.f64(m[4]) * x + vec.f64(m[5]) * y + vec.f64(m[6]) * z + vec.f64(m[7]),
        vec.f64(m[8]) * x + vec.f64(m[9]) * y + vec.f64(m[10]) * z + vec.f64(m[11]),
    )
