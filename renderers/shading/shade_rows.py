"""Rows of a picture: runs of equal record are resolved, segments of equal instance are shaded."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.jit import kernel
from renderers.compiler.pointers import f32_at, f64_at, i32_at, i64_at
from renderers.shading.attribute_planes import MEMORY_VALUES, forget
from renderers.shading.headlight import fits
from renderers.shading.layout import (
    A_ROWS,
    A_UV0,
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    II_HAS,
    II_TOPOLOGY,
    P_COLUMNS,
    P_MIRROR,
    S_COUNTS,
    S_FIRST,
    S_LENS,
    S_MAPS,
    S_MODE,
    S_PBR,
    S_PLACES,
    S_POINTS,
    S_STRIDE,
    S_WIDTH,
)
from renderers.shading.material import row_schlick, shade
from renderers.shading.materials import (
    MF_BASE,
    MF_CUTOFF,
    MI_ALPHA_MODE,
    MI_BASE,
    MI_NORMAL,
    MI_UNLIT,
    MI_UV,
)
from renderers.shading.output_merge import DIRECT, GATHER, gather, packed, put_line, write_background, write_under
from renderers.shading.pixel_sized_triangles import E_VALUES, look_from, show_tiny
from renderers.shading.resolve import SCRATCH_VALUES, resolve_strokes, resolve_triangles, run_starts, single_runs
from renderers.shading.span_attributes import B_ROWS, put_beside
from renderers.shading.spans import (
    G_COLUMNS,
    G_INSTANCE,
    G_LAST_RUN,
    G_PLANES,
    G_RUN,
    K_PLANES,
    K_TAKEN,
    MOST,
    TINY_RUNS,
    find_places,
    find_runs,
    find_segments,
    forget_places,
    instance_at,
    memory_values,
    set_up_waiting,
)
from renderers.shading.textured_spans import show_textured
from renderers.shading.uniform_pbr import PART, light_up, put_cosines_of_runs, show_plain_pbr
from renderers.shading.uniform_spans import fill, show_plain

MANY: Final = 50_000
"""Triangles of a mesh whose records, some 30 bytes each, fill most of a second-level cache."""
_OUTSIDE: Final = -(2**31)
"""No record: what lies beside a row."""


@inner
def _segment(
    job, y, places, instance, ids, masks, starts, begin, end, tiny, rows, stride, line, scratch, memory, steep
):  # fmt: skip
    """Resolve and shade the pixels ``begin .. end``, which all see one instance.

    Args:
        places: address of the columns of the picture that the row's records belong to; 0: where they lie.
        tiny: whether its runs are few pixels long. steep: see ``surface.row_schlick``.
    """
    columns, mi, mf = instance_at(job, instance)
    first = i64_at(job[S_FIRST])[instance]
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
    eye, spare = f64_at(scratch), i32_at(scratch + 8 * E_VALUES)
    if job[S_MODE] == DIRECT and job[S_PBR] == 0 and mi[MI_BASE] < 0 and not has & HAS_COLORS:
        if mi[MI_UNLIT] != 0:
            fill(line, begin, end, packed(vec.f32(mf[MF_BASE]), vec.f32(mf[MF_BASE + 1]), vec.f32(mf[MF_BASE + 2])))
            return
        if topology == 3 and tiny and fits(mf) and look_from(points, maps, lens, y, eye):
            show_tiny(
                columns, maps, places, first, many, smooth, mf, ids, begin, end, True, rows, stride, line, eye, spare
            )  # fmt: skip
            return
    factors = topology == 3 and job[S_MODE] == DIRECT and wanted == HAS_NORMALS | HAS_COLORS and not has & HAS_COLORS
    if factors and tiny and job[S_PBR] != 0 and look_from(points, maps, lens, y, eye):
        show_tiny(
            columns, maps, places, first, many, smooth, mf, ids, begin, end, False, rows, stride, line, eye, spare
        )  # fmt: skip
        light_up(job, mf, lens, y, places, rows, stride, begin, end, line, steep)
        return
    runs = run_starts(masks, begin, end, starts) if places == 0 else single_runs(begin, end, starts)
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
def _take_row(seen, width, ids):
    """Copy a row's records to where they lie between what is nowhere within."""
    for x in range(width):
        ids[x] = seen[x]
    for x in range(0, 64 + vec.LANES, vec.LANES):
        vec.store(ids, width + x, vec.i32(_OUTSIDE))


@inlined
def _width(job, y):
    """Records of a row, and the address of the columns of the picture that they belong to; 0: where they lie."""
    if job[S_PLACES] == 0:
        return job[S_WIDTH], np.int64(0)
    return np.int64(i32_at(job[S_COUNTS])[y]), job[S_PLACES] + 4 * y * job[S_STRIDE]


@inner
def _row(
    job, y, seen, ids, masks, whole_starts, records, spots, segments, begin, end, beside, starts, rows, stride, line,
    scratch, memory, planes, steep,
):  # fmt: skip
    """One row, of which the segments ``begin .. end`` are known; ``spots``: see ``runs.find_places``."""
    width, places = _width(job, y)
    lens = f64_at(job[S_LENS])
    taken, prepared, uniform = False, False, False
    flat, stray, known = np.int64(0), np.int64(0), np.int64(0)
    for number in range(begin, end):
        segment = number * G_COLUMNS
        instance = np.int64(segments[segment + G_INSTANCE])
        run, last_run = np.int64(segments[segment + G_RUN]), np.int64(segments[segment + G_LAST_RUN])
        x, last_x = np.int64(whole_starts[run]), np.int64(whole_starts[last_run])
        if instance < 0:
            write_background(job, y, x, last_x, line)
        elif segments[segment + G_PLANES] != 0:
            if not prepared:
                runs = np.int64(segments[(end - 1) * G_COLUMNS + G_LAST_RUN])
                uniform = put_beside(y, spots, planes, whole_starts, runs, beside, stride)
                prepared = True
            columns, _, mf = instance_at(job, instance)
            maps, first = f32_at(job[S_MAPS] + 4 * P_COLUMNS * instance), i64_at(job[S_FIRST])[instance]
            if job[S_PBR] != 0:
                if known <= run:
                    following = number + 1
                    while following < end and segments[following * G_COLUMNS + G_PLANES] != 0:
                        following += 1
                    known = np.int64(segments[(following - 1) * G_COLUMNS + G_LAST_RUN])
                    put_cosines_of_runs(lens, y, whole_starts, run, known, masks, beside, stride, rows, stride)
                stray = show_plain_pbr(
                    job, columns, maps, lens, y, first, mf, records, whole_starts, run, last_run, beside, stride,
                    stray, rows, stride, line, steep,
                )  # fmt: skip
            else:
                smooth = columns[II_HAS] & HAS_NORMALS != 0
                flat, stray = show_plain(
                    columns, maps, first, smooth, mf, records, whole_starts, run, last_run, masks, beside, stride,
                    uniform, flat, stray, line,
                )  # fmt: skip
        else:
            if not taken:
                _take_row(seen, width, ids)
                taken = True
            tiny = places != 0 or last_x - x <= TINY_RUNS * (last_run - run)
            _segment(
                job, y, places, instance, ids, masks, starts, x, last_x, tiny, rows, stride, line, scratch, memory,
                steep,
            )  # fmt: skip
    if job[S_MODE] != GATHER:
        put_line(job, y, width, line)


@kernel("void(int64, int64, int64, int64)")
def shade_rows(job_at, ids_at, row_begin, row_end):
    """Shades the rows ``row_begin .. row_end - 1``, a band at most; they do not depend on any others.

    Args:
        job_at: address of S_COLUMNS int64.
        ids_at: address of (H, S_STRIDE) int32, the record of every pixel, -1 for none.
    """
    job = i64_at(job_at)
    width, height = job[S_WIDTH], row_end - row_begin
    pad = vec.LANES
    stride = width + 2 * pad
    words = width // 64 + 3
    own_ids = np.empty(width + 2 * pad + 64, np.int32)
    own_masks = np.empty(words * height, np.int64)
    own_runs = np.empty((3 + G_COLUMNS) * stride * height, np.int32)
    own_segments = np.empty(3 * height + 2, np.int64)
    own_beside = np.empty(B_ROWS * stride, np.float32)
    own_starts = np.empty(width + 2 * pad, np.int32)
    own_rows = np.empty(A_ROWS * stride, np.float32)
    own_line = np.empty(width + 2 * pad, np.int32)
    own_scratch = np.empty(SCRATCH_VALUES, np.float32)
    own_memory = np.empty(MEMORY_VALUES, np.float32)
    own_places = np.empty(memory_values(width), np.float32)
    own_ids[:] = _OUTSIDE
    ids = i32_at(np.int64(own_ids.ctypes.data) + 4 * pad)
    masks = np.int64(own_masks.ctypes.data)
    runs_at, room = np.int64(own_runs.ctypes.data), 4 * stride * height
    segments = i32_at(runs_at + 3 * room)
    of_rows = i64_at(np.int64(own_segments.ctypes.data))
    steeps = f32_at(np.int64(own_segments.ctypes.data) + 8 * (2 * height + 2))
    beside = np.int64(own_beside.ctypes.data)
    starts = i32_at(np.int64(own_starts.ctypes.data))
    rows = f32_at(np.int64(own_rows.ctypes.data))
    line = i32_at(np.int64(own_line.ctypes.data))
    scratch = np.int64(own_scratch.ctypes.data)
    memory = np.int64(own_memory.ctypes.data)
    places_at = np.int64(own_places.ctypes.data)
    planes = f32_at(places_at + 4 * K_PLANES)
    forget(memory)
    hint, top = np.int64(0), row_begin
    while top < row_end:
        forget_places(places_at)
        run, segment, y = np.int64(0), np.int64(0), top
        while y < row_end and i32_at(places_at)[K_TAKEN] <= MOST:
            at = y - row_begin
            row_width, apart = _width(job, y)
            # Numbers of runs are counted from the row's first.
            row_starts, row_records = i32_at(runs_at + 4 * run), i32_at(runs_at + room + 4 * run)
            spots = i32_at(runs_at + 2 * room + 4 * run)
            row = i32_at(ids_at + 4 * y * job[S_STRIDE])
            count = find_runs(row, ids, row_width, apart != 0, i64_at(masks + 8 * words * at), row_starts, row_records)
            of_rows[2 * at], of_rows[2 * at + 1] = run, segment
            steeps[at] = row_schlick(job, y, apart, row_width) if job[S_PBR] != 0 and row_width > 0 else 0.0
            first = segment
            segment, with_planes, hint = find_segments(
                job, apart != 0, row_starts, row_records, count, segments, segment, hint
            )  # fmt: skip
            if with_planes:
                find_places(job, y, row_starts, row_records, spots, count, segments, first, places_at)
            run += count + pad
            y += 1
        of_rows[2 * (y - row_begin) + 1] = segment
        set_up_waiting(job, places_at)
        while top < y:
            at = top - row_begin
            row_width, apart = _width(job, top)
            seen = i32_at(ids_at + 4 * top * job[S_STRIDE])
            run = runs_at + 4 * of_rows[2 * at]
            _row(
                job, top, seen, ids, i64_at(masks + 8 * words * at), i32_at(run), i32_at(run + room),
                i32_at(run + 2 * room), segments, of_rows[2 * at + 1], of_rows[2 * at + 3], beside, starts, rows,
                stride, line, scratch, memory, planes, steeps[at],
            )  # fmt: skip
            top += 1
    # The pointers above do not keep the arrays alive.
    own_ids[0] = own_starts[0] = own_line[0] = own_runs[0] = 0
    own_masks[0] = own_segments[0] = 0
    own_rows[0] = own_scratch[0] = own_beside[0] = 0.0
    own_memory[0] = own_places[0] = 0.0
