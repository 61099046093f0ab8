"""Segments with a picture on them under the head light: eight neighbouring pixels at a time, whatever runs they are of.

Runs of a few pixels leave most lanes idle where they are resolved one after the other. Here eight runs are laid side by
side, every value as a linear function along its run, and a pixel's lane takes the functions of its own run. What comes
of them is then done with for the whole segment, see ``mixing``.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import as_i32, f32_at, f64_at, i32_at, i64_at
from renderers.shading.attribute_planes import AHEAD as RUNS
from renderers.shading.attribute_planes import look_up
from renderers.shading.bilinear import PART, WHOLE, show_located
from renderers.shading.layout import (
    A_LIGHT,
    A_PLACE,
    A_SHARE,
    A_UV0,
    HAS_NORMALS,
    II_VERTICES,
    P_MIRROR,
    P_NORMAL,
    S_TEXTURE_FLOATS,
    S_TEXTURES,
    V_COLUMNS,
)
from renderers.shading.material import reach, turned
from renderers.shading.materials import MF_BASE, MI_BASE, MI_UNLIT
from renderers.shading.output_merge import packed
from renderers.shading.prefetch import look_ahead_of_runs
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
from renderers.shading.sampling import AS_STORED, FINE_BITS, bilinear, coordinates, nearest, parts, reduced
from renderers.shading.textures import TF_COLUMNS, TI_COLUMNS, TI_HEIGHT, TI_LINEAR, TI_WIDTH
from renderers.shading.uv_planes import eight_runs, eight_short_runs, find_runs, set_up_texels

LARGEST: Final = 1 << (30 - FINE_BITS)
"""Texels of a side from which on places among those of two images, with their fractions, do not fit into int32."""
SHORT: Final = 1.5
"""Pixels of a run, on average over a segment, up to which triangles are hardly seen in more than one row."""


@inlined
def _light(nx, ny, nz, facing):
    """What ``surface.light_phong`` multiplies colours by."""
    return vec.most(-(nz * reach(nx, ny, nz, facing)), vec.f32(0.0))


@inlined
def _line(base, slope, lanes, t):
    """A linear function of each lane's run."""
    return vec.permute(base, lanes) + vec.permute(slope, lanes) * t


@inner
def _together(ids, single, starts, batch, begin, end, unlike, base, slope, rows, stride):
    """Eight runs, every pixel within its triangle: A_PLACE and A_SHARE of the pixels ``begin .. end``.

    Args:
        single: whether every pixel is a run of its own.
        unlike, base, slope: see ``texel_planes.eight_runs``.
    """
    whole = as_i32(rows)
    begins = vec.load(starts, batch)
    zero, one = vec.f32(0.0), vec.f32(1.0)
    even = vec.bits(unlike > zero) == 0
    up_to = (vec.i32(2) << vec.iota()) - vec.i32(1)
    before = np.int64(-1)
    for x in range(begin, end, vec.LANES):
        column = vec.i32(x) + vec.iota()
        new = np.int64(255)
        if not single:
            new = vec.bits(vec.load(ids, x) != vec.load(ids, x - 1))
        run = vec.i32(before) + vec.count_bits(vec.i32(new) & up_to)
        before += vec.count_bits(new)
        t = vec.to_f32(column - vec.permute(begins, run))
        light, total = _line(base[0], slope[0], run, t), _line(base[3], slope[3], run, t)
        if even:
            depth = one / total
            light = light * depth
        else:
            nx, ny = _line(base[1], slope[1], run, t), _line(base[2], slope[2], run, t)
            alone = vec.permute(unlike, run) > zero
            length = vec.select(alone, vec.sqrt(nx * nx + ny * ny + light * light), one)
            # One division for both. What has no direction has no place then either, and is black anywhere.
            share = one / (total * length)
            depth = share * length
            light = light * vec.select(alone, share * total * vec.f32(WHOLE), depth)
        vec.store(whole, A_SHARE * stride + x, vec.to_i32(vec.most(light, zero)))
        vec.store(whole, A_PLACE * stride + x, vec.to_i32(_line(base[4], slope[4], run, t) * depth))
        vec.store(whole, (A_PLACE + 1) * stride + x, vec.to_i32(_line(base[5], slope[5], run, t) * depth))


@inner
def _alone(maps, vertices, smooth, lit, starts, batch, picked, rows, stride, scratch):
    """Texture coordinates and, if ``lit``, light of runs that are set up, into the rows A_UV0 and A_LIGHT.

    Args:
        picked: bits of those runs of the eight that are wanted.
    """
    base, slope = f64_at(scratch + 64 * R_BASE), f64_at(scratch + 64 * R_SLOPE)
    whole, values = i32_at(scratch), f32_at(scratch)
    lane = vec.to_f32(vec.iota())
    while picked != 0:
        k = vec.lowest_bit(picked)
        picked &= picked - 1
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
def _by_itself(integers, floats, lit, rows, stride, begin, end):
    """What the rows A_UV0 and A_LIGHT say of one run, as ``_together`` writes it, and nothing behind the run."""
    whole, light = as_i32(rows), vec.f32(1.0)
    for x in range(begin, end, vec.LANES):
        u, v = coordinates(integers, floats, rows, A_UV0 * stride + x, stride)
        u, v = reduced(integers, u, v)
        inside = vec.iota() < vec.i32(end - x)
        if lit:
            light = vec.load(rows, A_LIGHT * stride + x)
        _blend(whole, A_PLACE * stride + x, inside, parts(u))
        _blend(whole, (A_PLACE + 1) * stride + x, inside, parts(v))
        _blend(whole, A_SHARE * stride + x, inside, vec.to_i32(light * vec.f32(WHOLE)))


@inlined
def _blend(rows, at, inside, value):
    vec.store(rows, at, vec.select(inside, value, vec.load_again(rows, at)))


@inner
def _resolve(
    columns, m, maps, lens, y, places, first, smooth, lit, ids, starts, batch, count, picked, rows, stride, scratch
):
    """``_alone`` for the ``picked`` of at most eight runs."""
    set_up(columns, m, maps[P_MIRROR], lens, y, places, first, ids, starts, batch, count, smooth, scratch)
    _alone(maps, f32_at(columns[II_VERTICES]), smooth, lit, starts, batch, picked, rows, stride, scratch)


@inlined
def _pixels(mf, lit, rgba, rows, at):
    """Eight packed pixels."""
    r, g, b = vec.f32(mf[MF_BASE]) * rgba[0], vec.f32(mf[MF_BASE + 1]) * rgba[1], vec.f32(mf[MF_BASE + 2]) * rgba[2]
    if lit:
        light = vec.load(rows, at)
        r, g, b = r * light, g * light, b * light
    return packed(r, g, b)


@inner
def _show(integers, floats, mf, lit, rows, stride, begin, end, line):
    """Sample, light and pack what the rows A_UV0 and A_LIGHT say."""
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
    scratch, memory,
):  # fmt: skip
    """Pixels of the runs ``run .. last_run`` of one instance's triangles, whose colour is the material's factor times a
    texture with coordinates of the first set.

    Args:
        columns .. scratch: as for ``resolve.resolve_triangles``. maps, mi, mf: the instance's and the material's rows.
        line: pointer to the row's packed pixels; up to seven behind the last run are overwritten.
        memory: see ``planes.forget``.
    """
    lit, smooth = mi[MI_UNLIT] == 0, (has & HAS_NORMALS) != 0
    integers = i64_at(job[S_TEXTURES] + 8 * TI_COLUMNS * mi[MI_BASE])
    floats = f32_at(job[S_TEXTURE_FLOATS] + 4 * TF_COLUMNS * mi[MI_BASE])
    modest = True
    for k in range(3):
        modest = modest and mf[MF_BASE + k] >= 0.0 and mf[MF_BASE + k] <= 1.0
    large = integers[TI_WIDTH] >= LARGEST or integers[TI_HEIGHT] >= LARGEST
    if not modest or large or integers[TI_LINEAR] == 0:
        for batch in range(run, last_run, vec.LANES):
            count = min(last_run - batch, vec.LANES)
            if many:
                look_ahead_of_runs(columns, first, ids, starts, batch, last_run)
            _resolve(
                columns, m, maps, lens, y, places, first, smooth, lit, ids, starts, batch, count, (1 << count) - 1,
                rows, stride, scratch,
            )  # fmt: skip
        _show(integers, floats, mf, lit, rows, stride, np.int64(starts[run]), np.int64(starts[last_run]), line)
        return
    shown = np.int64(starts[run])
    short = np.int64(starts[last_run]) - shown <= SHORT * (last_run - run)
    for part in range(run, last_run, RUNS):
        stop = min(part + RUNS, last_run)
        if not short:
            missing = look_up(ids, starts, places, part, stop, memory)
            for k in range(0, missing, vec.LANES):
                set_up_texels(columns, m, maps, lens, y, first, many, smooth, lit, integers, floats, memory, k, missing)
            find_runs(ids, starts, y, places, part, stop, rows, stride, memory)
        for batch in range(part, stop, vec.LANES):
            count = min(stop - batch, vec.LANES)
            begin, end = np.int64(starts[batch]), np.int64(starts[batch + count])
            if short:
                if many:
                    look_ahead_of_runs(columns, first, ids, starts, batch, last_run)
                set_up(columns, m, maps[P_MIRROR], lens, y, places, first, ids, starts, batch, count, smooth, scratch)
                good, unlike, base, slope = eight_short_runs(
                    columns, maps, smooth, lit, integers, floats, starts, batch, scratch
                )
            else:
                good, unlike, base, slope = eight_runs(starts, batch, part, rows, stride, memory)
            _together(ids, places != 0, starts, batch, begin, end, unlike, base, slope, rows, stride)
            bad = (255 ^ good) & ((1 << count) - 1)
            if bad != 0:
                _resolve(
                    columns, m, maps, lens, y, places, first, smooth, lit, ids, starts, batch, count, bad, rows,
                    stride, scratch,
                )  # fmt: skip
            while bad != 0:
                k = batch + vec.lowest_bit(bad)
                bad &= bad - 1
                _by_itself(integers, floats, lit, rows, stride, np.int64(starts[k]), np.int64(starts[k + 1]))
        end = np.int64(starts[stop])
        if stop < last_run:  # what is beyond the last of eights waits for its neighbours
            end = shown + (end - shown) // vec.LANES * vec.LANES
        for x in range(shown, end, PART):
            show_located(integers, mf, rows, stride, x, min(x + PART, end), line)
        shown = max(end, shown)
