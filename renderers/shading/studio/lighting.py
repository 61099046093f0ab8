"""Light on gathered surfaces, eight pixels at a time: lights with shadows, the environment map, the tone curve."""

from __future__ import annotations

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import f32_at, f64_at, i32_at, i64_at
from renderers.shading.brdf import ambient_channel, reflected
from renderers.shading.layout import S_LENS, STRIDE
from renderers.shading.studio.environment_map import LEVELS
from renderers.shading.studio.layout import (
    J_LEVELS,
    J_LIGHT_COUNT,
    J_LIGHTS,
    J_RADIANCE,
    J_SHADOW_FLOATS,
    J_SHADOW_INTEGERS,
    J_SHADOW_RADIUS,
    J_SPLIT,
    J_SPLIT_SIDE,
    J_TONE,
    LENS_EXPOSURE,
    LENS_WORLD,
    R_AMBIENT,
    R_BASE,
    R_EMITTED,
    R_F0,
    R_F90,
    R_FLAT,
    R_LIGHT,
    R_METALLIC,
    R_NORMAL,
    R_POINT,
    R_ROUGHNESS,
    R_VIEW,
)
from renderers.shading.studio.lights import (
    L_COLOR,
    L_COLUMNS,
    L_DIRECTION,
    L_KIND,
    L_POSITION,
    L_RANGE,
    L_SHADOW,
    L_SPOT_OFFSET,
    L_SPOT_SCALE,
)
from renderers.shading.studio.shadow_sampling import light_share
from renderers.shading.studio.shadows import S_COLUMNS, SI_COLUMNS
from renderers.shading.studio.tonemap import shown
from renderers.shading.vec3 import dot, transform_directions


@inlined
def _three(rows, row, x):
    at = row * STRIDE + x
    return vec.load(rows, at), vec.load(rows, at + STRIDE), vec.load(rows, at + 2 * STRIDE)


@inlined
def _put(rows, row, x, r, g, b):
    at = row * STRIDE + x
    vec.store(rows, at, r)
    vec.store(rows, at + STRIDE, g)
    vec.store(rows, at + 2 * STRIDE, b)


@inlined
def _arriving(light, p):
    """Return unit vectors from points to a light (a pointer to its row) and the share of its colour that arrives."""
    zero, one = vec.f32(0.0), vec.f32(1.0)
    shining = vec.f32(light[L_DIRECTION]), vec.f32(light[L_DIRECTION + 1]), vec.f32(light[L_DIRECTION + 2])
    if light[L_KIND] == 0.0:
        return -shining[0], -shining[1], -shining[2], one
    x = vec.f32(light[L_POSITION]) - p[0]
    y = vec.f32(light[L_POSITION + 1]) - p[1]
    z = vec.f32(light[L_POSITION + 2]) - p[2]
    d2 = vec.maximum(x * x + y * y + z * z, vec.f32(1e-12))
    scale = one / vec.sqrt(d2)
    x, y, z = x * scale, y * scale, z * scale
    part = one / d2
    if light[L_RANGE] > 0.0:
        reach = d2 * vec.f32(light[L_RANGE])
        part = part * vec.maximum(vec.minimum(one - reach * reach, one), zero)
    if light[L_KIND] == 2.0:
        cosine = -(x * shining[0] + y * shining[1] + z * shining[2])
        cone = cosine * vec.f32(light[L_SPOT_SCALE]) + vec.f32(light[L_SPOT_OFFSET])
        cone = vec.minimum(vec.maximum(cone, zero), one)
        part = part * cone * cone
    return x, y, z, part


@device_function
def _add_light(job, light, rows, count):
    """Add the reflection of one light at ``count`` pixels to the rows R_LIGHT."""
    zero = vec.f32(0.0)
    shadow = np.int64(light[L_SHADOW])
    color = vec.f32(light[L_COLOR]), vec.f32(light[L_COLOR + 1]), vec.f32(light[L_COLOR + 2])
    for x in range(0, count, vec.LANES):
        n, p = _three(rows, R_NORMAL, x), _three(rows, R_POINT, x)
        lx, ly, lz, part = _arriving(light, p)
        l = (lx, ly, lz)
        n_l = dot(n, l)
        part = vec.select(n_l > zero, part, zero)
        if shadow >= 0:
            flat = _three(rows, R_FLAT, x)
            # Else the triangle itself is in the way.
            part = vec.select(dot(flat, l) > zero, part, zero)
            if vec.movemask(part > zero) != 0:
                part = part * light_share(
                    f64_at(job[J_SHADOW_FLOATS] + 8 * S_COLUMNS * shadow),
                    i64_at(job[J_SHADOW_INTEGERS] + 8 * SI_COLUMNS * shadow),
                    job[J_SHADOW_RADIUS],
                    p[0],
                    p[1],
                    p[2],
                    flat[0],
                    flat[1],
                    flat[2],
                )
        lit = part > zero
        if vec.movemask(lit) == 0:
            continue
        r, g, b = reflected(
            n,
            _three(rows, R_VIEW, x),
            l,
            n_l,
            _three(rows, R_BASE, x),
            vec.load(rows, R_METALLIC * STRIDE + x),
            vec.load(rows, R_ROUGHNESS * STRIDE + x),
            _three(rows, R_F0, x),
            vec.load(rows, R_F90 * STRIDE + x),
        )
        red, green, blue = _three(rows, R_LIGHT, x)
        _put(
            rows,
            R_LIGHT,
            x,
            red + vec.select(lit, part * color[0] * r, zero),
            green + vec.select(lit, part * color[1] * g, zero),
            blue + vec.select(lit, part * color[2] * b, zero),
        )


@inlined
def _octahedral(d):
    """Return positions of directions (any length) in an octahedral table, 0 .. 1 each way; the middle for 0."""
    zero, half = vec.f32(0.0), vec.f32(0.5)
    total = vec.absolute(d[0]) + vec.absolute(d[1]) + vec.absolute(d[2])
    scale = vec.select(total > zero, vec.f32(1.0) / total, zero)
    u, v = d[0] * scale, d[1] * scale
    fold = vec.maximum(zero - d[2] * scale, zero)
    u = vec.select(u >= zero, u + fold, u - fold)
    v = vec.select(v >= zero, v + fold, v - fold)
    return half * u + half, half * v + half


@device_function
def _read(texels, places, level, u, v):
    """Sample octahedral tables with a border of one texel, bilinear, RGB. ``level``: i32x8, number of the table."""
    two, four = vec.i32(2), vec.i32(4)
    offset, side = vec.gather(places, level * two), vec.gather(places, level * two + vec.i32(1))
    most = vec.to_f32(side)
    half = vec.f32(0.5)
    x = vec.minimum(vec.maximum(u * most + half, vec.f32(0.0)), most + half)
    y = vec.minimum(vec.maximum(v * most + half, vec.f32(0.0)), most + half)
    i, j = vec.to_i32(x), vec.to_i32(y)
    fx, fy = x - vec.to_f32(i), y - vec.to_f32(j)
    gx, gy = vec.f32(1.0) - fx, vec.f32(1.0) - fy
    line = (side + two) * four
    at = offset + j * line + i * four
    # Of two neighbours, four values each.
    a, c = vec.load_octets(texels, at), vec.load_octets(texels, at + line)
    wa, wb, wc, wd = gx * gy, fx * gy, gx * fy, fx * fy
    return (
        a[0] * wa + a[4] * wb + c[0] * wc + c[4] * wd,
        a[1] * wa + a[5] * wb + c[1] * wc + c[5] * wd,
        a[2] * wa + a[6] * wb + c[2] * wc + c[6] * wd,
    )


@device_function
def _split(table, side, n_v, roughness):
    """Return scale and bias of ``split_sum``, bilinear. Both coordinates are 0 .. 1."""
    one, two, last = vec.f32(1.0), vec.i32(2), vec.i32(side - 2)
    x, y = n_v * vec.f32(side - 1), roughness * vec.f32(side - 1)
    i, j = vec.minimum(vec.to_i32(x), last), vec.minimum(vec.to_i32(y), last)
    fx, fy = x - vec.to_f32(i), y - vec.to_f32(j)
    place = (i * vec.i32(side) + j) * two
    wa, wb, wc, wd = (one - fx) * (one - fy), fx * (one - fy), (one - fx) * fy, fx * fy
    # Scale and bias at a roughness and at the next.
    a, c = vec.load_quads(table, place), vec.load_quads(table, place + vec.i32(2 * side))
    return (
        a[0] * wa + c[0] * wb + a[2] * wc + c[2] * wd,
        a[1] * wa + c[1] * wb + a[3] * wc + c[3] * wd,
    )


@device_function
def _add_environment(job, rows, count):
    """Add the reflection of the environment map (world frame) at ``count`` pixels to the rows R_LIGHT."""
    world = f64_at(job[S_LENS] + 8 * LENS_WORLD)
    texels, places = f32_at(job[J_RADIANCE]), i32_at(job[J_LEVELS])
    zero, one, two = vec.f32(0.0), vec.f32(1.0), vec.f32(2.0)
    for x in range(0, count, vec.LANES):
        n, v = _three(rows, R_NORMAL, x), _three(rows, R_VIEW, x)
        roughness = vec.minimum(vec.maximum(vec.load(rows, R_ROUGHNESS * STRIDE + x), zero), one)
        n_v = dot(n, v)
        # Rough surfaces reflect light from between the mirrored direction and the normal (Lagarde and de Rousiers,
        # "Moving Frostbite to PBR", 2014, 4.9.3).
        alpha = roughness * roughness
        mirror = (one - alpha) * (vec.sqrt(one - alpha) + alpha)
        up = one - mirror + mirror * two * n_v
        m = up * n[0] - mirror * v[0], up * n[1] - mirror * v[1], up * n[2] - mirror * v[2]
        n_v = vec.minimum(vec.maximum(n_v, zero), one)
        scale, bias = _split(f32_at(job[J_SPLIT]), job[J_SPLIT_SIDE], n_v, roughness)
        u, w = _octahedral(transform_directions(world, 0, n))
        d0, d1, d2 = _read(texels, places, vec.i32(LEVELS), u, w)
        at = roughness * vec.f32(float(LEVELS - 1))
        low = vec.minimum(vec.to_i32(at), vec.i32(LEVELS - 2))
        part = at - vec.to_f32(low)
        u, w = _octahedral(transform_directions(world, 0, m))
        r0, g0, b0 = _read(texels, places, low, u, w)
        r1, g1, b1 = _read(texels, places, low + vec.i32(1), u, w)
        base, f0 = _three(rows, R_BASE, x), _three(rows, R_F0, x)
        f90 = vec.load(rows, R_F90 * STRIDE + x)
        metallic, kept = vec.load(rows, R_METALLIC * STRIDE + x), vec.load(rows, R_AMBIENT * STRIDE + x)
        r = ambient_channel(base[0], metallic, f0[0], f90, scale, bias, d0, r0 + part * (r1 - r0))
        g = ambient_channel(base[1], metallic, f0[1], f90, scale, bias, d1, g0 + part * (g1 - g0))
        b = ambient_channel(base[2], metallic, f0[2], f90, scale, bias, d2, b0 + part * (b1 - b0))
        red, green, blue = _three(rows, R_LIGHT, x)
        _put(rows, R_LIGHT, x, red + kept * r, green + kept * g, blue + kept * b)


@device_function
def light_up(job, rows, count):
    """Fill the rows R_VIEW and R_LIGHT of ``count`` pixels, the latter with tone-mapped linear RGB.

    Args:
        job: pointer to the J_COLUMNS int64.
        rows: pointer to the R_VALUES float32.
    """
    zero = vec.f32(0.0)
    for x in range(0, count, vec.LANES):
        _put(rows, R_LIGHT, x, zero, zero, zero)
        px, py, pz = _three(rows, R_POINT, x)
        length = vec.sqrt(px * px + py * py + pz * pz)
        scale = vec.select(length > zero, vec.f32(-1.0) / length, zero)
        _put(rows, R_VIEW, x, px * scale, py * scale, pz * scale)
    for k in range(job[J_LIGHT_COUNT]):
        _add_light(job, f64_at(job[J_LIGHTS] + 8 * L_COLUMNS * k), rows, count)
    if job[J_RADIANCE] != 0:
        _add_environment(job, rows, count)
    exposure = vec.f32(f64_at(job[S_LENS])[LENS_EXPOSURE])
    tone = job[J_TONE]
    for x in range(0, count, vec.LANES):
        r, g, b = _three(rows, R_LIGHT, x)
        er, eg, eb = _three(rows, R_EMITTED, x)
        r, g, b = shown(tone, (r + er) * exposure, (g + eg) * exposure, (b + eb) * exposure)
        _put(rows, R_LIGHT, x, r, g, b)
