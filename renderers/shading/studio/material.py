"""What pixels see of one instance, eight at a time: their material and their place, ready to be lit."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import f32_at, f64_at, i64_at, u32_at
from renderers.shading.layout import (
    E_COLOR,
    E_COLUMNS,
    E_TANGENT,
    E_UV1,
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    V_COLUMNS,
    V_NORMAL,
    V_UV0,
)
from renderers.shading.studio.layout import (
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
    J_N,
    J_TEXTURE_FLOATS,
    J_TEXTURE_INTEGERS,
    J_VALUES,
    J_X,
    STRIDE,
)
from renderers.shading.studio.mipmaps import TF_COLUMNS, TI_COLUMNS, TI_UV_SET
from renderers.shading.studio.resolve import (
    along_line,
    coordinates,
    cross,
    dot,
    minus,
    mirrors,
    mixed,
    moved,
    reach,
    single,
    sloped,
    turned,
)
from renderers.shading.studio.sampling import sample
from renderers.shading.studio.tables import (
    II_ELEMENTS,
    II_EXTRAS,
    II_HAS,
    II_MATERIAL,
    II_TOPOLOGY,
    II_VERTICES,
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

COLOR: Final = 0
"""What ``look_at`` is to find out: what opaque surfaces look like,"""
COLOR_AND_ALPHA: Final = 1
"""and of what lets something be seen through, G_ALPHA,"""
ALPHA: Final = 2
"""or only that."""
SHOWN: Final = 1
"""The rows G_EMITTED have what it looks like."""
TO_BE_LIT: Final = 2
"""All rows but G_VIEW and G_LIGHT have what it is made of."""


@inlined
def _put(rows, row, slot, values):
    at = row * STRIDE + slot
    vec.store(rows, at, values[0])
    vec.store(rows, at + STRIDE, values[1])
    vec.store(rows, at + 2 * STRIDE, values[2])


@inlined
def _three(values, k):
    return vec.f32(values[k]), vec.f32(values[k + 1]), vec.f32(values[k + 2])


@inlined
def _times(a, b):
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@inlined
def _clamped(value):
    """0 .. 1; 0 for what is no number."""
    return vec.least(vec.most(value, vec.f32(0.0)), vec.f32(1.0))


@inner
def _texture(job, row, uv):
    """RGBA of a row of the texture table; ``uv``: both sets of coordinates with derivatives, 12 f32x8."""
    integers = i64_at(job[J_TEXTURE_INTEGERS] + 8 * TI_COLUMNS * row)
    floats = f32_at(job[J_TEXTURE_FLOATS] + 4 * TF_COLUMNS * row)
    values = f32_at(job[J_VALUES])
    if integers[TI_UV_SET] == 0:
        return sample(integers, floats, values, uv[0], uv[1], uv[2], uv[3], uv[4], uv[5])
    return sample(integers, floats, values, uv[6], uv[7], uv[8], uv[9], uv[10], uv[11])


@inlined
def _coordinates(w, sx, sy, u, v):
    """u, v and their derivatives by column and row; ``u``, ``v``: at three corners."""
    here, there = mixed(w, u[0], u[1], u[2]), mixed(w, v[0], v[1], v[2])
    return (
        here,
        there,
        sloped(sx, here, u[0], u[1], u[2]),
        sloped(sx, there, v[0], v[1], v[2]),
        sloped(sy, here, u[0], u[1], u[2]),
        sloped(sy, there, v[0], v[1], v[2]),
    )


@inner
def look_at(job, columns, instance, wanted, elements, places, slot, y, rows):
    """Put what eight pixels see of an instance into the rows (G_) at ``slot``.

    Args:
        columns: pointer to the instance's row of the instance table.
        wanted: ``COLOR``, ``COLOR_AND_ALPHA`` or ``ALPHA``.
        elements, places: pointers to the int32 elements that the pixels of the slots see, and their columns.

    Returns:
        ``SHOWN`` or ``TO_BE_LIT``.
    """
    lens, X = f64_at(job[J_LENS]), f64_at(job[J_X] + 8 * 16 * instance)
    across, down = vec.f64(lens[14]), vec.f64(lens[15])
    dx = (vec.to_f64(vec.load(places, slot)) + vec.f64(0.5 - lens[2])) * across
    dy = vec.f64(y + 0.5 - lens[3]) * down
    element = vec.load(elements, slot)
    indices, vertices = u32_at(columns[II_ELEMENTS]), f32_at(columns[II_VERTICES])
    eight, one = vec.i32(V_COLUMNS), vec.f32(1.0)
    topology, has = columns[II_TOPOLOGY], columns[II_HAS]
    if topology == 3:
        at = element * vec.i32(3)
        i0, i1, i2 = vec.gather(indices, at), vec.gather(indices, at + vec.i32(1)), vec.gather(indices, at + vec.i32(2))
    elif topology == 2:
        i0, i1 = vec.gather(indices, element + element), vec.gather(indices, element + element + vec.i32(1))
        i2 = i1
    else:
        i0 = vec.gather(indices, element)
        i1, i2 = i0, i0
    a, b, c = (
        vec.load_octets(vertices, i0 * eight),
        vec.load_octets(vertices, i1 * eight),
        vec.load_octets(vertices, i2 * eight),
    )
    p0, p1, p2 = moved(X, a), moved(X, b), moved(X, c)
    zero = vec.f32(0.0)
    if topology == 3:
        w, sx, sy, determinant = coordinates(p0, p1, p2, dx, dy)
        sx = sx[0] * vec.to_f32(across), sx[1] * vec.to_f32(across), sx[2] * vec.to_f32(across)
        sy = sy[0] * vec.to_f32(down), sy[1] * vec.to_f32(down), sy[2] * vec.to_f32(down)
    else:
        t = along_line(p0, p1, dx, dy)
        w = one - t, t, zero
        sx = sy = (zero, zero, zero)
        determinant = vec.f64(0.0)
    material = columns[II_MATERIAL]
    mi = i64_at(job[J_MATERIAL_INTEGERS] + 8 * MI_COLUMNS * material)
    mf = f32_at(job[J_MATERIAL_FLOATS] + 4 * MF_COLUMNS * material)
    c0 = c1 = (zero, zero, zero, zero, zero, zero)
    extras, wide = f32_at(columns[II_EXTRAS]), vec.i32(E_COLUMNS)
    if (mi[MI_UV] & 1) != 0 and (has & HAS_UV0) != 0:
        k = V_UV0
        c0 = _coordinates(w, sx, sy, (a[k], b[k], c[k]), (a[k + 1], b[k + 1], c[k + 1]))
    color, alpha = _three(mf, MF_BASE), vec.f32(mf[MF_BASE + 3])
    if (has & (HAS_COLORS | HAS_UV1)) != 0:
        d = vec.load_octets(extras, i0 * wide)
        e = vec.load_octets(extras, i1 * wide)
        f = vec.load_octets(extras, i2 * wide)
        if (has & HAS_COLORS) != 0:
            k = E_COLOR
            color = (
                color[0] * mixed(w, d[k], e[k], f[k]),
                color[1] * mixed(w, d[k + 1], e[k + 1], f[k + 1]),
                color[2] * mixed(w, d[k + 2], e[k + 2], f[k + 2]),
            )
            alpha = alpha * mixed(w, d[k + 3], e[k + 3], f[k + 3])
        if (mi[MI_UV] & 2) != 0 and (has & HAS_UV1) != 0:
            k = E_UV1
            c1 = _coordinates(w, sx, sy, (d[k], e[k], f[k]), (d[k + 1], e[k + 1], f[k + 1]))
    uv = (c0[0], c0[1], c0[2], c0[3], c0[4], c0[5], c1[0], c1[1], c1[2], c1[3], c1[4], c1[5])
    if mi[MI_BASE] >= 0:
        texel = _texture(job, mi[MI_BASE], uv)
        color, alpha = _times(color, texel), alpha * texel[3]
    if wanted != COLOR:
        if mi[MI_ALPHA] == 0:
            alpha = one
        elif mi[MI_ALPHA] == 1:
            alpha = vec.select(alpha < vec.f32(mf[MF_CUTOFF]), zero, one)
        else:
            alpha = vec.select(alpha == alpha, _clamped(alpha), one)
        vec.store(rows, G_ALPHA * STRIDE + slot, alpha)
        if wanted == ALPHA or (mi[MI_UNLIT] == 0 and vec.bits(alpha > zero) == 0):
            return TO_BE_LIT  # as nothing: whatever the rows have
    if mi[MI_UNLIT] != 0:
        _put(rows, G_EMITTED, slot, (_clamped(color[0]), _clamped(color[1]), _clamped(color[2])))
        return SHOWN
    s0, s1, s2 = single(p0), single(p1), single(p2)
    _put(
        rows,
        G_POINT,
        slot,
        (mixed(w, s0[0], s1[0], s2[0]), mixed(w, s0[1], s1[1], s2[1]), mixed(w, s0[2], s1[2], s2[2])),
    )
    flat = cross(single(minus(p1, p0)), single(minus(p2, p0)))
    # The determinant is the product of this and p0: towards the camera.
    scale = reach(flat, vec.select(determinant > vec.f64(0.0), -one, one))
    flat = flat[0] * scale, flat[1] * scale, flat[2] * scale
    _put(rows, G_FLAT, slot, flat)
    normal = flat
    if (has & HAS_NORMALS) != 0:
        k, mirror = V_NORMAL, vec.f32(mirrors(X))
        facing = vec.select(determinant > vec.f64(0.0), -mirror, mirror)
        n = mixed(w, a[k], b[k], c[k]), mixed(w, a[k + 1], b[k + 1], c[k + 1]), mixed(w, a[k + 2], b[k + 2], c[k + 2])
        n = turned(f64_at(job[J_N] + 8 * 9 * instance), 3, n)
        scale = reach(n, one)
        n = n[0] * scale, n[1] * scale, n[2] * scale
        if mi[MI_NORMAL] >= 0 and (has & HAS_TANGENTS) != 0:
            at = vec.i32(E_TANGENT)
            t0, t1, t2 = (
                vec.load_triples(extras, i0 * wide + at),
                vec.load_triples(extras, i1 * wide + at),
                vec.load_triples(extras, i2 * wide + at),
            )
            hand = vec.gather(extras, i0 * wide + vec.i32(E_TANGENT + 3))
            t = mixed(w, t0[0], t1[0], t2[0]), mixed(w, t0[1], t1[1], t2[1]), mixed(w, t0[2], t1[2], t2[2])
            hand = vec.select(hand >= zero, mirror, -mirror)
            n = _bent(n, turned(X, 4, t), hand, _texture(job, mi[MI_NORMAL], uv), vec.f32(mf[MF_NORMAL_SCALE]))
        normal = n[0] * facing, n[1] * facing, n[2] * facing
    _put(rows, G_NORMAL, slot, normal)
    _put(rows, G_BASE, slot, (vec.most(color[0], zero), vec.most(color[1], zero), vec.most(color[2], zero)))
    _reflecting(job, mi, mf, uv, rows, slot)
    emitted = _three(mf, MF_EMISSIVE)
    if mi[MI_EMISSIVE] >= 0:
        emitted = _times(emitted, _texture(job, mi[MI_EMISSIVE], uv))
    _put(rows, G_EMITTED, slot, emitted)
    return TO_BE_LIT


@inner
def _reflecting(job, mi, mf, uv, rows, slot):
    """Put how pixels reflect into the rows from G_METALLIC to G_KEPT."""
    one = vec.f32(1.0)
    metallic, roughness, kept = vec.f32(mf[MF_METALLIC]), vec.f32(mf[MF_ROUGHNESS]), one
    occlusion = mi[MI_OCCLUSION]
    if mi[MI_METALLIC_ROUGHNESS] >= 0:
        r, g, b, _ = _texture(job, mi[MI_METALLIC_ROUGHNESS], uv)
        roughness, metallic = roughness * g, metallic * b
        if occlusion == mi[MI_METALLIC_ROUGHNESS]:  # mostly the same picture
            kept = one + vec.f32(mf[MF_OCCLUSION]) * (r - one)
            occlusion = np.int64(-1)
    if occlusion >= 0:
        r, _, _, _ = _texture(job, occlusion, uv)
        kept = one + vec.f32(mf[MF_OCCLUSION]) * (r - one)
    f90 = vec.f32(mf[MF_SPECULAR])
    if mi[MI_SPECULAR] >= 0:
        _, _, _, alpha = _texture(job, mi[MI_SPECULAR], uv)
        f90 = f90 * alpha
    tint = _three(mf, MF_SPECULAR_COLOR)
    if mi[MI_SPECULAR_COLOR] >= 0:
        tint = _times(tint, _texture(job, mi[MI_SPECULAR_COLOR], uv))
    reflectance = vec.f32(mf[MF_REFLECTANCE])
    vec.store(rows, G_METALLIC * STRIDE + slot, _clamped(metallic))
    vec.store(rows, G_ROUGHNESS * STRIDE + slot, _clamped(roughness))
    vec.store(rows, G_F90 * STRIDE + slot, f90)
    vec.store(rows, G_KEPT * STRIDE + slot, kept)
    f0 = (
        vec.least(reflectance * tint[0], one) * f90,
        vec.least(reflectance * tint[1], one) * f90,
        vec.least(reflectance * tint[2], one) * f90,
    )
    _put(rows, G_F0, slot, f0)


@inlined
def _bent(n, t, hand, texel, strength):
    """Unit normals by a normal map; where a tangent has no direction, the normal stays as it was.

    Args:
        n: unit normals of the front. t: tangents, any length. hand: -1 or 1. texel: of the map.
    """
    zero, one, two = vec.f32(0.0), vec.f32(1.0), vec.f32(2.0)
    along = dot(n, t)
    t = t[0] - along * n[0], t[1] - along * n[1], t[2] - along * n[2]
    scale = reach(t, one)
    usable = scale > zero
    t = t[0] * scale, t[1] * scale, t[2] * scale
    b = cross(n, t)
    mx, my, mz = (two * texel[0] - one) * strength, (two * texel[1] - one) * strength * hand, two * texel[2] - one
    x = mx * t[0] + my * b[0] + mz * n[0]
    y = mx * t[1] + my * b[1] + mz * n[1]
    z = mx * t[2] + my * b[2] + mz * n[2]
    scale = reach((x, y, z), one)
    usable = usable & (scale > zero)
    return vec.select(usable, x * scale, n[0]), vec.select(usable, y * scale, n[1]), vec.select(usable, z * scale, n[2])
