"""What a segment of pixels of one instance looks like: base colour, normal map, light."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import f64_at, i32_at
from renderers.shading.brdf import FAINT, alpha_of, coat, cosines, gloss, reflected, schlick_at
from renderers.shading.gamma import decode_gamma
from renderers.shading.layout import (
    A_BASE,
    A_COLOR,
    A_EMISSIVE,
    A_FACING,
    A_NORMAL,
    A_OCCLUSION,
    A_ROUGH,
    A_TANGENT,
    A_TEXEL,
    HAS_COLORS,
    HAS_NORMALS,
    P_MIRROR,
    P_NORMAL,
    P_TANGENT,
    S_DECODED,
    S_LENS,
    S_MODE,
    S_PBR,
)
from renderers.shading.materials import (
    COLORS_MULTIPLY,
    COLORS_REPLACE,
    MF_BASE,
    MF_EMISSIVE,
    MF_METALLIC,
    MF_NORMAL_SCALE,
    MF_OCCLUSION,
    MF_ROUGHNESS,
    MI_BASE,
    MI_COLORS,
    MI_EMISSIVE,
    MI_METALLIC_ROUGHNESS,
    MI_NORMAL,
    MI_OCCLUSION,
    MI_UNLIT,
)
from renderers.shading.output_merge import DIRECT, write
from renderers.shading.sampling import AS_STORED, SRGB, sample

UNIFORM: Final = 0
FROM_ROWS: Final = 1
FROM_TEXTURE: Final = 2


@inner
def base_colors(job, has, mi, mf, rows, stride, begin, end):
    """Base colour and alpha of a segment into the rows A_BASE: factor x vertex colour x texture."""
    textured, colored = mi[MI_BASE] >= 0, (has & HAS_COLORS) != 0
    if textured:
        sample(job, mi[MI_BASE], SRGB if job[S_PBR] != 0 else AS_STORED, rows, stride, begin, end, A_TEXEL)
    rule = mi[MI_COLORS]
    for k in range(4):
        factor = vec.f32(mf[MF_BASE + k])
        if k < 3 and colored and rule == COLORS_REPLACE:
            factor = vec.f32(1.0)
        decoded = k < 3 and rule != COLORS_MULTIPLY
        for x in range(begin, end, vec.LANES):
            value = factor
            if colored:
                color = vec.load(rows, (A_COLOR + k) * stride + x)
                if decoded:
                    color = decode_gamma(color, job[S_DECODED])
                value = value * color
            if textured:
                value = value * vec.load(rows, (A_TEXEL + k) * stride + x)
            vec.store(rows, (A_BASE + k) * stride + x, value)


@inlined
def turned(m, k, x, y, z):
    """The (3, 3) float32 map from value ``k`` of a pointer on, of three f32x8."""
    return (
        vec.f32(m[k]) * x + vec.f32(m[k + 1]) * y + vec.f32(m[k + 2]) * z,
        vec.f32(m[k + 3]) * x + vec.f32(m[k + 4]) * y + vec.f32(m[k + 5]) * z,
        vec.f32(m[k + 6]) * x + vec.f32(m[k + 7]) * y + vec.f32(m[k + 8]) * z,
    )


@inlined
def reach(x, y, z, to):
    """What makes a vector ``to`` long; 0 where it has no direction."""
    zero = vec.f32(0.0)
    length = vec.sqrt(x * x + y * y + z * z)
    return vec.select(length > zero, to / length, zero)


@inlined
def _seen_normal(maps, smooth, rows, stride, x):
    """Unit normal in the optical frame, on the side that is seen; 0 where it has no direction.

    Args:
        maps: pointer to the instance's P_COLUMNS values. smooth: whether the mesh has normals.
    """
    at = A_NORMAL * stride + x
    nx, ny, nz = vec.load(rows, at), vec.load(rows, at + stride), vec.load(rows, at + 2 * stride)
    facing = vec.f32(1.0)
    if smooth:
        nx, ny, nz = turned(maps, P_NORMAL, nx, ny, nz)
        facing = vec.load(rows, A_FACING * stride + x)
    scale = reach(nx, ny, nz, facing)
    return nx * scale, ny * scale, nz * scale


@inner
def map_normals(job, has, mi, mf, maps, rows, stride, begin, end):
    """Put the normal map's unit normals, in the optical frame, on the side that is seen and with minus their z, into
    the rows A_NORMAL. Where a tangent has no direction, the normal stays as it was."""
    sample(job, mi[MI_NORMAL], AS_STORED, rows, stride, begin, end, A_TEXEL)
    one, two, zero = vec.f32(1.0), vec.f32(2.0), vec.f32(0.0)
    strength, mirror = vec.f32(mf[MF_NORMAL_SCALE]), vec.f32(maps[P_MIRROR])
    smooth = (has & HAS_NORMALS) != 0
    for x in range(begin, end, vec.LANES):
        nx, ny, nz = _seen_normal(maps, smooth, rows, stride, x)
        # In the frame of the front; a back face shows the reversed normal (glTF 3.9.6).
        side = vec.load(rows, A_FACING * stride + x)
        fx, fy, fz = nx * side, ny * side, nz * side
        at = A_TANGENT * stride + x
        tx, ty, tz = vec.load(rows, at), vec.load(rows, at + stride), vec.load(rows, at + 2 * stride)
        tx, ty, tz = turned(maps, P_TANGENT, tx, ty, tz)
        along = fx * tx + fy * ty + fz * tz
        tx, ty, tz = tx - along * fx, ty - along * fy, tz - along * fz
        scale = reach(tx, ty, tz, one)
        usable = scale > zero
        tx, ty, tz = tx * scale, ty * scale, tz * scale
        # The bitangent of a mirror image is the mirrored one.
        hand = vec.select(vec.load(rows, at + 3 * stride) * mirror >= zero, one, -one)
        bx, by, bz = (fy * tz - fz * ty) * hand, (fz * tx - fx * tz) * hand, (fx * ty - fy * tx) * hand
        at = A_TEXEL * stride + x
        mx = (vec.load(rows, at) * two - one) * strength
        my = (vec.load(rows, at + stride) * two - one) * strength
        mz = vec.load(rows, at + 2 * stride) * two - one
        ux, uy, uz = mx * tx + my * bx + mz * fx, mx * ty + my * by + mz * fy, mx * tz + my * bz + mz * fz
        scale = reach(ux, uy, uz, side)
        usable = usable & (scale != zero)
        at = A_NORMAL * stride + x
        vec.store(rows, at, vec.select(usable, ux * scale, nx))
        vec.store(rows, at + stride, vec.select(usable, uy * scale, ny))
        vec.store(rows, at + 2 * stride, -vec.select(usable, uz * scale, nz))


@inlined
def _color(job, varying, mf, rows, stride, x):
    """Base colour of eight pixels: the rows A_BASE where it varies, the texture's times the material's factor, or that
    alone."""
    if varying == FROM_ROWS:
        at = A_BASE * stride + x
        return vec.load(rows, at), vec.load(rows, at + stride), vec.load(rows, at + 2 * stride)
    r, g, b = vec.f32(mf[MF_BASE]), vec.f32(mf[MF_BASE + 1]), vec.f32(mf[MF_BASE + 2])
    if varying == FROM_TEXTURE:
        at = A_TEXEL * stride + x
        r, g, b = r * vec.load(rows, at), g * vec.load(rows, at + stride), b * vec.load(rows, at + 2 * stride)
    return r, g, b


@inlined
def _turn(maps, smooth, rows, stride, x):
    """Turn the normals of eight pixels, of any length, into the optical frame and to the side that is seen; with minus
    their z."""
    at = A_NORMAL * stride + x
    nx, ny, nz = vec.load(rows, at), vec.load(rows, at + stride), vec.load(rows, at + 2 * stride)
    if smooth:
        nx, ny, nz = turned(maps, P_NORMAL, nx, ny, nz)
        facing = vec.load(rows, A_FACING * stride + x)
        nx, ny, nz = nx * facing, ny * facing, nz * facing
    vec.store(rows, at, nx)
    vec.store(rows, at + stride, ny)
    vec.store(rows, at + 2 * stride, -nz)


@inlined
def _out(job, pbr, direct, line, rows, stride, x, r, g, b):
    """Eight finished pixels to the picture, or for the layers to the rows A_BASE."""
    if direct:
        write(job, pbr, line, x, r, g, b)
    else:
        vec.store(rows, A_BASE * stride + x, r)
        vec.store(rows, (A_BASE + 1) * stride + x, g)
        vec.store(rows, (A_BASE + 2) * stride + x, b)


@inner
def show_unlit(job, mf, varying, rows, stride, begin, end, line):
    """A segment whose colour is its base colour."""
    direct = job[S_MODE] == DIRECT
    pbr = job[S_PBR] != 0
    for x in range(begin, end, vec.LANES):
        r, g, b = _color(job, varying, mf, rows, stride, x)
        if pbr:
            _out(job, True, direct, line, rows, stride, x, r, g, b)
        else:
            _out(job, False, direct, line, rows, stride, x, r, g, b)


@inner
def light_phong(job, has, mf, maps, varying, rows, stride, begin, end, line):
    """The head light shines along the optical axis: base x max(0, n . (0, 0, -1))."""
    direct = job[S_MODE] == DIRECT
    smooth = (has & HAS_NORMALS) != 0
    zero = vec.f32(0.0)
    for x in range(begin, end, vec.LANES):
        r, g, b = _color(job, varying, mf, rows, stride, x)
        _, _, nz = _seen_normal(maps, smooth, rows, stride, x)
        light = vec.most(-nz, zero)
        _out(job, False, direct, line, rows, stride, x, r * light, g * light, b * light)


@inner
def row_schlick(job, y, places, width):
    """``lights.schlick`` of a row of ``width`` pixels: 0 where it is not seen, -1 where it differs."""
    ends = max(_schlick_at(job, y, places, np.int64(0)), _schlick_at(job, y, places, width - 1))
    return np.float32(0.0 if ends < FAINT else -1.0)


@inner
def _schlick_at(job, y, places, x):
    lens = f64_at(job[S_LENS])
    return schlick_at(lens, y, x if places == 0 else np.int64(i32_at(places)[x]))


@inner
def light_pbr(job, has, mi, mf, maps, y, places, varying, ready, rows, stride, begin, end, line, steep):
    """Reflection, occlusion and emission, linear. The normals in the rows are replaced by what comes of them.

    Args:
        ready: whether the normals are on the side that is seen already, with minus their z. steep: see ``row_schlick``.
    """
    lens = f64_at(job[S_LENS])
    rough, occluded, emitting = mi[MI_METALLIC_ROUGHNESS] >= 0, mi[MI_OCCLUSION] >= 0, mi[MI_EMISSIVE] >= 0
    if rough:
        sample(job, mi[MI_METALLIC_ROUGHNESS], AS_STORED, rows, stride, begin, end, A_ROUGH)
    if occluded:
        sample(job, mi[MI_OCCLUSION], AS_STORED, rows, stride, begin, end, A_OCCLUSION)
    if emitting:
        sample(job, mi[MI_EMISSIVE], SRGB, rows, stride, begin, end, A_EMISSIVE)
    if not ready:
        smooth = (has & HAS_NORMALS) != 0
        for x in range(begin, end, vec.LANES):
            _turn(maps, smooth, rows, stride, x)
    put_cosines(lens, y, places, rows, stride, begin, end)
    if rough or varying != UNIFORM or occluded or emitting or job[S_MODE] != DIRECT:
        if steep < np.float32(0.0):
            steep = _schlick_at(job, y, places, (begin + end) // 2)
        _finish_varied(job, mi, mf, steep, varying, rows, stride, begin, end, line)
    else:
        finish_uniform(job, mf, y, places, rows, stride, begin, end, line, steep)


@inner
def put_cosines(lens, y, places, rows, stride, begin, end):
    """Replace the normals in the rows, on the side that is seen and with minus their z, by ``lights.cosines``."""
    lane = vec.to_f32(vec.iota())
    left, across = vec.f32(0.5 - lens[2]), vec.f32(1.0 / lens[0])
    dy = vec.f32((y + 0.5 - lens[3]) / lens[1])
    high = dy * dy + vec.f32(1.0)
    for x in range(begin, end, vec.LANES):
        at = A_NORMAL * stride + x
        nx, ny, towards = vec.load(rows, at), vec.load(rows, at + stride), vec.load(rows, at + 2 * stride)
        column = vec.f32(x) + lane if places == 0 else vec.to_f32(vec.load(i32_at(places), x))
        n_l, n_v, v_l = cosines(nx, ny, towards, (column + left) * across, dy, high)
        vec.store(rows, at, n_l)
        vec.store(rows, at + stride, n_v)
        vec.store(rows, at + 2 * stride, v_l)


@inner
def finish_uniform(job, mf, y, places, rows, stride, begin, end, line, steep):
    """From ``lights.cosines`` in the rows to the picture, of a material whose factors are all there is to it."""
    if steep < np.float32(0.0):
        steep = _schlick_at(job, y, places, (begin + end) // 2)
    a2 = alpha_of(vec.f32(mf[MF_ROUGHNESS]))
    # Eight pixels are glossed while the eight before them are finished: neither waits for the other.
    n_l, specular = _glossed(rows, stride, begin, a2)
    red, green, blue = vec.f32(mf[MF_BASE]), vec.f32(mf[MF_BASE + 1]), vec.f32(mf[MF_BASE + 2])
    diffuse, f0, grazing = coat(red, green, blue, vec.f32(mf[MF_METALLIC]))
    er, eg, eb = vec.f32(mf[MF_EMISSIVE]), vec.f32(mf[MF_EMISSIVE + 1]), vec.f32(mf[MF_EMISSIVE + 2])
    grazed = vec.f32(steep)
    for x in range(begin, end, vec.LANES):
        next_n_l, next_specular = _glossed(rows, stride, x + vec.LANES, a2)
        r = reflected(n_l, specular, grazed, diffuse[0], f0[0], grazing[0]) + er
        g = reflected(n_l, specular, grazed, diffuse[1], f0[1], grazing[1]) + eg
        b = reflected(n_l, specular, grazed, diffuse[2], f0[2], grazing[2]) + eb
        write(job, True, line, x, r, g, b)
        n_l, specular = next_n_l, next_specular


@inlined
def _glossed(rows, stride, x, a2):
    at = A_NORMAL * stride + x
    return gloss(vec.load(rows, at), vec.load(rows, at + stride), vec.load(rows, at + 2 * stride), a2)


@inner
def _finish_varied(job, mi, mf, steep, varying, rows, stride, begin, end, line):
    """As ``finish_uniform`` with whatever textures there are, or for the layers."""
    rough, occluded, emitting = mi[MI_METALLIC_ROUGHNESS] >= 0, mi[MI_OCCLUSION] >= 0, mi[MI_EMISSIVE] >= 0
    roughness = vec.f32(mf[MF_ROUGHNESS])
    for x in range(begin, end, vec.LANES):
        at = A_NORMAL * stride + x
        n_l, n_v, v_l = vec.load(rows, at), vec.load(rows, at + stride), vec.load(rows, at + 2 * stride)
        a2 = alpha_of(roughness * vec.load(rows, (A_ROUGH + 1) * stride + x) if rough else roughness)
        n_l, specular = gloss(n_l, n_v, v_l, a2)
        vec.store(rows, at, n_l)
        vec.store(rows, at + stride, specular)
    direct, one, grazed = job[S_MODE] == DIRECT, vec.f32(1.0), vec.f32(steep)
    for x in range(begin, end, vec.LANES):
        r, g, b = _color(job, varying, mf, rows, stride, x)
        metallic = vec.f32(mf[MF_METALLIC])
        if rough:
            metallic = metallic * vec.load(rows, (A_ROUGH + 2) * stride + x)
        diffuse, f0, grazing = coat(r, g, b, metallic)
        at = A_NORMAL * stride + x
        n_l, specular = vec.load(rows, at), vec.load(rows, at + stride)
        r = reflected(n_l, specular, grazed, diffuse[0], f0[0], grazing[0])
        g = reflected(n_l, specular, grazed, diffuse[1], f0[1], grazing[1])
        b = reflected(n_l, specular, grazed, diffuse[2], f0[2], grazing[2])
        if occluded:
            kept = one + vec.f32(mf[MF_OCCLUSION]) * (vec.load(rows, A_OCCLUSION * stride + x) - one)
            r, g, b = r * kept, g * kept, b * kept
        er, eg, eb = vec.f32(mf[MF_EMISSIVE]), vec.f32(mf[MF_EMISSIVE + 1]), vec.f32(mf[MF_EMISSIVE + 2])
        if emitting:
            at = A_EMISSIVE * stride + x
            er, eg, eb = er * vec.load(rows, at), eg * vec.load(rows, at + stride), eb * vec.load(rows, at + 2 * stride)
        _out(job, True, direct, line, rows, stride, x, r + er, g + eg, b + eb)


@inner
def shade(job, has, mi, mf, maps, y, places, bumpy, rows, stride, begin, end, line, steep):
    """Shade the pixels ``begin .. end`` of one instance from their attributes; ``places`` as in ``resolve``, ``steep``
    from ``row_schlick``."""
    varying = UNIFORM
    if (has & HAS_COLORS) != 0 or job[S_MODE] != DIRECT or (bumpy and mi[MI_BASE] >= 0):
        varying = FROM_ROWS
        base_colors(job, has, mi, mf, rows, stride, begin, end)
    elif mi[MI_BASE] >= 0:
        varying = FROM_TEXTURE  # no alpha is needed, and nothing else writes to the texture's rows
        sample(job, mi[MI_BASE], SRGB if job[S_PBR] != 0 else AS_STORED, rows, stride, begin, end, A_TEXEL)
    if mi[MI_UNLIT] != 0:
        show_unlit(job, mf, varying, rows, stride, begin, end, line)
    elif job[S_PBR] != 0:
        if bumpy:
            map_normals(job, has, mi, mf, maps, rows, stride, begin, end)
        light_pbr(job, has, mi, mf, maps, y, places, varying, bumpy, rows, stride, begin, end, line, steep)
    else:
        light_phong(job, has, mf, maps, varying, rows, stride, begin, end, line)
