"""What a pixel sees of an element, by itself and in float64: its material and its place, ready to be lit."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from renderers.pointers import f32_at, f64_at, i64_at
from renderers.studio.layout import (
    G_ALPHA,
    G_BASE,
    G_EMITTED,
    G_F0,
    G_F90,
    G_FLAT,
    G_KEPT,
    G_METALLIC,
    G_NORMAL,
    G_POINT,
    G_ROUGHNESS,
    J_LENS,
    J_MATERIAL_FLOATS,
    J_MATERIAL_INTEGERS,
    J_TEXTURE_FLOATS,
    J_TEXTURE_INTEGERS,
    J_VALUES,
    STRIDE,
)
from renderers.studio.mips import TF_COLUMNS, TI_COLUMNS, TI_UV_SET
from renderers.studio.resolve import along_line, corners, cross, dot, inside, mixed, three, turned, unit
from renderers.studio.sampling import sample
from renderers.studio.tables import (
    II_COLORS,
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
    MI_UV,
)

NOTHING: Final = 0
"""The pixel is cut out."""
SHOWN: Final = 1
"""The rows G_EMITTED and G_ALPHA have what it looks like."""
TO_BE_LIT: Final = 2
"""All rows but G_LIGHT have what it is made of."""

_NONE: Final = (0.0, 0.0, 0.0)
NO_ELEMENT: Final = ((0, 0, 0), _NONE, _NONE, _NONE, _NONE, _NONE, _NONE, 1.0, _NONE, (_NONE, _NONE, _NONE))
"""What ``element_of`` gives, of nothing."""


@njit(nogil=True, error_model="numpy", forceinline=True)
def _put(rows, row, slot, values):  # type: ignore[no-untyped-def]
    at = row * STRIDE + slot
    rows[at], rows[at + STRIDE], rows[at + 2 * STRIDE] = values


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
def element_of(columns, X, N, element):  # type: ignore[no-untyped-def]
    """What all pixels of an element share: its vertices' numbers and places in the optical frame, the rows of
    ``[p0 p1 p2]^-1`` up to a positive factor, which side is seen (-1: the back), and its own normal towards the
    camera, and its vertices' normals. Of a line or a point, the rows mean nothing."""
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
    own = flat, flat, flat
    if columns[II_NORMALS] != 0:
        normals = f32_at(columns[II_NORMALS])
        own = (
            turned(N, 3, three(normals, i0, 3)),
            turned(N, 3, three(normals, i1, 3)),
            turned(N, 3, three(normals, i2, 3)),
        )
    return (i0, i1, i2), p0, p1, p2, r0, r1, r2, facing, flat, own


@njit(nogil=True, error_model="numpy")
def look_at(job, columns, X, shared, element, x, y, rows, slot):  # type: ignore[no-untyped-def]
    """Put what a pixel sees of an element into the rows (G_) at ``slot``; ``shared``: of ``element_of``.

    Returns:
        ``NOTHING``, ``SHOWN`` or ``TO_BE_LIT``.
    """
    lens = f64_at(job[J_LENS])
    across, down = lens[14], lens[15]
    dx, dy = (x + 0.5 - lens[2]) * across, (y + 0.5 - lens[3]) * down
    (i0, i1, i2), p0, p1, p2, r0, r1, r2, facing, flat, own = shared
    sx = sy = (0.0, 0.0, 0.0)
    total = 0.0
    if columns[II_TOPOLOGY] == 3:
        a = r0[0] * dx + r0[1] * dy + r0[2]
        b = r1[0] * dx + r1[1] * dy + r1[2]
        c = r2[0] * dx + r2[1] * dy + r2[2]
        total = a + b + c
        sx = r0[0] * across, r1[0] * across, r2[0] * across
        sy = r0[1] * down, r1[1] * down, r2[1] * down
        w = inside(a, b, c)
    else:
        t = along_line(p0, p1, dx, dy)
        w = 1.0 - t, t, 0.0
    mi = i64_at(job[J_MATERIAL_INTEGERS] + 8 * MI_COLUMNS * columns[II_MATERIAL])
    mf = f32_at(job[J_MATERIAL_FLOATS] + 4 * MF_COLUMNS * columns[II_MATERIAL])
    c0 = _coordinates(columns[II_UV0] if mi[MI_UV] & 1 else 0, i0, i1, i2, w, sx, sy, total)
    c1 = _coordinates(columns[II_UV0 + 1] if mi[MI_UV] & 2 else 0, i0, i1, i2, w, sx, sy, total)
    uv = (c0[0], c0[1], c0[2], c0[3], c0[4], c0[5], c1[0], c1[1], c1[2], c1[3], c1[4], c1[5])
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
        return NOTHING
    rows[G_ALPHA * STRIDE + slot] = alpha
    if mi[MI_UNLIT] != 0:
        _put(rows, G_EMITTED, slot, (min(max(red, 0.0), 1.0), min(max(green, 0.0), 1.0), min(max(blue, 0.0), 1.0)))
        return SHOWN
    p = (
        w[0] * p0[0] + w[1] * p1[0] + w[2] * p2[0],
        w[0] * p0[1] + w[1] * p1[1] + w[2] * p2[1],
        w[0] * p0[2] + w[1] * p1[2] + w[2] * p2[2],
    )
    _put(rows, G_POINT, slot, p)
    _put(rows, G_FLAT, slot, flat)
    _put(rows, G_NORMAL, slot, _normal(job, columns, mi, mf, X, element, i0, i1, i2, w, uv, facing, flat, own))
    _put(rows, G_BASE, slot, (max(red, 0.0), max(green, 0.0), max(blue, 0.0)))
    _reflecting(job, mi, mf, uv, rows, slot)
    emitted = three(mf, MF_EMISSIVE, 1)
    if mi[MI_EMISSIVE] >= 0:
        t0, t1, t2, _ = _texture(job, mi[MI_EMISSIVE], uv)
        emitted = emitted[0] * t0, emitted[1] * t1, emitted[2] * t2
    _put(rows, G_EMITTED, slot, emitted)
    return TO_BE_LIT


@njit(nogil=True, error_model="numpy")
def _reflecting(job, mi, mf, uv, rows, slot):  # type: ignore[no-untyped-def]
    """Put how the pixel reflects into the rows from G_METALLIC to G_KEPT."""
    metallic, roughness = np.float64(mf[MF_METALLIC]), np.float64(mf[MF_ROUGHNESS])
    if mi[MI_METALLIC_ROUGHNESS] >= 0:
        _, g, b, _ = _texture(job, mi[MI_METALLIC_ROUGHNESS], uv)
        roughness, metallic = roughness * g, metallic * b
    f90 = np.float64(mf[MF_SPECULAR])
    if mi[MI_SPECULAR] >= 0:
        _, _, _, a = _texture(job, mi[MI_SPECULAR], uv)
        f90 *= a
    tint = three(mf, MF_SPECULAR_COLOR, 1)
    if mi[MI_SPECULAR_COLOR] >= 0:
        r, g, b, _ = _texture(job, mi[MI_SPECULAR_COLOR], uv)
        tint = tint[0] * r, tint[1] * g, tint[2] * b
    reflectance = np.float64(mf[MF_REFLECTANCE])
    kept = 1.0
    if mi[MI_OCCLUSION] >= 0:
        r, _, _, _ = _texture(job, mi[MI_OCCLUSION], uv)
        kept = 1.0 + mf[MF_OCCLUSION] * (r - 1.0)
    rows[G_METALLIC * STRIDE + slot] = min(max(metallic, 0.0), 1.0)
    rows[G_ROUGHNESS * STRIDE + slot] = min(max(roughness, 0.0), 1.0)
    rows[G_F90 * STRIDE + slot] = f90
    rows[G_KEPT * STRIDE + slot] = kept
    _put(
        rows,
        G_F0,
        slot,
        (
            min(reflectance * tint[0], 1.0) * f90,
            min(reflectance * tint[1], 1.0) * f90,
            min(reflectance * tint[2], 1.0) * f90,
        ),
    )


@njit(nogil=True, error_model="numpy")
def _normal(job, columns, mi, mf, X, element, i0, i1, i2, w, uv, facing, flat, own):  # type: ignore[no-untyped-def]
    """Unit shading normal on the side that is seen."""
    if columns[II_NORMALS] == 0:
        return flat
    n0, n1, n2 = own
    n = unit(
        (
            w[0] * n0[0] + w[1] * n1[0] + w[2] * n2[0],
            w[0] * n0[1] + w[1] * n1[1] + w[2] * n2[1],
            w[0] * n0[2] + w[1] * n1[2] + w[2] * n2[2],
        )
    )
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
