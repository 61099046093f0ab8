"""Arithmetic of 3-vectors, whose components are SIMD vectors or scalars, and of matrices."""

from typing import TypeVar

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import F32, F64, I64, Number, Pointer
from renderers.compiler.simd import F32x8, F32x8x3, F32x8x4, F32x8x8, F64x8, F64x8x3, I32x8, Lanes, Mask8

Component = TypeVar("Component", F32x8, F64x8, I32x8, F64)
Vector = tuple[Component, Component, Component]
Rows = TypeVar("Rows", F32x8x3, F32x8x4)


@inlined
def saturate(c: F32x8) -> F32x8:
    """Clamp an f32x8 to 0 .. 1. NaN becomes 0."""
    return vec.minimum(vec.maximum(c, vec.f32(0.0)), vec.f32(1.0))


@inlined
def cross(a: Vector[Component], b: Vector[Component]) -> Vector[Component]:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def minus(a: Vector[Component], b: Vector[Component]) -> Vector[Component]:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def times(a: Vector[Component], scale: Component) -> Vector[Component]:
    """Return a times one factor."""
    return a[0] * scale, a[1] * scale, a[2] * scale


@inlined
def multiply3(a: F32x8x3, b: F32x8x3) -> F32x8x3:
    """Return the products of the components."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@inlined
def dot(a: Vector[Component], b: Vector[Component]) -> Component:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def scale_to(v: F32x8x3, length: F32x8) -> F32x8:
    """Return the factor that scales vectors to this length; 0 for vectors of length 0 and NaN."""
    old_length, zero = vec.sqrt(dot(v, v)), vec.f32(0.0)
    return vec.select(old_length > zero, length / old_length, zero)


@inlined
def select3(mask: Mask8, a: tuple[Lanes, Lanes, Lanes], b: tuple[Lanes, Lanes, Lanes]) -> tuple[Lanes, Lanes, Lanes]:
    """Return a where the m8 is set, else b."""
    return vec.select(mask, a[0], b[0]), vec.select(mask, a[1], b[1]), vec.select(mask, a[2], b[2])


@inlined
def to_f32x3(values: F64x8x3) -> F32x8x3:
    """Return three f64x8 as f32x8."""
    return vec.to_f32(values[0]), vec.to_f32(values[1]), vec.to_f32(values[2])


@inlined
def transform_points(X: Pointer[F64], p: F32x8x8) -> F64x8x3:
    """Return points transformed by a (4, 4) matrix."""
    x, y, z = vec.to_f64(p[0]), vec.to_f64(p[1]), vec.to_f64(p[2])
    return (
        vec.f64(X[0]) * x + vec.f64(X[1]) * y + vec.f64(X[2]) * z + vec.f64(X[3]),
        vec.f64(X[4]) * x + vec.f64(X[5]) * y + vec.f64(X[6]) * z + vec.f64(X[7]),
        vec.f64(X[8]) * x + vec.f64(X[9]) * y + vec.f64(X[10]) * z + vec.f64(X[11]),
    )


@inlined
def transform_directions(matrix: Pointer[Number], d: F32x8x3) -> F32x8x3:
    """Return directions transformed by a (3, 3) matrix."""
    return (
        vec.f32(matrix[0]) * d[0] + vec.f32(matrix[1]) * d[1] + vec.f32(matrix[2]) * d[2],
        vec.f32(matrix[3]) * d[0] + vec.f32(matrix[4]) * d[1] + vec.f32(matrix[5]) * d[2],
        vec.f32(matrix[6]) * d[0] + vec.f32(matrix[7]) * d[1] + vec.f32(matrix[8]) * d[2],
    )


@inlined
def broadcast3(values: Pointer[Number], k: I64) -> F32x8x3:
    """Return the values k, k + 1 and k + 2 of an array of float32, each in all lanes."""
    return vec.f32(values[k]), vec.f32(values[k + 1]), vec.f32(values[k + 2])


@inlined
def load3(rows: Pointer[F32], k: I64, stride: I64) -> F32x8x3:
    """Return the values k .. k + 8 of three rows, which are ``stride`` values apart."""
    return vec.load(rows, k), vec.load(rows, k + stride), vec.load(rows, k + 2 * stride)


@inlined
def store3(rows: Pointer[F32], k: I64, stride: I64, values: Rows) -> None:
    """Store the values k .. k + 8 of three rows, which are ``stride`` values apart."""
    vec.store(rows, k, values[0])
    vec.store(rows, k + stride, values[1])
    vec.store(rows, k + 2 * stride, values[2])


@inlined
def cofactor(X: Pointer[F64], row: I64, column: I64) -> F64:
    """Return a cofactor of the upper left (3, 3) of a (4, 4) matrix."""
    row1, row2 = 4 * ((row + 1) % 3), 4 * ((row + 2) % 3)
    column1, column2 = (column + 1) % 3, (column + 2) % 3
    return X[row1 + column1] * X[row2 + column2] - X[row1 + column2] * X[row2 + column1]


@inlined
def determinant(X: Pointer[F64]) -> F64:
    """Return the determinant of the upper left (3, 3) of a (4, 4) matrix."""
    return X[0] * cofactor(X, 0, 0) + X[1] * cofactor(X, 0, 1) + X[2] * cofactor(X, 0, 2)
