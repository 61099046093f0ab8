"""Rows of a picture: runs of equal record are resolved, segments of equal instance are shaded."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers import simd as vec
from renderers.jit import kernel
from renderers.linked import inner
from renderers.pointers import f32_at, f64_at, i32_at, i64_at
from renderers.records import instance_of
from renderers.shading.compose import DIRECT, GATHER, gather, packed, put_line, write_background, write_under
from renderers.shading.head import fits
from renderers.shading.layout import (
    A_ROWS,
    A_UV0,
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    II_COLUMNS,
    II_HAS,
    II_MATERIAL,
    II_TOPOLOGY,
    P_COLUMNS,
    P_MIRROR,
    S_COUNT,
    S_COUNTS,
    S_FIRST,
    S_INSTANCES,
    S_LENS,
    S_MAPS,
    S_MATERIAL_FLOATS,
    S_MATERIAL_INTEGERS,
    S_MODE,
    S_PBR,
    S_PLACES,
    S_POINTS,
    S_STRIDE,
    S_WIDTH,
)
from renderers.shading.materials import (
    MF_BASE,
    MF_COLUMNS,
    MF_CUTOFF,
    MI_ALPHA_MODE,
    MI_BASE,
    MI_COLUMNS,
    MI_NORMAL,
    MI_UNLIT,
    MI_UV,
)
from renderers.shading.plain import fill, show_plain
from renderers.shading.plain_pbr import PART, light_up, show_plain_pbr
from renderers.shading.planes import MEMORY_VALUES, forget
from renderers.shading.resolve import (
    SCRATCH_VALUES,
    changes,
    count_runs,
    resolve_strokes,
    resolve_triangles,
    run_starts,
    single_runs,
)
from renderers.shading.surface import row_schlick, shade
from renderers.shading.textured import show_textured
from renderers.shading.tiny import E_VALUES, look_from, show_tiny

TINY_RUNS: Final = 2
"""Pixels of a run, on average over a segment, up to which every pixel is solved by itself."""
MANY: Final = 50_000
"""Triangles of a mesh whose records, some 30 bytes each, fill most of a second-level cache."""
_OUTSIDE: Final = -(2**31)
"""No record: what lies beside a row."""


@inner
def _extent(ids, x, width, first, last):
    """The first pixel from ``x`` on that sees no record of ``first .. last``."""
    low, high = vec.i32(first), vec.i32(last)
    while x < width:
        records = vec.load(ids, x)
        others = 255 ^ vec.bits((records >= low) & (records < high))
        if others != 0:
            return min(x + vec.lowest_bit(others), width)
        x += vec.LANES
    return np.int64(width)


@inner
def _segment(
    job, y, places, instance, first, ids, masks, starts, begin, end, rows, stride, line, scratch, memory, steep
):  # fmt: skip
    """Resolve and shade the pixels ``begin .. end``, which all see one instance.

    Args:
        places: address of the columns of the picture that the row's records belong to; 0: where they lie.
        steep: see ``surface.row_schlick``.
    """
    columns = i64_at(job[S_INSTANCES] + 8 * II_COLUMNS * instance)
    material = columns[II_MATERIAL]
    mi = i64_at(job[S_MATERIAL_INTEGERS] + 8 * MI_COLUMNS * material)
    mf = f32_at(job[S_MATERIAL_FLOATS] + 4 * MF_COLUMNS * material)
    maps = f32_at(job[S_MAPS] + 4 * P_COLUMNS * instance)
    points = f64_at(job[S_POINTS] + 8 * 16 * instance)
    lens = f64_at(job[S_LENS])
    topology = columns[II_TOPOLOGY]
    many = i64_at(job[S_FIRST])[instance + 1] - first > MANY
    wanted = HAS_COLORS
    if mi[MI_UNLIT] == 0:
        wanted |= HAS_NORMALS
    if mi[MI_NORMAL] >= 0:
        wanted |= HAS_TANGENTS
    if mi[MI_UV] & 1:
        wanted |= HAS_UV0
    if mi[MI_UV] & 2:
        wanted |= HAS_UV1
    has = columns[II_HAS] & wanted
    smooth = (has & HAS_NORMALS) != 0
    tiny = places != 0 or end - begin <= TINY_RUNS * count_runs(masks, begin, end)
    eye, spare = f64_at(scratch), i32_at(scratch + 8 * E_VALUES)
    if job[S_MODE] == DIRECT and job[S_PBR] == 0 and mi[MI_BASE] < 0 and not has & HAS_COLORS:
        if mi[MI_UNLIT] != 0:
            fill(line, begin, end, packed(vec.f32(mf[MF_BASE]), vec.f32(mf[MF_BASE + 1]), vec.f32(mf[MF_BASE + 2])))
            return
        if topology == 3 and fits(mf):
            if tiny and look_from(points, maps, lens, y, eye):
                show_tiny(
                    columns, maps, places, first, many, smooth, mf, ids, begin, end, True, rows, stride, line, eye,
                    spare,
                )  # fmt: skip
                return
            runs = run_starts(masks, begin, end, starts) if places == 0 else single_runs(begin, end, starts)
            show_plain(
                columns, points, maps, lens, y, places, first, many, smooth, mf, ids, starts, 0, runs, line, memory
            )  # fmt: skip
            return
    factors = topology == 3 and job[S_MODE] == DIRECT and wanted == HAS_NORMALS | HAS_COLORS and not has & HAS_COLORS
    if factors and tiny and job[S_PBR] != 0 and look_from(points, maps, lens, y, eye):
        show_tiny(
            columns, maps, places, first, many, smooth, mf, ids, begin, end, False, rows, stride, line, eye, spare
        )  # fmt: skip
        light_up(job, has, mi, mf, maps, y, places, rows, stride, begin, end, line, steep)
        return
    runs = run_starts(masks, begin, end, starts) if places == 0 else single_runs(begin, end, starts)
    if factors and smooth and places == 0 and job[S_PBR] != 0:
        show_plain_pbr(
            job, columns, points, maps, lens, y, first, many, mi, mf, ids, starts, runs, rows, stride, line, memory,
            steep,
        )  # fmt: skip
        return
    if (
        topology == 3
        and job[S_MODE] == DIRECT
        and job[S_PBR] == 0
        and mi[MI_BASE] >= 0
        and has & ~HAS_NORMALS == HAS_UV0
    ):
        show_textured(
            job, columns, points, maps, lens, y, places, first, many, has, mi, mf, ids, starts, 0, runs, rows,
            stride, line, scratch, memory,
        )  # fmt: skip
        return
    for which in range(2):
        missing = HAS_UV0 << which
        if wanted & missing and not has & missing:
            _clear_coordinates(rows, stride, begin, end, which)
    if topology == 3:
        mirror = maps[P_MIRROR]
        resolve_triangles(
            columns,
            points,
            mirror,
            lens,
            y,
            places,
            first,
            many,
            has,
            ids,
            starts,
            0,
            runs,
            rows,
            stride,
            scratch,
        )
    else:
        resolve_strokes(columns, topology, points, lens, y, places, first, has, ids, starts, 0, runs, rows, stride)
    bumpy = mi[MI_NORMAL] >= 0 and (has & HAS_TANGENTS) != 0
    for part in range(begin, end, PART):
        shade(job, has, mi, mf, maps, y, places, bumpy, rows, stride, part, min(part + PART, end), line, steep)
    mode = job[S_MODE]
    if mode == GATHER:
        gather(job, mi[MI_ALPHA_MODE], mf[MF_CUTOFF], y, begin, end, rows, stride)
    elif mode != DIRECT:
        write_under(job, y, begin, end, rows, stride, line)


@inner
def _clear_coordinates(rows, stride, begin, end, which):
    """Coordinates that the mesh lacks are 0."""
    for row in range(A_UV0 + 2 * which, A_UV0 + 2 * which + 2):
        for x in range(begin, end, vec.LANES):
            vec.store(rows, row * stride + x, vec.f32(0.0))


@inner
def _row(job, seen, y, ids, masks, starts, rows, stride, line, scratch, memory, hint):
    """One row; returns the instance seen last, a hint for the next one."""
    width, places = job[S_WIDTH], np.int64(0)
    if job[S_PLACES] != 0:
        width, places = np.int64(i32_at(job[S_COUNTS])[y]), job[S_PLACES] + 4 * y * job[S_STRIDE]
    seen = i32_at(seen + 4 * y * job[S_STRIDE])
    for x in range(width):
        ids[x] = seen[x]
    first_record = i64_at(job[S_FIRST])
    if places == 0:
        changes(ids, width, masks)
    steep = row_schlick(job, y, places, width) if job[S_PBR] != 0 and width > 0 else np.float32(0.0)
    begin = np.int64(0)
    while begin < width:
        record = np.int64(ids[begin])
        if record < 0:
            end = _extent(ids, begin, width, np.int64(-1), np.int64(0))
            write_background(job, y, begin, end, line)
        else:
            hint = instance_of(first_record, job[S_COUNT], record, hint)
            first = first_record[hint]
            end = _extent(ids, begin, width, first, first_record[hint + 1])
            _segment(
                job, y, places, hint, first, ids, masks, starts, begin, end, rows, stride, line, scratch, memory, steep
            )  # fmt: skip
        begin = end
    if job[S_MODE] != GATHER:
        put_line(job, y, width, line)
    return hint


@kernel("void(int64, int64, int64, int64)")
def shade_rows(job_at, ids_at, row_begin, row_end):
    """Shades the rows ``row_begin .. row_end - 1``; every row is independent of all others.

    Args:
        job_at: address of S_COLUMNS int64.
        ids_at: address of (H, S_STRIDE) int32, the record of every pixel, -1 for none.
    """
    job = i64_at(job_at)
    width = job[S_WIDTH]
    pad = vec.LANES
    stride = width + 2 * pad
    own_ids = np.empty(width + pad + 64, np.int32)
    own_masks = np.empty(width // 64 + 2, np.int64)
    own_starts = np.empty(width + 2 * pad, np.int32)
    own_rows = np.empty(A_ROWS * stride, np.float32)
    own_line = np.empty(width + 2 * pad, np.int32)
    own_scratch = np.empty(SCRATCH_VALUES, np.float32)
    own_memory = np.empty(MEMORY_VALUES, np.float32)
    own_ids[:pad] = _OUTSIDE
    own_ids[pad + width :] = _OUTSIDE
    ids = i32_at(np.int64(own_ids.ctypes.data) + 4 * pad)
    masks = i64_at(np.int64(own_masks.ctypes.data))
    starts = i32_at(np.int64(own_starts.ctypes.data))
    rows = f32_at(np.int64(own_rows.ctypes.data))
    line = i32_at(np.int64(own_line.ctypes.data))
    scratch = np.int64(own_scratch.ctypes.data)
    memory = np.int64(own_memory.ctypes.data)
    forget(memory)
    hint = np.int64(0)
    for y in range(row_begin, row_end):
        hint = _row(job, ids_at, y, ids, masks, starts, rows, stride, line, scratch, memory, hint)
    # The pointers above do not keep the arrays alive.
    own_ids[0] = own_starts[0] = own_line[0] = 0
    own_masks[0] = 0
    own_rows[0] = own_scratch[0] = 0.0
    own_memory[0] = 0.0
