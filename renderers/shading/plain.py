"""Segments of one colour under the head light, resolved and shaded in one go: nothing is stored between.

What most of a picture is: walls whose normals are the same at all three corners, of which one pixel is shaded and the
others are copies; triangles of a few pixels, of which eight are shaded at once, a lane each; and larger ones, shaded
eight pixels at a time. The arithmetic is that of ``resolve`` and ``surface``, to the last bit.
"""

from __future__ import annotations

from typing import Final

from numba import njit

from renderers import simd as vec
from renderers.pointers import f32_at, f64_at, i32_at
from renderers.shading.compose import packed
from renderers.shading.layout import II_VERTICES, P_NORMAL, V_COLUMNS, V_NORMAL
from renderers.shading.materials import MF_BASE
from renderers.shading.resolve import (
    R_BASE,
    R_FACING,
    R_FLAT,
    R_INDEX,
    R_PIXEL,
    R_SLOPE,
    further,
    look_ahead,
    set_up,
    weights,
    weights_of,
)
from renderers.shading.surface import reach, turned

SHORT: Final = 6
"""Runs up to this length are shaded a lane each: as many steps as the longest of eight has pixels."""


@njit(nogil=True, error_model="numpy", forceinline=True)
def _lit(mf, maps, smooth, nx, ny, nz, facing):  # type: ignore[no-untyped-def]
    """Packed pixels of eight normals, as ``surface.light_phong`` makes them."""
    if smooth:
        nx, ny, nz = turned(maps, P_NORMAL, nx, ny, nz)
    light = vec.most(-(nz * reach(nx, ny, nz, facing)), vec.f32(0.0))
    return packed(vec.f32(mf[MF_BASE]) * light, vec.f32(mf[MF_BASE + 1]) * light, vec.f32(mf[MF_BASE + 2]) * light)


@njit(nogil=True, error_model="numpy")
def fill(line, begin, end, pixels):  # type: ignore[no-untyped-def]
    """Eight equal packed pixels over a part of a row."""
    for x in range(begin, end, vec.LANES):
        vec.store(line, x, pixels)


@njit(nogil=True, error_model="numpy")
def _long(mf, maps, vertices, starts, batch, count, line, scratch):  # type: ignore[no-untyped-def]
    """Runs of any length of a mesh with normals, one after the other."""
    base, slope = f64_at(scratch + 64 * R_BASE), f64_at(scratch + 64 * R_SLOPE)
    whole, values = i32_at(scratch), f32_at(scratch)
    lane = vec.to_f32(vec.iota())
    for k in range(count):
        a = vec.load(vertices, whole[8 * R_INDEX + k] * V_COLUMNS)
        b = vec.load(vertices, whole[8 * R_INDEX + 8 + k] * V_COLUMNS) - a
        c = vec.load(vertices, whole[8 * R_INDEX + 16 + k] * V_COLUMNS) - a
        facing = vec.f32(values[8 * R_FACING + k])
        start = base[k], base[8 + k], base[16 + k]
        begin, end = starts[batch + k], starts[batch + k + 1]
        for x in range(begin, end, vec.LANES):
            w1, w2 = weights(start, slope, k, lane)
            if x + vec.LANES < end:
                start = further(base, slope, k, float(x + vec.LANES - begin))
            nx = vec.spread3(a) + (w1 * vec.spread3(b) + w2 * vec.spread3(c))
            ny = vec.spread4(a) + (w1 * vec.spread4(b) + w2 * vec.spread4(c))
            nz = vec.spread5(a) + (w1 * vec.spread5(b) + w2 * vec.spread5(c))
            vec.store(line, x, _lit(mf, maps, True, nx, ny, nz, facing))


@njit(nogil=True, error_model="numpy")
def _short(mf, maps, a, b, c, begins, lengths, spare, line, scratch):  # type: ignore[no-untyped-def]
    """Eight short runs, a lane each, from their corners' normals: those of the first and what the others add."""
    base, slope = f64_at(scratch + 64 * R_BASE), f64_at(scratch + 64 * R_SLOPE)
    start = vec.to_f32(vec.load(base, 0)), vec.to_f32(vec.load(base, 8)), vec.to_f32(vec.load(base, 16))
    step = vec.to_f32(vec.load(slope, 0)), vec.to_f32(vec.load(slope, 8)), vec.to_f32(vec.load(slope, 16))
    facing = vec.load(f32_at(scratch), 8 * R_FACING)
    pixel = 0
    used = lengths > vec.i32(0)
    while vec.bits(used) != 0:
        w1, w2 = weights_of(start, step, vec.f32(pixel))
        nx = a[0] + (w1 * b[0] + w2 * c[0])
        ny = a[1] + (w1 * b[1] + w2 * c[1])
        nz = a[2] + (w1 * b[2] + w2 * c[2])
        place = vec.select(used, begins + vec.i32(pixel), vec.i32(spare))
        vec.scatter(line, place, _lit(mf, maps, True, nx, ny, nz, facing))
        pixel += 1
        used = lengths > vec.i32(pixel)


@njit(nogil=True, error_model="numpy")
def show_plain(  # type: ignore[no-untyped-def]
    columns, m, mirror, lens, y, places, first, many, smooth, mf, maps, ids, starts, run, last_run, spare, line, scratch
):
    """Pixels of the runs ``run .. last_run`` of one instance's triangles, whose colour is the material's factor.

    Args:
        columns .. scratch: as for ``resolve.resolve_triangles``.
        smooth: whether the mesh has normals. mf, maps: the material's and the instance's rows of values.
        spare: index behind the row where ``line`` may be written, too.
        line: pointer to the row's packed pixels; up to seven behind the last run are overwritten.
    """
    vertices = f32_at(columns[II_VERTICES])
    whole, values = i32_at(scratch), f32_at(scratch)
    lane, none = vec.iota(), vec.f32(0.0)
    stride, normal = vec.i32(V_COLUMNS), vec.i32(V_NORMAL)
    for batch in range(run, last_run, vec.LANES):
        count = min(last_run - batch, vec.LANES)
        if many:
            look_ahead(columns, first, ids, starts, batch, last_run)
        set_up(columns, m, mirror, lens, y, places, first, ids, starts, batch, count, smooth, scratch)
        begins = vec.load(starts, batch)
        used = lane < vec.i32(count)
        lengths = vec.select(used, vec.load(starts, batch + 1) - begins, vec.i32(0))
        if not smooth:
            flat = vec.load(values, 8 * R_FLAT), vec.load(values, 8 * R_FLAT + 8), vec.load(values, 8 * R_FLAT + 16)
            vec.store(whole, 8 * R_PIXEL, _lit(mf, maps, False, flat[0], flat[1], flat[2], vec.f32(1.0)))
            uniform = True
        else:
            a = vec.load_triples(vertices, vec.load(whole, 8 * R_INDEX) * stride + normal)
            b = vec.load_triples(vertices, vec.load(whole, 8 * R_INDEX + 8) * stride + normal)
            c = vec.load_triples(vertices, vec.load(whole, 8 * R_INDEX + 16) * stride + normal)
            b = b[0] - a[0], b[1] - a[1], b[2] - a[2]
            c = c[0] - a[0], c[1] - a[1], c[2] - a[2]
            same = (b[0] == none) & (b[1] == none) & (b[2] == none)
            same = same & (c[0] == none) & (c[1] == none) & (c[2] == none)
            uniform = vec.bits(same & used) == vec.bits(used)
            if uniform:
                facing = vec.load(values, 8 * R_FACING)
                vec.store(whole, 8 * R_PIXEL, _lit(mf, maps, True, a[0], a[1], a[2], facing))
            elif vec.bits(lengths > vec.i32(SHORT)) == 0:
                _short(mf, maps, a, b, c, begins, lengths, spare, line, scratch)
            else:
                _long(mf, maps, vertices, starts, batch, count, line, scratch)
        if uniform:
            for k in range(count):
                fill(line, starts[batch + k], starts[batch + k + 1], vec.i32(whole[8 * R_PIXEL + k]))
