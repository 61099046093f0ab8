"""Shading: every visible pixel of a layer by itself, in float64."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit

from renderers.jit import kernel
from renderers.pointers import f32_at, f64_at, i64_at
from renderers.studio.directions import octahedral
from renderers.studio.lamps import L_COLOR, L_COLUMNS, L_SHADOW, arriving
from renderers.studio.mips import TF_COLUMNS, TI_COLUMNS, TI_UV_SET
from renderers.studio.reflection import ambient_channel, reflected
from renderers.studio.resolve import along_line, corners, cross, dot, inside, mixed, three, turned, unit
from renderers.studio.sampling import sample
from renderers.studio.shadows import S_COLUMNS, SI_COLUMNS, lit_part
from renderers.studio.surroundings import IRRADIANCE_SIZE, LEVELS
from renderers.studio.tables import (
    II_COLORS,
    II_COLUMNS,
    II_CORNER_TANGENTS,
    II_MATERIAL,
    II_NORMALS,
    II_TANGENTS,
    II_TOPOLOGY,
    II_UV0,
    MF_BASE,
    MF_COLUMNS,
    MF_CUTOFF,
    MF_EMISSIVE,
    MF_METALLIC,
    MF_NORMAL_SCALE,
    MF_OCCLUSION,
    MF_REFLECTANCE,
    MF_ROUGHNESS,
    MF_SPECULAR,
    MF_SPECULAR_COLOR,
    MI_ALPHA,
    MI_BASE,
    MI_COLUMNS,
    MI_EMISSIVE,
    MI_METALLIC_ROUGHNESS,
    MI_NORMAL,
    MI_OCCLUSION,
    MI_SPECULAR,
    MI_SPECULAR_COLOR,
    MI_UNLIT,
)
from renderers.studio.tonemap import shown

ADD: Final = 0
"""Add the layer, weighted by how many of a pixel's samples see it; whatever its alpha, it covers."""
BENEATH: Final = 1
"""Add the layer behind those that are there already."""

# Columns of the job: addresses and sizes.
J_INSTANCES: Final = 0
J_MATERIAL_INTEGERS: Final = 1
J_MATERIAL_FLOATS: Final = 2
J_TEXTURE_INTEGERS: Final = 3
J_TEXTURE_FLOATS: Final = 4
J_VALUES: Final = 5
J_X: Final = 6
J_N: Final = 7
J_LIGHTS: Final = 8
J_LIGHT_COUNT: Final = 9
J_SHADOW_FLOATS: Final = 10
J_SHADOW_INTEGERS: Final = 11
J_SHADOW_RADIUS: Final = 12
J_IRRADIANCE: Final = 13  # 0: no surroundings
J_LEVELS: Final = 14
J_SPLIT: Final = 15
J_SPLIT_SIDE: Final = 16
J_LENS: Final = 17  # fx, fy, cx, cy, exposure, then R_world_camera by rows
J_TONE: Final = 18  # number of the tone curve, of ``tonemap.TONES``
J_COLUMNS: Final = 19
_NONE: Final = (0.0, 0.0, 0.0)
_NOTHING: Final = ((0, 0, 0), _NONE, _NONE, _NONE, _NONE, _NONE, _NONE, 1.0, _NONE)
"""What ``_element`` gives, of nothing."""


@kernel("void(int64, int64[::1], int32[:,::1], uint8[:,::1], float64, int64[::1], int64, int64, float32[:,:,::1])")
def shade_rows(mode, job, ids, counts, weight, first_record, row_begin, row_end, out):  # type: ignore[no-untyped-def]
    """Shades the rows ``row_begin .. row_end - 1`` of a layer; every pixel is independent of all others.

    Args:
        mode: ``ADD`` or ``BENEATH``.
        job: (J_COLUMNS,) int64.
        ids: (H, W) int32 record per pixel, -1 for none.
        counts: (H, W) uint8, for ``ADD``: how many samples see it, each of the share ``weight``.
        first_record: (I + 1,) int64.
        out: (H, W, 4) float32: tone-mapped linear colour times coverage, and coverage.
    """
    table = i64_at(job.ctypes.data)
    hint = 0
    for y in range(row_begin, row_end):
        before = -1
        columns, X, N, element = i64_at(job[J_INSTANCES]), f64_at(job[J_X]), f64_at(job[J_N]), _NOTHING
        for x in range(ids.shape[1]):
            record = ids[y, x]
            if record < 0 or (mode == BENEATH and out[y, x, 3] >= 1.0):
                continue
            if record != before:
                before = record
                if not first_record[hint] <= record < first_record[hint + 1]:
                    low, high = 0, first_record.shape[0] - 1
                    while high - low > 1:
                        middle = (low + high) >> 1
                        if first_record[middle] <= record:
                            low = middle
                        else:
                            high = middle
                    hint = low
                columns = i64_at(job[J_INSTANCES] + 8 * II_COLUMNS * hint)
                X, N = f64_at(job[J_X] + 8 * 16 * hint), f64_at(job[J_N] + 8 * 9 * hint)
                element = _element(table, columns, X, record - first_record[hint])
            r, g, b, alpha = _pixel(table, columns, X, N, element, record - first_record[hint], x, y)
            share = weight * counts[y, x] if mode == ADD else (1.0 - out[y, x, 3]) * alpha
            out[y, x, 0] += np.float32(share * r)
            out[y, x, 1] += np.float32(share * g)
            out[y, x, 2] += np.float32(share * b)
            out[y, x, 3] += np.float32(share)


@njit(nogil=True, error_model="numpy")
def _texture(job, row, uv):  # type: ignore[no-untyped-def]
    """RGBA of a row of the texture table; ``uv``: both sets of coordinates with derivatives, 12 values."""
    integers = i64_at(job[J_TEXTURE_INTEGERS] + 8 * TI_COLUMNS * row)
    floats = f32_at(job[J_TEXTURE_FLOATS] + 4 * TF_COLUMNS * row)
    values = f32_at(job[J_VALUES])
    if integers[TI_UV_SET] == 0:
        return sample(integers, floats, values, uv[0], uv[1], uv[2], uv[3], uv[4], uv[5])
    return sample(integers, floats, values, uv[6], uv[7], uv[8], uv[9], uv[10], uv[11])


@njit(nogil=True, error_model="numpy")
def _coordinates(address, i0, i1, i2, w, sx, sy, total):  # type: ignore[no-untyped-def]
    """u, v and their derivatives by column and row: with u = sum(b_i u_i) / sum(b_i) and b_i linear over the image,
    du/dx = (sum(b_i' u_i) - u sum(b_i')) / sum(b_i)."""
    if address == 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    values = f32_at(address)
    u = mixed(values, 2, 0, i0, i1, i2, w[0], w[1], w[2])
    v = mixed(values, 2, 1, i0, i1, i2, w[0], w[1], w[2])
    if not (total > 0.0):
        return u, v, 0.0, 0.0, 0.0, 0.0
    slope_x, slope_y = sx[0] + sx[1] + sx[2], sy[0] + sy[1] + sy[2]
    return (
        u,
        v,
        (mixed(values, 2, 0, i0, i1, i2, sx[0], sx[1], sx[2]) - u * slope_x) / total,
        (mixed(values, 2, 1, i0, i1, i2, sx[0], sx[1], sx[2]) - v * slope_x) / total,
        (mixed(values, 2, 0, i0, i1, i2, sy[0], sy[1], sy[2]) - u * slope_y) / total,
        (mixed(values, 2, 1, i0, i1, i2, sy[0], sy[1], sy[2]) - v * slope_y) / total,
    )


@njit(nogil=True, error_model="numpy")
def _element(job, columns, X, element):  # type: ignore[no-untyped-def]
    """What all pixels of an element share: its vertices' numbers and places in the optical frame, the rows of
    ``[p0 p1 p2]^-1`` up to a positive factor, which side is seen (-1: the back), and its own normal towards the
    camera. Of a line or a point, the rows mean nothing."""
    i0, i1, i2, p0, p1, p2 = corners(columns, element, X)
    r0, r1, r2 = cross(p1, p2), cross(p2, p0), cross(p0, p1)
    determinant = dot(p0, r0)
    if determinant < 0.0:
        r0, r1, r2 = (-r0[0], -r0[1], -r0[2]), (-r1[0], -r1[1], -r1[2]), (-r2[0], -r2[1], -r2[2])
    mirrored = dot((X[0], X[1], X[2]), cross((X[4], X[5], X[6]), (X[8], X[9], X[10]))) < 0.0
    facing = -1.0 if (determinant > 0.0) != mirrored else 1.0
    flat = unit(cross((p1[0] - p0[0], p1[1] - p0[1], p1[2] - p0[2]), (p2[0] - p0[0], p2[1] - p0[1], p2[2] - p0[2])))
    if dot(flat, p0) > 0.0:
        flat = -flat[0], -flat[1], -flat[2]
    return (i0, i1, i2), p0, p1, p2, r0, r1, r2, facing, flat


@njit(nogil=True, error_model="numpy")
def _pixel(job, columns, X, N, shared, element, x, y):  # type: ignore[no-untyped-def]
    """Tone-mapped linear colour and alpha of what a pixel sees of an element; ``shared``: of ``_element``."""
    lens = f64_at(job[J_LENS])
    fx, fy = lens[0], lens[1]
    dx, dy = (x + 0.5 - lens[2]) / fx, (y + 0.5 - lens[3]) / fy
    (i0, i1, i2), p0, p1, p2, r0, r1, r2, facing, flat = shared
    sx = sy = (0.0, 0.0, 0.0)
    total = 0.0
    if columns[II_TOPOLOGY] == 3:
        a = r0[0] * dx + r0[1] * dy + r0[2]
        b = r1[0] * dx + r1[1] * dy + r1[2]
        c = r2[0] * dx + r2[1] * dy + r2[2]
        total = a + b + c
        sx = r0[0] / fx, r1[0] / fx, r2[0] / fx
        sy = r0[1] / fy, r1[1] / fy, r2[1] / fy
        w = inside(a, b, c)
    else:
        t = along_line(p0, p1, dx, dy)
        w = 1.0 - t, t, 0.0
    c0 = _coordinates(columns[II_UV0], i0, i1, i2, w, sx, sy, total)
    c1 = _coordinates(columns[II_UV0 + 1], i0, i1, i2, w, sx, sy, total)
    uv = (c0[0], c0[1], c0[2], c0[3], c0[4], c0[5], c1[0], c1[1], c1[2], c1[3], c1[4], c1[5])
    mi = i64_at(job[J_MATERIAL_INTEGERS] + 8 * MI_COLUMNS * columns[II_MATERIAL])
    mf = f32_at(job[J_MATERIAL_FLOATS] + 4 * MF_COLUMNS * columns[II_MATERIAL])
    red, green, blue, alpha = (
        np.float64(mf[MF_BASE]),
        np.float64(mf[MF_BASE + 1]),
        np.float64(mf[MF_BASE + 2]),
        np.float64(mf[MF_BASE + 3]),
    )
    if columns[II_COLORS] != 0:
        colors = f32_at(columns[II_COLORS])
        red *= mixed(colors, 4, 0, i0, i1, i2, w[0], w[1], w[2])
        green *= mixed(colors, 4, 1, i0, i1, i2, w[0], w[1], w[2])
        blue *= mixed(colors, 4, 2, i0, i1, i2, w[0], w[1], w[2])
        alpha *= mixed(colors, 4, 3, i0, i1, i2, w[0], w[1], w[2])
    if mi[MI_BASE] >= 0:
        t0, t1, t2, t3 = _texture(job, mi[MI_BASE], uv)
        red, green, blue, alpha = red * t0, green * t1, blue * t2, alpha * t3
    if mi[MI_ALPHA] == 0:
        alpha = np.float64(1.0)
    elif mi[MI_ALPHA] == 1:
        alpha = np.float64(0.0 if alpha < mf[MF_CUTOFF] else 1.0)
    else:
        alpha = np.float64(min(max(alpha, 0.0), 1.0) if alpha == alpha else 1.0)
    if not alpha > 0.0:
        return 0.0, 0.0, 0.0, 0.0
    if mi[MI_UNLIT] != 0:
        return min(max(red, 0.0), 1.0), min(max(green, 0.0), 1.0), min(max(blue, 0.0), 1.0), alpha
    p = (
        w[0] * p0[0] + w[1] * p1[0] + w[2] * p2[0],
        w[0] * p0[1] + w[1] * p1[1] + w[2] * p2[1],
        w[0] * p0[2] + w[1] * p1[2] + w[2] * p2[2],
    )
    v = unit((-p[0], -p[1], -p[2]))
    n = _normal(job, columns, mi, mf, X, N, element, i0, i1, i2, w, uv, facing, flat)
    base = max(red, 0.0), max(green, 0.0), max(blue, 0.0)
    red, green, blue = _lit(job, mi, mf, base, p, v, n, flat, uv)
    if mi[MI_EMISSIVE] >= 0:
        t0, t1, t2, t3 = _texture(job, mi[MI_EMISSIVE], uv)
        red, green, blue = red + mf[MF_EMISSIVE] * t0, green + mf[MF_EMISSIVE + 1] * t1, blue + mf[MF_EMISSIVE + 2] * t2
    else:
        red, green, blue = red + mf[MF_EMISSIVE], green + mf[MF_EMISSIVE + 1], blue + mf[MF_EMISSIVE + 2]
    exposure = lens[4]
    red, green, blue = shown(job[J_TONE], red * exposure, green * exposure, blue * exposure)
    return red, green, blue, alpha


@njit(nogil=True, error_model="numpy")
def _normal(job, columns, mi, mf, X, N, element, i0, i1, i2, w, uv, facing, flat):  # type: ignore[no-untyped-def]
    """Unit shading normal on the side that is seen."""
    if columns[II_NORMALS] == 0:
        return flat
    normals = f32_at(columns[II_NORMALS])
    n0, n1, n2 = three(normals, i0, 3), three(normals, i1, 3), three(normals, i2, 3)
    own = (
        w[0] * n0[0] + w[1] * n1[0] + w[2] * n2[0],
        w[0] * n0[1] + w[1] * n1[1] + w[2] * n2[1],
        w[0] * n0[2] + w[1] * n1[2] + w[2] * n2[2],
    )
    n = unit(turned(N, 3, own))
    if mi[MI_NORMAL] >= 0 and columns[II_TANGENTS] != 0:
        tangents = f32_at(columns[II_TANGENTS])
        j0, j1, j2 = i0, i1, i2
        if columns[II_CORNER_TANGENTS] != 0:
            j0, j1, j2 = 3 * element, 3 * element + 1, 3 * element + 2
        t = (
            mixed(tangents, 4, 0, j0, j1, j2, w[0], w[1], w[2]),
            mixed(tangents, 4, 1, j0, j1, j2, w[0], w[1], w[2]),
            mixed(tangents, 4, 2, j0, j1, j2, w[0], w[1], w[2]),
        )
        t = turned(X, 4, t)
        along = dot(n, t)
        t = unit((t[0] - along * n[0], t[1] - along * n[1], t[2] - along * n[2]))
        if dot(t, t) > 0.0:
            mirrored = dot((X[0], X[1], X[2]), cross((X[4], X[5], X[6]), (X[8], X[9], X[10]))) < 0.0
            hand = 1.0 if (tangents[4 * j0 + 3] >= 0.0) != mirrored else -1.0
            b = cross(n, t)
            r, g, blue, _ = _texture(job, mi[MI_NORMAL], uv)
            mx, my, mz = (2.0 * r - 1.0) * mf[MF_NORMAL_SCALE], (2.0 * g - 1.0) * mf[MF_NORMAL_SCALE], 2.0 * blue - 1.0
            bent = unit(
                (
                    mx * t[0] + hand * my * b[0] + mz * n[0],
                    mx * t[1] + hand * my * b[1] + mz * n[1],
                    mx * t[2] + hand * my * b[2] + mz * n[2],
                )
            )
            if dot(bent, bent) > 0.0:
                n = bent
    return n[0] * facing, n[1] * facing, n[2] * facing


@njit(nogil=True, error_model="numpy")
def _lit(job, mi, mf, base, p, v, n, flat, uv):  # type: ignore[no-untyped-def]
    """Reflected light, linear RGB: punctual lights with their shadows, then the surroundings with occlusion."""
    metallic, roughness = np.float64(mf[MF_METALLIC]), np.float64(mf[MF_ROUGHNESS])
    if mi[MI_METALLIC_ROUGHNESS] >= 0:
        _, g, b, _ = _texture(job, mi[MI_METALLIC_ROUGHNESS], uv)
        roughness, metallic = roughness * g, metallic * b
    metallic, roughness = np.float64(min(max(metallic, 0.0), 1.0)), np.float64(min(max(roughness, 0.0), 1.0))
    f90 = np.float64(mf[MF_SPECULAR])
    if mi[MI_SPECULAR] >= 0:
        _, _, _, a = _texture(job, mi[MI_SPECULAR], uv)
        f90 *= a
    tint = three(mf, MF_SPECULAR_COLOR, 1)
    if mi[MI_SPECULAR_COLOR] >= 0:
        r, g, b, _ = _texture(job, mi[MI_SPECULAR_COLOR], uv)
        tint = tint[0] * r, tint[1] * g, tint[2] * b
    reflectance = np.float64(mf[MF_REFLECTANCE])
    f0 = (
        min(reflectance * tint[0], 1.0) * f90,
        min(reflectance * tint[1], 1.0) * f90,
        min(reflectance * tint[2], 1.0) * f90,
    )
    alpha = roughness * roughness
    red = green = blue = 0.0
    for k in range(job[J_LIGHT_COUNT]):
        light = f64_at(job[J_LIGHTS] + 8 * L_COLUMNS * k)
        lx, ly, lz, part = arriving(light, p[0], p[1], p[2])
        if part <= 0.0 or n[0] * lx + n[1] * ly + n[2] * lz <= 0.0:
            continue
        row = int(light[L_SHADOW])
        if row >= 0:
            toward = flat[0] * lx + flat[1] * ly + flat[2] * lz
            if toward <= 0.0:
                continue  # the triangle itself is in the way
            part *= lit_part(
                f64_at(job[J_SHADOW_FLOATS] + 8 * S_COLUMNS * row),
                i64_at(job[J_SHADOW_INTEGERS] + 8 * SI_COLUMNS * row),
                job[J_SHADOW_RADIUS],
                p[0],
                p[1],
                p[2],
                flat[0],
                flat[1],
                flat[2],
            )
            if part <= 0.0:
                continue
        r, g, b = reflected(n, v, (lx, ly, lz), base, metallic, alpha, f0, f90)
        red += part * light[L_COLOR] * r
        green += part * light[L_COLOR + 1] * g
        blue += part * light[L_COLOR + 2] * b
    if job[J_IRRADIANCE] == 0:
        return red, green, blue
    # The surroundings are in the world's frame.
    turn = f64_at(job[J_LENS] + 8 * 5)
    wn = turned(turn, 3, n)
    n_v = dot(n, v)
    # What a rough surface reflects comes from between the mirrored direction and the normal (Lagarde and de Rousiers,
    # "Moving Frostbite to PBR", 2014, 4.9.3).
    mirror = (1.0 - alpha) * (math.sqrt(1.0 - alpha) + alpha)
    up = 1.0 - mirror + mirror * 2.0 * n_v
    m = unit(turned(turn, 3, (up * n[0] - mirror * v[0], up * n[1] - mirror * v[1], up * n[2] - mirror * v[2])))
    n_v = min(max(n_v, 0.0), 1.0)
    scale, bias = _split(job, n_v, roughness)
    u, at = octahedral(wn[0], wn[1], wn[2]) if dot(wn, wn) > 0.0 else (0.5, 0.5)
    d0, d1, d2 = _level(f32_at(job[J_IRRADIANCE]), IRRADIANCE_SIZE, u, at)
    s0, s1, s2 = _specular(job, m, roughness)
    kept = 1.0
    if mi[MI_OCCLUSION] >= 0:
        r, _, _, _ = _texture(job, mi[MI_OCCLUSION], uv)
        kept = 1.0 + mf[MF_OCCLUSION] * (r - 1.0)
    red += kept * ambient_channel(base[0], metallic, f0[0], f90, scale, bias, d0, s0)
    green += kept * ambient_channel(base[1], metallic, f0[1], f90, scale, bias, d1, s1)
    blue += kept * ambient_channel(base[2], metallic, f0[2], f90, scale, bias, d2, s2)
    return red, green, blue


@njit(nogil=True, error_model="numpy")
def _split(job, n_v, roughness):  # type: ignore[no-untyped-def]
    """Scale and bias of ``split_sum``, bilinear."""
    table, side = f32_at(job[J_SPLIT]), job[J_SPLIT_SIDE]
    x, y = n_v * (side - 1), roughness * (side - 1)
    i, j = min(int(x), side - 2), min(int(y), side - 2)
    fx, fy = x - i, y - j
    a = (i * side + j) * 2
    b = a + 2 * side
    wa, wb = 1.0 - fx, fx
    return (
        (table[a] * wa + table[b] * wb) * (1.0 - fy) + (table[a + 2] * wa + table[b + 2] * wb) * fy,
        (table[a + 1] * wa + table[b + 1] * wb) * (1.0 - fy) + (table[a + 3] * wa + table[b + 3] * wb) * fy,
    )


@njit(nogil=True, error_model="numpy")
def _specular(job, m, roughness):  # type: ignore[no-untyped-def]
    """Filtered radiance in a direction of the world, between two levels."""
    levels = i64_at(job[J_LEVELS])
    u, v = octahedral(m[0], m[1], m[2]) if dot(m, m) > 0.0 else (0.5, 0.5)
    at = roughness * (LEVELS - 1)
    low = min(int(at), LEVELS - 2)
    part = at - low
    r0, g0, b0 = _level(f32_at(levels[2 * low]), levels[2 * low + 1], u, v)
    r1, g1, b1 = _level(f32_at(levels[2 * low + 2]), levels[2 * low + 3], u, v)
    return r0 + part * (r1 - r0), g0 + part * (g1 - g0), b0 + part * (b1 - b0)


@njit(nogil=True, error_model="numpy")
def _level(table, side, u, v):  # type: ignore[no-untyped-def]
    """Bilinear in an octahedral table with a border of one texel."""
    x, y = u * side + 0.5, v * side + 0.5
    i, j = min(max(int(x), 0), side), min(max(int(y), 0), side)
    fx, fy = x - i, y - j
    a = (j * (side + 2) + i) * 3
    b = a + 3 * (side + 2)
    wa, wb, wc, wd = (1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy
    return (
        table[a] * wa + table[a + 3] * wb + table[b] * wc + table[b + 3] * wd,
        table[a + 1] * wa + table[a + 4] * wb + table[b + 1] * wc + table[b + 4] * wd,
        table[a + 2] * wa + table[a + 5] * wb + table[b + 2] * wc + table[b + 5] * wd,
    )
