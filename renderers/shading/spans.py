"""Spans: neighbouring pixels of a row that see one primitive. Segments: neighbouring spans of one instance."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import i32_at, i64_at
from renderers.shading.layout import (
    A_ROWS,
    G_COLUMNS,
    G_ELEMENTS,
    G_EXTRAS,
    G_FIRST,
    G_HAS,
    G_LANES,
    G_LENS,
    G_MAPS,
    G_MASKS,
    G_MATERIAL_FLOATS,
    G_MATERIAL_INTEGERS,
    G_PIXELS,
    G_POINTS,
    G_RECORDS,
    G_SPANS,
    G_STARTS,
    G_SURFACE,
    G_TOPOLOGY,
    G_VALUES,
    G_VERTICES,
    G_Y,
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    II_COLUMNS,
    II_ELEMENTS,
    II_EXTRAS,
    II_HAS,
    II_MATERIAL,
    II_TOPOLOGY,
    II_VERTICES,
    P_COLUMNS,
    PART,
    S_FIRST,
    S_INSTANCES,
    S_LANES,
    S_LENS,
    S_MAPS,
    S_MATERIAL_FLOATS,
    S_MATERIAL_INTEGERS,
    S_POINTS,
    SPAN_ROOM,
    STRIDE,
    T_ROWS,
)
from renderers.shading.materials import MF_COLUMNS, MI_COLUMNS, MI_NORMAL, MI_UNLIT, MI_UV

_NO_RECORD: Final = -(2**31)
"""Differs from every record and from -1."""
_HIGHEST_BIT: Final = -(2**63)


def _lane_tables() -> NDArray[np.int32]:
    starts = np.arange(128)[:, None] >> np.arange(7) & 1
    return np.ascontiguousarray(np.pad(np.cumsum(starts, axis=1), ((0, 0), (1, 0))), np.int32)


LANE_TABLES: Final = _lane_tables()
"""(128, 8) int32: for each set of pixels 1 to 7 at which spans begin, by its bits, the number of spans that began after
pixel 0."""


@inlined
def row_memory(width):
    """Values of 8 bytes that shading a row of ``width`` pixels needs, see ``begin_rows``."""
    ids, starts = width + 64 + 2 * vec.LANES, width + width // 64 + 4 * vec.LANES
    return G_VALUES + width // 64 + 3 + (ids + 2 * starts + T_ROWS * SPAN_ROOM + A_ROWS * STRIDE) // 2 + 1


@device_function
def begin_rows(job, memory, width, surface):
    """Lay out the working memory of rows of at most ``width`` pixels: ``row_memory`` int64 at this address.

    Returns:
        Pointer to the G_VALUES int64 of a segment, and to room for the records of a row.
    """
    segment = i64_at(memory)
    at = memory + 8 * G_VALUES
    segment[G_LENS], segment[G_LANES], segment[G_SURFACE] = job[S_LENS], job[S_LANES], surface
    segment[G_MASKS] = at
    at += 8 * (width // 64 + 3)
    segment[G_STARTS] = at
    at += 4 * (width + width // 64 + 4 * vec.LANES)
    segment[G_RECORDS] = at
    at += 4 * (width + width // 64 + 4 * vec.LANES)
    segment[G_SPANS] = at
    at += 4 * T_ROWS * SPAN_ROOM
    segment[G_PIXELS] = at
    at += 4 * A_ROWS * STRIDE
    return segment, i32_at(at + 4 * vec.LANES)


@device_function
def find_spans(segment, y, columns, records, width, ids):
    """Find the spans of a row.

    A span also begins at every PART-th pixel: parts of a segment are whole spans, and float32 is exact along them.

    Args:
        y: row of the image. columns: see G_COLUMNS; pixels of such a row are spans of their own.
        records: pointer to the records of ``width`` pixels, -1 for none.
        ids: pointer to room for ``width`` + 64 int32, and eight before it.

    Returns:
        Number of spans. G_STARTS has the first pixel of each and then ``width``.
    """
    segment[G_Y], segment[G_COLUMNS] = y, columns
    masks, starts, spans = i64_at(segment[G_MASKS]), i32_at(segment[G_STARTS]), i32_at(segment[G_RECORDS])
    for x in range(width):
        ids[x] = records[x]
    ids[-1] = _NO_RECORD
    for x in range(width, width + 64 + vec.LANES, vec.LANES):
        vec.store(ids, x, vec.i32(_NO_RECORD))
    count = np.int64(0)
    for x in range(0, width, 64):
        mask = np.int64(-1)
        if columns == 0:
            mask = np.int64(x % PART == 0)
            for k in range(0, 64, vec.LANES):
                mask |= vec.movemask(vec.load(ids, x + k) != vec.load(ids, x + k - 1)) << k
        masks[x >> 6] = mask
        if width - x < 64:
            mask &= (np.int64(1) << (width - x)) - 1
        bits = vec.count_bits(mask)
        # Eight at a time: the number of spans is unpredictable.
        for group in range(count, count + bits, vec.LANES):
            for k in range(vec.LANES):
                starts[group + k] = x + vec.lowest_bit(mask | _HIGHEST_BIT)
                mask &= mask - 1
            vec.store(spans, group, vec.gather(ids, vec.load(starts, group)))
        count += bits
    masks[(width >> 6) + ((width & 63) != 0)] = -1
    vec.store(starts, count, vec.i32(width))
    return count


@inlined
def next_part(segment, span, begin, end):
    """Last pixel and last span of the part of a segment that is shaded at a time, both exclusive.

    Args:
        span: first span of the part. begin: its first pixel. end: last pixel of the segment.
    """
    stop = min(end, (begin & -PART) + PART)
    masks = i64_at(segment[G_MASKS])
    for x in range(begin & -64, stop, 64):
        mask = masks[x >> 6]
        if x < begin:
            mask &= np.int64(-1) << (begin - x)
        if stop - x < 64:
            mask &= (np.int64(1) << (stop - x)) - 1
        span += vec.count_bits(mask)
    return stop, span


@device_function
def segment_end(segment, span, count, first, last):
    """First span from ``span`` on whose record is outside ``first .. last``."""
    records, low, high = i32_at(segment[G_RECORDS]), vec.i32(first), vec.i32(last)
    while span < count:
        here = vec.load(records, span)
        others = vec.movemask((here < low) | (here >= high))
        if others != 0:
            return min(span + vec.lowest_bit(others), count)
        span += vec.LANES
    return np.int64(count)


@device_function
def select_instance(job, segment, instance):
    """Fill the columns of a segment from G_FIRST on, G_LENS and G_SURFACE excepted."""
    columns = i64_at(job[S_INSTANCES] + 8 * II_COLUMNS * instance)
    material = columns[II_MATERIAL]
    segment[G_FIRST] = i64_at(job[S_FIRST])[instance]
    segment[G_TOPOLOGY], segment[G_ELEMENTS] = columns[II_TOPOLOGY], columns[II_ELEMENTS]
    segment[G_VERTICES], segment[G_EXTRAS] = columns[II_VERTICES], columns[II_EXTRAS]
    segment[G_POINTS] = job[S_POINTS] + 8 * 16 * instance
    segment[G_MAPS] = job[S_MAPS] + 4 * P_COLUMNS * instance
    segment[G_MATERIAL_INTEGERS] = job[S_MATERIAL_INTEGERS] + 8 * MI_COLUMNS * material
    segment[G_MATERIAL_FLOATS] = job[S_MATERIAL_FLOATS] + 4 * MF_COLUMNS * material
    mi = i64_at(segment[G_MATERIAL_INTEGERS])
    wanted = HAS_COLORS
    if mi[MI_UNLIT] == 0:
        wanted |= HAS_NORMALS
    if mi[MI_NORMAL] >= 0:
        wanted |= HAS_TANGENTS
    if mi[MI_UV] & 1:
        wanted |= HAS_UV0
    if mi[MI_UV] & 2:
        wanted |= HAS_UV1
    segment[G_HAS] = columns[II_HAS] & wanted
