"""Sampling of shadow maps at eight points: percentage closer filtering with bilinear weights."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import f32_at
from renderers.shading.studio.shadows import S_CENTER, S_FOCAL, S_OFFSET, SI_INV_Z, SI_SIDE

DEPTH_BIAS: Final = np.float32(1.0 + 1e-6)
"""Relative bias against self-shadowing, above the rounding of the map's float32 depths."""


@inlined
def _turned(m, k, x, y, z):
    return vec.f64(m[k]) * x + vec.f64(m[k + 1]) * y + vec.f64(m[k + 2]) * z


@inlined
def _column(lit, texels, column, width, plane, du, fu):
    """Add a column's weight to a row's sum where the receiver's plane is not behind the texel."""
    if column >= width:
        return lit
    zero, one = vec.f32(0.0), vec.f32(1.0)
    weight = one
    if column == 0:
        weight = one - fu
    elif column == width - 1:
        weight = fu
    # Empty texels hold a negative 1/z.
    clear = texels <= vec.maximum(plane + du * vec.f32(column), zero)
    return lit + vec.select(clear, weight, zero)


@device_function
def _filtered(inv_z, side, radius, at, base, du, dv, fu, fv):
    """Return the weighted means of the depth comparisons around eight points.

    Args:
        at: indices of the first texels. base, du, dv: 1/z of the receivers' planes there, and its change per column
            and row. fu, fv: positions of the points between texels, 0 .. 1.
    """
    width = 2 * radius + 2
    zero, one, line, bias = vec.f32(0.0), vec.f32(1.0), vec.i32(side), vec.f32(DEPTH_BIAS)
    base, du, dv = base * bias, du * bias, dv * bias
    total = zero
    for row in range(width):
        plane = base + dv * vec.f32(row)
        lit = zero
        for c in range(0, width, vec.LANES):
            t = vec.load_octets(inv_z, at + vec.i32(c))
            lit = _column(lit, t[0], c, width, plane, du, fu)
            lit = _column(lit, t[1], c + 1, width, plane, du, fu)
            lit = _column(lit, t[2], c + 2, width, plane, du, fu)
            lit = _column(lit, t[3], c + 3, width, plane, du, fu)
            lit = _column(lit, t[4], c + 4, width, plane, du, fu)
            lit = _column(lit, t[5], c + 5, width, plane, du, fu)
            lit = _column(lit, t[6], c + 6, width, plane, du, fu)
            lit = _column(lit, t[7], c + 7, width, plane, du, fu)
        share = one
        if row == 0:
            share = one - fv
        elif row == width - 1:
            share = fv
        total = total + share * lit
        at = at + line
    return total / vec.f32((2 * radius + 1) * (2 * radius + 1))


@device_function
def light_share(m, integers, radius, x, y, z, nx, ny, nz):
    """Return the share of a light that reaches points, f32x8, 0 .. 1; 1 outside of the map.

    Args:
        m, integers: pointers to the map's rows.
        radius: texels of the filter either way: (2 radius + 1)^2 bilinear samples.
        x, y, z: points, nx, ny, nz: normals of their triangles (unit, towards the light), both in the camera's frame.
    """
    x, y, z = vec.to_f64(x), vec.to_f64(y), vec.to_f64(z)
    nx, ny, nz = vec.to_f64(nx), vec.to_f64(ny), vec.to_f64(nz)
    lx, ly, lz = _turned(m, 0, nx, ny, nz), _turned(m, 4, nx, ny, nz), _turned(m, 8, nx, ny, nz)
    px = _turned(m, 0, x, y, z) + vec.f64(m[3])
    py = _turned(m, 4, x, y, z) + vec.f64(m[7])
    pz = _turned(m, 8, x, y, z) + vec.f64(m[11])
    lift = vec.f64(m[S_OFFSET]) * pz
    ahead = pz > vec.f64(0.0)
    px, py, pz = px + lift * lx, py + lift * ly, pz + lift * lz
    here = vec.f64(1.0) / pz
    focal, centre, half = vec.f64(m[S_FOCAL]), vec.f64(m[S_CENTER]), vec.f64(0.5)
    u, v = focal * px * here + centre, focal * py * here + centre
    side = integers[SI_SIDE]
    # Eight columns are loaded at a time: not of the last row, where that would overrun the map.
    least, most = vec.f64(radius + 1.0), vec.f64(side - radius - 2.0)
    inside = ahead & (u > least) & (u < most) & (v > least) & (v < most)
    u, v = vec.select(inside, u, centre) - half, vec.select(inside, v, centre) - half
    # The plane n.p = d has 1/z = n.(ray) / d, linear over the map.
    d = lx * px + ly * py + lz * pz
    slanted = d < vec.f64(-1e-9) * pz
    scale = vec.select(slanted, vec.f64(1.0) / (focal * d), vec.f64(0.0))
    du, dv = lx * scale, ly * scale
    i, j = vec.floor(u), vec.floor(v)
    fu, fv = u - i, v - j
    reach = vec.f64(float(radius))
    base = here - du * (reach + fu) - dv * (reach + fv)
    radii = vec.i32(radius)
    at = (vec.to_i32(j) - radii) * vec.i32(side) + vec.to_i32(i) - radii
    base, du, dv = vec.to_f32(base), vec.to_f32(du), vec.to_f32(dv)
    part = _filtered(f32_at(integers[SI_INV_Z]), side, radius, at, base, du, dv, vec.to_f32(fu), vec.to_f32(fv))
    return vec.select(inside, part, vec.f32(1.0))
