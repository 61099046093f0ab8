"""Reading shadow maps: how much of a light reaches eight points."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from renderers import simd as vec
from renderers.pointers import f32_at, i32_at
from renderers.studio.shadows import S_CENTER, S_FOCAL, S_OFFSET, SI_INV_Z, SI_SIDE

_PLAY: Final = np.float32(1.0 + 1e-6)
"""Depths are float32 in the map."""


@njit(nogil=True, error_model="numpy", forceinline=True)
def _turned(m, k, x, y, z):  # type: ignore[no-untyped-def]
    return vec.f64(m[k]) * x + vec.f64(m[k + 1]) * y + vec.f64(m[k + 2]) * z


@njit(nogil=True, error_model="numpy")
def _filtered(inv_z, side, radius, at, base, du, dv, fu, fv, sums):  # type: ignore[no-untyped-def]
    """Mean of the comparisons around one point, eight columns at a time.

    Args:
        at: index of the first texel. base, du, dv: 1/z of the receiver's plane there, and its change by column and row.
        fu, fv: where the point lies between texels. sums: pointer to eight float32.
    """
    width = 2 * radius + 2
    zero, one = vec.f32(0.0), vec.f32(1.0)
    lane = vec.to_f32(vec.iota())
    acc = zero
    for c in range(0, width, vec.LANES):
        column = vec.f32(c) + lane
        weight = vec.select(column < vec.f32(width - 1), one, vec.select(column < vec.f32(width), vec.f32(fu), zero))
        weight = vec.select(column < one, vec.f32(np.float32(1.0) - fu), weight)
        across = vec.f32(base) + vec.f32(du) * column
        for row in range(width):
            share = np.float32(1.0)
            if row == 0:
                share = np.float32(1.0) - fv
            elif row == width - 1:
                share = fv
            # Where nothing is, the map holds what is below 0.
            plane = vec.most(across + vec.f32(dv * np.float32(row)), zero) * vec.f32(_PLAY)
            clear = vec.load(inv_z, at + row * side + c) <= plane
            acc = acc + vec.select(clear, weight * vec.f32(share), zero)
    vec.store(sums, 0, acc)
    total = np.float32(0.0)
    for k in range(vec.LANES):
        total += sums[k]
    return total / np.float32((2 * radius + 1) * (2 * radius + 1))


@njit(nogil=True, error_model="numpy")
def lit_parts(m, integers, radius, x, y, z, nx, ny, nz, wanted, scratch):  # type: ignore[no-untyped-def]
    """f32x8: how much of a light reaches points, 0 .. 1; 1 outside of the map.

    Args:
        m, integers: pointers to the map's rows.
        radius: texels either way over which it is filtered: ``2 radius + 1`` squared bilinear readings.
        x, y, z: points, nx, ny, nz: normals of their triangles (unit, towards the light), both in the camera's frame.
        wanted: bits of the lanes that are wanted; the others give anything.
        scratch: address of SCRATCH_VALUES values of 4 bytes.
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
    # Eight columns are read at once: not of the last row, behind which the map ends.
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
    whole, values = i32_at(scratch), f32_at(scratch)
    vec.store(whole, 0, (vec.to_i32(j) - radii) * vec.i32(side) + vec.to_i32(i) - radii)
    vec.store(values, 8, vec.to_f32(base))
    vec.store(values, 16, vec.to_f32(du))
    vec.store(values, 24, vec.to_f32(dv))
    vec.store(values, 32, vec.to_f32(fu))
    vec.store(values, 40, vec.to_f32(fv))
    vec.store(values, 48, vec.f32(1.0))
    lanes = vec.bits(inside) & wanted
    inv_z = f32_at(integers[SI_INV_Z])
    sums = f32_at(scratch + 4 * 56)
    while lanes != 0:
        k = vec.lowest_bit(lanes)
        lanes &= lanes - 1
        at = np.int64(whole[k])
        values[48 + k] = _filtered(
            inv_z,
            side,
            radius,
            at,
            values[8 + k],
            values[16 + k],
            values[24 + k],
            values[32 + k],
            values[40 + k],
            sums,
        )
    return vec.load(values, 48)
