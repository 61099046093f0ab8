"""Segments with a picture on them under the head light: eight neighbouring pixels at a time, whatever runs they are of.

Runs of a few pixels leave most lanes idle where they are resolved one after the other. Here eight runs are set up side
by side, every attribute as a linear function along its run, and a pixel's lane takes the functions of its own run. Then
the segment is sampled, lit and packed in one loop.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from renderers import simd as vec
from renderers.linked import inlined, inner
from renderers.pointers import f32_at, f64_at, i32_at, i64_at
from renderers.shading.ahead import look_ahead_of_runs
from renderers.shading.compose import packed
from renderers.shading.layout import (
    A_LIGHT,
    A_TEXEL,
    A_UV0,
    HAS_NORMALS,
    II_VERTICES,
    P_MIRROR,
    P_NORMAL,
    S_TEXTURE_FLOATS,
    S_TEXTURES,
    V_COLUMNS,
    V_NORMAL,
    V_UV0,
)
from renderers.shading.materials import MF_BASE, MI_BASE, MI_UNLIT
from renderers.shading.resolve import (
    R_BASE,
    R_FACING,
    R_FLAT,
    R_INDEX,
    R_SLOPE,
    further,
    set_up,
    weights,
)
from renderers.shading.sampling import AS_STORED, at_once, bilinear, coordinates, locate, nearest
from renderers.shading.surface import reach, turned
from renderers.shading.textures import TF_COLUMNS, TI_COLUMNS, TI_HEIGHT, TI_LINEAR, TI_STRIDE

LONGEST: Final = 64
"""Pixels of a run that is one linear function in float32; longer ones are resolved eight pixels at a time, each from a
place in float64."""

PART: Final = 64
"""Pixels that are sampled at a time."""
AHEAD: Final = 128
"""Pixels that are resolved before their texels are read, while these come from further away."""
LARGE: Final = 1 << 17
"""Texels of images that are fetched: half a megabyte, which is not in the nearer caches anyhow."""


@inlined
def _light(nx, ny, nz, facing):
    """What ``surface.light_phong`` multiplies colours by."""
    return vec.most(-(nz * reach(nx, ny, nz, facing)), vec.f32(0.0))


@inlined
def _blend(b, corners, k):
    """Value ``k`` of three corners, by coordinates of any scale."""
    return b[0] * corners[0][k] + b[1] * corners[1][k] + b[2] * corners[2][k]


@inlined
def _coordinates(vertices, offsets):
    """Texture coordinates of eight vertices."""
    u, v = vec.gather_pairs(vertices, offsets + vec.i32(V_UV0))
    return vec.float_of(u), vec.float_of(v)


@inlined
def _line(base, slope, lanes, t):
    """A linear function of each lane's run."""
    return vec.permute(base, lanes) + vec.permute(slope, lanes) * t


@inner
def _together(maps, vertices, smooth, lit, starts, batch, begin, end, b, s, rows, stride, scratch):
    """Eight short runs, every pixel within its triangle: the pixels ``begin .. end``.

    Args:
        b, s: unnormalised barycentric coordinates at the runs' first pixels, and their change per pixel.
    """
    whole, values = i32_at(scratch), f32_at(scratch)
    i0 = vec.load(whole, 8 * R_INDEX) * vec.i32(V_COLUMNS)
    i1 = vec.load(whole, 8 * R_INDEX + 8) * vec.i32(V_COLUMNS)
    i2 = vec.load(whole, 8 * R_INDEX + 16) * vec.i32(V_COLUMNS)
    u0, v0 = _coordinates(vertices, i0)
    u1, v1 = _coordinates(vertices, i1)
    u2, v2 = _coordinates(vertices, i2)
    u1, v1, u2, v2 = u1 - u0, v1 - v0, u2 - u0, v2 - v0
    ub, vb = b[1] * u1 + b[2] * u2, b[1] * v1 + b[2] * v2
    us, vs = s[1] * u1 + s[2] * u2, s[1] * v1 + s[2] * v2
    db, ds = b[0] + b[1] + b[2], s[0] + s[1] + s[2]
    zero, one = vec.f32(0.0), vec.f32(1.0)
    n = m = zero, zero, zero
    shine = one
    if lit and smooth:
        normal = vec.i32(V_NORMAL)
        corners = (
            vec.load_triples(vertices, i0 + normal),
            vec.load_triples(vertices, i1 + normal),
            vec.load_triples(vertices, i2 + normal),
        )
        n = turned(maps, P_NORMAL, _blend(b, corners, 0), _blend(b, corners, 1), _blend(b, corners, 2))
        m = turned(maps, P_NORMAL, _blend(s, corners, 0), _blend(s, corners, 1), _blend(s, corners, 2))
        shine = vec.load(values, 8 * R_FACING)
    elif lit:
        shine = _light(
            vec.load(values, 8 * R_FLAT), vec.load(values, 8 * R_FLAT + 8), vec.load(values, 8 * R_FLAT + 16), one
        )
    begins = vec.load(starts, batch)
    next1, next2, next3 = vec.spread1(begins), vec.spread2(begins), vec.spread3(begins)
    next4, next5, next6, next7 = vec.spread4(begins), vec.spread5(begins), vec.spread6(begins), vec.spread7(begins)
    none, unit = vec.i32(0), vec.i32(1)
    for x in range(begin, end, vec.LANES):
        column = vec.i32(x) + vec.iota()
        run = vec.select(column < next1, none, unit)
        run = run + vec.select(column < next2, none, unit)
        run = run + vec.select(column < next3, none, unit)
        run = run + vec.select(column < next4, none, unit)
        run = run + vec.select(column < next5, none, unit)
        run = run + vec.select(column < next6, none, unit)
        run = run + vec.select(column < next7, none, unit)
        t = vec.to_f32(column - vec.permute(begins, run))
        share = one / _line(db, ds, run, t)
        vec.store(rows, A_UV0 * stride + x, vec.permute(u0, run) + _line(ub, us, run, t) * share)
        vec.store(rows, (A_UV0 + 1) * stride + x, vec.permute(v0, run) + _line(vb, vs, run, t) * share)
        if lit:
            light = vec.permute(shine, run)
            if smooth:
                nx, ny, nz = _line(n[0], m[0], run, t), _line(n[1], m[1], run, t), _line(n[2], m[2], run, t)
                light = _light(nx, ny, nz, light)
            vec.store(rows, A_LIGHT * stride + x, light)


@inner
def _alone(maps, vertices, smooth, lit, starts, batch, count, rows, stride, scratch):
    """Runs of any length one after the other."""
    base, slope = f64_at(scratch + 64 * R_BASE), f64_at(scratch + 64 * R_SLOPE)
    whole, values = i32_at(scratch), f32_at(scratch)
    lane = vec.to_f32(vec.iota())
    for k in range(count):
        a = vec.load(vertices, whole[8 * R_INDEX + k] * V_COLUMNS)
        b = vec.load(vertices, whole[8 * R_INDEX + 8 + k] * V_COLUMNS) - a
        c = vec.load(vertices, whole[8 * R_INDEX + 16 + k] * V_COLUMNS) - a
        start = base[k], base[8 + k], base[16 + k]
        begin, end = np.int64(starts[batch + k]), np.int64(starts[batch + k + 1])
        for x in range(begin, end, vec.LANES):
            w1, w2 = weights(start, slope, k, lane)
            if x + vec.LANES < end:
                start = further(base, slope, k, np.float64(x + vec.LANES - begin))
            u = vec.spread6(a) + (w1 * vec.spread6(b) + w2 * vec.spread6(c))
            v = vec.spread7(a) + (w1 * vec.spread7(b) + w2 * vec.spread7(c))
            vec.store(rows, A_UV0 * stride + x, u)
            vec.store(rows, (A_UV0 + 1) * stride + x, v)
            if not lit:
                continue
            if smooth:
                nx = vec.spread3(a) + (w1 * vec.spread3(b) + w2 * vec.spread3(c))
                ny = vec.spread4(a) + (w1 * vec.spread4(b) + w2 * vec.spread4(c))
                nz = vec.spread5(a) + (w1 * vec.spread5(b) + w2 * vec.spread5(c))
                nx, ny, nz = turned(maps, P_NORMAL, nx, ny, nz)
                light = _light(nx, ny, nz, vec.f32(values[8 * R_FACING + k]))
            else:
                flat = values[8 * R_FLAT + k], values[8 * R_FLAT + 8 + k], values[8 * R_FLAT + 16 + k]
                light = _light(vec.f32(flat[0]), vec.f32(flat[1]), vec.f32(flat[2]), vec.f32(1.0))
            vec.store(rows, A_LIGHT * stride + x, light)


@inner
def _resolve(columns, m, maps, lens, y, places, first, smooth, lit, ids, starts, batch, count, rows, stride, scratch):
    """Texture coordinates and, if ``lit``, light of at most eight runs into the rows A_UV0 and A_LIGHT."""
    vertices = f32_at(columns[II_VERTICES])
    base, slope = f64_at(scratch + 64 * R_BASE), f64_at(scratch + 64 * R_SLOPE)
    zero, infinite = vec.f32(0.0), vec.f32(math.inf)
    mirror = maps[P_MIRROR]
    set_up(columns, m, mirror, lens, y, places, first, ids, starts, batch, count, smooth or not lit, scratch)
    used = vec.iota() < vec.i32(count)
    lengths = vec.select(used, vec.load(starts, batch + 1) - vec.load(starts, batch), vec.i32(1))
    last = vec.to_f32(lengths - vec.i32(1))
    b = vec.to_f32(vec.load(base, 0)), vec.to_f32(vec.load(base, 8)), vec.to_f32(vec.load(base, 16))
    s = vec.to_f32(vec.load(slope, 0)), vec.to_f32(vec.load(slope, 8)), vec.to_f32(vec.load(slope, 16))
    e0, e1, e2 = b[0] + s[0] * last, b[1] + s[1] * last, b[2] + s[2] * last
    # Linear between its ends: what is within the triangle there is so everywhere.
    within = (b[0] >= zero) & (b[1] >= zero) & (b[2] >= zero) & (e0 >= zero) & (e1 >= zero) & (e2 >= zero)
    total = e0 + e1 + e2
    within = within & (b[0] + b[1] + b[2] > zero) & (total > zero) & (total < infinite)
    if vec.bits(within & (lengths <= vec.i32(LONGEST))) == 255:
        begin, end = np.int64(starts[batch]), np.int64(starts[batch + count])
        _together(maps, vertices, smooth, lit, starts, batch, begin, end, b, s, rows, stride, scratch)
    else:
        _alone(maps, vertices, smooth, lit, starts, batch, count, rows, stride, scratch)


@inlined
def _pixels(mf, lit, rgba, rows, at):
    """Eight packed pixels."""
    r, g, b = vec.f32(mf[MF_BASE]) * rgba[0], vec.f32(mf[MF_BASE + 1]) * rgba[1], vec.f32(mf[MF_BASE + 2]) * rgba[2]
    if lit:
        light = vec.load(rows, at)
        r, g, b = r * light, g * light, b * light
    return packed(r, g, b)


@inner
def _locate(integers, floats, rows, stride, begin, end):
    """Where the texels of the pixels ``begin .. end`` are, into the rows from A_TEXEL on."""
    large = integers[TI_HEIGHT] * integers[TI_STRIDE] > LARGE
    uv, to = A_UV0 * stride, A_TEXEL * stride
    for x in range(begin, end, vec.LANES):
        u, v = coordinates(integers, floats, rows, uv + x, stride)
        at, fx, fy = locate(integers, u, v, large)
        vec.store(rows, to + x, vec.float_of(at))
        vec.store(rows, to + stride + x, fx)
        vec.store(rows, to + 2 * stride + x, fy)


@inner
def _show_located(integers, floats, mf, lit, rows, stride, begin, end, line):
    """Sample, light and pack what is located, of a material whose factors are within 0 .. 1: nothing is too bright."""
    uv, light, to = A_UV0 * stride, A_LIGHT * stride, A_TEXEL * stride
    red, green, blue = vec.f32(mf[MF_BASE]), vec.f32(mf[MF_BASE + 1]), vec.f32(mf[MF_BASE + 2])
    half, zero = vec.f32(0.5), vec.i32(0)
    for x in range(begin, end, vec.LANES):
        if vec.bits(vec.bits_of(vec.load(rows, to + x)) < zero) != 0:
            u, v = coordinates(integers, floats, rows, uv + x, stride)
            rgba = bilinear(integers, np.int64(0), AS_STORED, u, v)
            vec.store(line, x, _pixels(mf, lit, rgba, rows, light + x))
            continue
        fx, fy = vec.load(rows, to + stride + x), vec.load(rows, to + 2 * stride + x)
        r, g, b, _ = at_once(integers, rows, to + x, fx, fy)
        kr, kg, kb = red, green, blue
        if lit:
            shine = vec.load(rows, light + x)
            kr, kg, kb = red * shine, green * shine, blue * shine
        r, g, b = vec.to_i32(r * kr + half), vec.to_i32(g * kg + half), vec.to_i32(b * kb + half)
        vec.store(line, x, r | (g << vec.i32(8)) | (b << vec.i32(16)))


@inner
def _show(integers, floats, mf, lit, rows, stride, begin, end, line):
    """Sample, light and pack what is resolved."""
    uv, light = A_UV0 * stride, A_LIGHT * stride
    for x in range(begin, end, vec.LANES):
        u, v = coordinates(integers, floats, rows, uv + x, stride)
        if integers[TI_LINEAR] != 0:
            vec.store(line, x, _pixels(mf, lit, bilinear(integers, np.int64(0), AS_STORED, u, v), rows, light + x))
        else:
            vec.store(line, x, _pixels(mf, lit, nearest(integers, np.int64(0), AS_STORED, u, v), rows, light + x))


@inner
def show_textured(
    job, columns, m, maps, lens, y, places, first, many, has, mi, mf, ids, starts, run, last_run, rows, stride, line,
    scratch,
):  # fmt: skip
    """Pixels of the runs ``run .. last_run`` of one instance's triangles, whose colour is the material's factor times a
    texture with coordinates of the first set.

    Args:
        columns .. scratch: as for ``resolve.resolve_triangles``. maps, mi, mf: the instance's and the material's rows.
        line: pointer to the row's packed pixels; up to seven behind the last run are overwritten.
    """
    lit, smooth = mi[MI_UNLIT] == 0, (has & HAS_NORMALS) != 0
    integers = i64_at(job[S_TEXTURES] + 8 * TI_COLUMNS * mi[MI_BASE])
    floats = f32_at(job[S_TEXTURE_FLOATS] + 4 * TF_COLUMNS * mi[MI_BASE])
    modest = True
    for k in range(3):
        modest = modest and mf[MF_BASE + k] >= 0.0 and mf[MF_BASE + k] <= 1.0
    located = modest and integers[TI_LINEAR] != 0
    shown = seen = np.int64(starts[run])
    for batch in range(run, last_run, vec.LANES):
        count = min(last_run - batch, vec.LANES)
        if many:
            look_ahead_of_runs(columns, first, ids, starts, batch, last_run)
        _resolve(
            columns, m, maps, lens, y, places, first, smooth, lit, ids, starts, batch, count, rows, stride, scratch
        )
        if not located:
            continue
        end = np.int64(starts[batch + count])
        whole = seen + (end - seen) // vec.LANES * vec.LANES
        _locate(integers, floats, rows, stride, seen, whole)
        seen = whole
        if seen - shown >= AHEAD + PART:
            last = seen - AHEAD
            _show_located(integers, floats, mf, lit, rows, stride, shown, last, line)
            shown = last
    end = np.int64(starts[last_run])
    if located:
        _locate(integers, floats, rows, stride, seen, end)
        _show_located(integers, floats, mf, lit, rows, stride, shown, end, line)
    else:
        _show(integers, floats, mf, lit, rows, stride, shown, end, line)
