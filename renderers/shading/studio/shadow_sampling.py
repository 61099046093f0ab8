"""Sampling of shadow maps at eight points: percentage closer filtering with bilinear weights."""

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import F32, F64, I64, Pointer
from renderers.compiler.pointers import advance
from renderers.compiler.simd import F32x8, F32x8x3, F64x8, I32x8, Mask8
from renderers.shading.studio.layout import StudioShadowMap

DEPTH_BIAS: Final = np.float32(1.0 + 1e-6)
"""Factor of a receiver's 1/z against self-shadowing, above the rounding of the map's float32."""


@inlined
def _transform_row(m: Pointer[F64], k: I64, x: F64x8, y: F64x8, z: F64x8) -> F64x8:
    """Return the product of (x, y, z) with the three values ``k .. k + 3`` of a matrix (a pointer to float64)."""
    return vec.f64(m[k]) * x + vec.f64(m[k + 1]) * y + vec.f64(m[k + 2]) * z


@inlined
def _add_column(
    row_sum: F32x8, inv_z: F32x8, column: I64, width: I64, plane: F32x8, plane_du: F32x8, fu: F32x8
) -> F32x8:
    """Return the sum of a filter row, plus the weight of one column where no caster is in front of the receiver.

    Args:
        inv_z: 1/z in the map at this column.
        column: index in the filter. Beyond ``width``, the number of columns, nothing is added.
        plane, plane_du: 1/z of the receiver's plane at column 0, and its change per column.
        fu: position of the point between two texels, 0 .. 1.
    """
    if column >= width:
        return row_sum
    zero, one = vec.f32(0.0), vec.f32(1.0)
    weight = one
    if column == 0:
        weight = one - fu
    elif column == width - 1:
        weight = fu
    # Empty texels hold a 1/z of 0.
    is_clear = inv_z <= vec.maximum(plane + plane_du * vec.f32(column), zero)
    return row_sum + vec.select(is_clear, weight, zero)


@inlined
def _filtered(
    inv_z: Pointer[F32],
    side: I64,
    radius: I64,
    first_texel: I32x8,
    plane: F32x8,
    plane_du: F32x8,
    plane_dv: F32x8,
    fu: F32x8,
    fv: F32x8,
) -> F32x8:
    """Return the weighted means of the depth comparisons around eight points, 0 .. 1.

    Args:
        first_texel: index of the upper left texel of the filter.
        plane, plane_du, plane_dv: 1/z of the receiver's plane at that texel, and its change per column and per row.
        fu, fv: position of the point between texels, 0 .. 1.
    """
    width = 2 * radius + 2
    zero, one, bias = vec.f32(0.0), vec.f32(1.0), vec.f32(DEPTH_BIAS)
    plane, plane_du, plane_dv = plane * bias, plane_du * bias, plane_dv * bias
    total = zero
    for row in range(width):
        row_plane = plane + plane_dv * vec.f32(row)
        row_sum = zero
        for c in range(0, width, vec.LANES):
            t = vec.load_octets(advance(inv_z, row * side + c), first_texel)
            row_sum = _add_column(row_sum, t[0], c, width, row_plane, plane_du, fu)
            row_sum = _add_column(row_sum, t[1], c + 1, width, row_plane, plane_du, fu)
            row_sum = _add_column(row_sum, t[2], c + 2, width, row_plane, plane_du, fu)
            row_sum = _add_column(row_sum, t[3], c + 3, width, row_plane, plane_du, fu)
            row_sum = _add_column(row_sum, t[4], c + 4, width, row_plane, plane_du, fu)
            row_sum = _add_column(row_sum, t[5], c + 5, width, row_plane, plane_du, fu)
            row_sum = _add_column(row_sum, t[6], c + 6, width, row_plane, plane_du, fu)
            row_sum = _add_column(row_sum, t[7], c + 7, width, row_plane, plane_du, fu)
        weight = one
        if row == 0:
            weight = one - fv
        elif row == width - 1:
            weight = fv
        total = total + weight * row_sum
    return total / vec.f32((2 * radius + 1) * (2 * radius + 1))


@inlined
def _is_within(u: F64x8, v: F64x8, radius: I64, side: I64) -> Mask8:
    """Return m8: positions around which the map has all texels that the filter reads, which it reads by eights."""
    lower, upper = vec.f64(radius + 1.0), vec.f64(side - radius - 2.0)
    return (u > lower) & (u < upper) & (v > lower) & (v < upper)


@inlined
def unshadowed_share(shadow_map: StudioShadowMap, radius: I64, point: F32x8x3, normal: F32x8x3) -> F32x8:
    """Return the share of a light that reaches points, 0 .. 1; 1 outside of the map.

    Args:
        radius: radius of the filter, texels. The filter takes (2 radius + 1)^2 bilinear samples.
        normal: unit normals of the points' triangles, towards the light.
    """
    X_light_camera = shadow_map.X_light_camera
    x, y, z = vec.to_f64(point[0]), vec.to_f64(point[1]), vec.to_f64(point[2])
    nx, ny, nz = vec.to_f64(normal[0]), vec.to_f64(normal[1]), vec.to_f64(normal[2])
    # In the light's frame: l is the normal; p is the point, which is offset along the normal below.
    lx = _transform_row(X_light_camera, 0, nx, ny, nz)
    ly = _transform_row(X_light_camera, 4, nx, ny, nz)
    lz = _transform_row(X_light_camera, 8, nx, ny, nz)
    px = _transform_row(X_light_camera, 0, x, y, z) + vec.f64(X_light_camera[3])
    py = _transform_row(X_light_camera, 4, x, y, z) + vec.f64(X_light_camera[7])
    pz = _transform_row(X_light_camera, 8, x, y, z) + vec.f64(X_light_camera[11])
    offset = vec.f64(shadow_map.normal_offset) * pz
    is_ahead = pz > vec.f64(0.0)
    px, py, pz = px + offset * lx, py + offset * ly, pz + offset * lz
    inv_z = vec.f64(1.0) / pz
    focal_length, center, half = vec.f64(shadow_map.focal_length), vec.f64(shadow_map.center), vec.f64(0.5)
    u, v = focal_length * px * inv_z + center, focal_length * py * inv_z + center
    side = shadow_map.side
    is_inside = is_ahead & _is_within(u, v, radius, side)
    u, v = vec.select(is_inside, u, center) - half, vec.select(is_inside, v, center) - half
    # For a plane l.p = d, 1/z = l.ray / d, which is linear over the map.
    d = lx * px + ly * py + lz * pz
    faces_light = d < vec.f64(-1e-9) * pz
    scale = vec.select(faces_light, vec.f64(1.0) / (focal_length * d), vec.f64(0.0))
    plane_du, plane_dv = lx * scale, ly * scale
    i, j = vec.floor(u), vec.floor(v)
    fu, fv = u - i, v - j
    radius_f64 = vec.f64(float(radius))
    plane = inv_z - plane_du * (radius_f64 + fu) - plane_dv * (radius_f64 + fv)
    radius_i32 = vec.i32(radius)
    first_texel = (vec.to_i32(j) - radius_i32) * vec.i32(side) + vec.to_i32(i) - radius_i32
    share = _filtered(
        shadow_map.inv_z,
        side,
        radius,
        first_texel,
        vec.to_f32(plane),
        vec.to_f32(plane_du),
        vec.to_f32(plane_dv),
        vec.to_f32(fu),
        vec.to_f32(fv),
    )
    return vec.select(is_inside, share, vec.f32(1.0))
