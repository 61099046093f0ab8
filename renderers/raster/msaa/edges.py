"""From a band's samples to what is shaded: one record for every pixel, and more for those at edges.

Triangles of one surface that meet within a pixel look the same there: where they share an edge and its normals, they
are shaded once, as one. What is left are silhouettes, creases and seams.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel
from renderers.compiler.pointers import as_f32, f64_at, i32_at, i64_at, u8_at
from renderers.msaa import (
    E_COLORS,
    E_COUNTS,
    E_FAR,
    E_IDS,
    E_MIXED,
    E_MIXES,
    E_NEAR,
    E_OWNERS,
    E_PLACES,
    E_RECORDS,
    E_ROOM,
    E_SAMPLE_IDS,
    E_SAMPLE_INV_Z,
    E_SLOTS,
    E_WEIGHTS,
)
from renderers.raster.layout import (
    J_COLUMNS,
    J_FAR,
    J_IDS,
    J_LANES,
    J_NEAR,
    J_OWNERS,
    J_SAMPLE_IDS,
    J_SAMPLE_INV_Z,
    J_SLOTS,
    J_STRIDE,
    J_WIDTH,
)
from renderers.raster.msaa.coverage import raster_samples
from renderers.raster.msaa.edge_merge import apart, joined, pairs_of
from renderers.raster.msaa.storage import MIXED
from renderers.shading.headlight.layout import (
    S_BACKGROUND,
    S_COLOR,
    S_COLUMNS,
    S_COUNTS,
    S_PLACES,
    S_STRIDE,
    S_WIDTH,
)

_REACH: Final = 32
"""Places that an entry moves to lie beside those of its own instance: rows are nearly sorted, and never take long."""
_LAST: Final = 2**31 - 1
"""More than any record."""


@inlined
def _add(records, marks, count, record, place, weight):
    """One more entry of a row, among the last ones in the order of records; returns how many there are then.

    Args:
        records: pointer to int32; _REACH values before the first are less than any record.
        marks: pointer to int32, column and weight of each.
    """
    end = count
    records[end] = _LAST
    new, mark = vec.i32(record), vec.i32((place << 8) | weight)
    for _ in range(_REACH // vec.LANES):
        old, before = vec.load(records, end - 7), vec.load(records, end - 8)
        old_marks, marks_before = vec.load(marks, end - 7), vec.load(marks, end - 8)
        moves, stays = before > new, old <= new
        vec.store(records, end - 7, vec.select(moves, before, vec.select(stays, old, new)))
        vec.store(marks, end - 7, vec.select(moves, marks_before, vec.select(stays, old_marks, mark)))
        end -= vec.LANES
        if records[end] <= record:
            return count + 1
    records[end], marks[end] = record, (place << 8) | weight
    return count + 1


@inlined
def _two(a, own, b, rest):
    """The one of two records with more samples, the first of equals, and its samples; then the other's."""
    if own >= rest:
        return a, own, b, rest
    return b, rest, a, own


@inner
def _three(job, x, a, n, b, m, c, o, records, marks, count, known):
    """``_several`` for three records ``a``, ``b`` and ``c`` with ``n``, ``m`` and ``o`` samples; one may be -1."""
    if a < 0 or b < 0 or c < 0:
        nothing = n
        if a < 0:
            a, n, b, m = b, m, c, o
        elif b < 0:
            nothing = m
            b, m = c, o
        else:
            nothing = o
        shown, own, other, rest = _two(a, n, b, m)
        if joined(job, a, b, known):
            return shown, own + rest, nothing, count
        return shown, own, nothing, _add(records, marks, count, other, x, rest)
    with_b, with_c = joined(job, a, b, known), joined(job, a, c, known)
    b_with_c = joined(job, b, c, known)
    if with_b and (with_c or b_with_c):
        shown, own, _, _ = _two(a, n, b, m)
        shown, own, _, _ = _two(shown, own, c, o)
        return shown, np.int64(vec.LANES), np.int64(0), count
    if with_b or with_c or b_with_c:
        if with_b:
            first, _, _, _ = _two(a, n, b, m)
            n, second, m = n + m, c, o
        elif with_c:
            first, _, _, _ = _two(a, n, c, o)
            n, second = n + o, b
        else:
            first = a
            second, _, _, _ = _two(b, m, c, o)
            m += o
        shown, own, other, rest = _two(first, n, second, m)
        return shown, own, np.int64(0), _add(records, marks, count, other, x, rest)
    shown, own, first, n = _two(a, n, b, m)
    shown, own, second, o = _two(shown, own, c, o)
    count = _add(records, marks, count, first, x, n)
    return shown, own, np.int64(0), _add(records, marks, count, second, x, o)


@inner
def _several(job, seen, x, records, marks, count, scratch, known):
    """A pixel whose samples see any number of records.

    Args:
        seen: i32x8. records, marks, count: see ``_add``. scratch: pointer to 40 int32. known: see ``joined``.

    Returns:
        The record that is shaded for the pixel, the samples it has, those that see nothing, and the new ``count``.
    """
    vec.store(scratch, 32, seen)
    # Each record once: scratch has its number, its samples, the group it is in, and the group's samples.
    remaining, found, nothing = np.int64(255), 0, np.int64(0)
    while remaining != 0:
        record = np.int64(scratch[32 + vec.lowest_bit(remaining)])
        same = vec.bits(seen == vec.i32(record))
        remaining &= ~same
        number = vec.count_bits(same)
        if record < 0:
            nothing = number
            continue
        group = np.int64(found)
        for k in range(found):
            if joined(job, np.int64(scratch[k]), record, known):
                group = np.int64(scratch[16 + k])
                break
        scratch[found], scratch[8 + found], scratch[16 + found] = record, number, group
        scratch[24 + found] = 0
        scratch[24 + group] += number
        found += 1
    best = 0
    for k in range(1, found):
        if scratch[24 + k] > scratch[24 + best]:
            best = k
    shown = np.int64(scratch[best])
    for each in range(found):
        if scratch[16 + each] != each:
            continue
        largest = each
        for k in range(each + 1, found):
            if scratch[16 + k] == each and scratch[8 + k] > scratch[8 + largest]:
                largest = k
        if each == best:
            shown = np.int64(scratch[largest])
        else:
            count = _add(records, marks, count, scratch[largest], x, scratch[24 + each])
    return shown, np.int64(scratch[24 + best]), nothing, count


@inner
def _sort_out(job, edges, rows, columns, pairs, found, marks, scratch, known):
    """Fill E_IDS and the lists of the band's rows.

    Args:
        rows: how many. columns: pointer to room for J_STRIDE + 8 int32. pairs: to as much, three times.
        found, marks: ``_add``'s, with room for E_ROOM entries.
        scratch: pointer to 40 int32. known: see ``joined``.
    """
    stride, width, room = job[J_STRIDE], job[J_WIDTH], edges[E_ROOM]
    lanes, samples = i32_at(job[J_LANES]), i32_at(edges[E_SAMPLE_IDS])
    length = stride + vec.LANES
    shown_at, others_at, about = i32_at(pairs), i32_at(pairs + 4 * length), i32_at(pairs + 8 * length)
    for row in range(rows):
        slots = i32_at(edges[E_SLOTS] + 4 * row * stride)
        ids = i32_at(edges[E_IDS] + 4 * row * stride)
        owners = i32_at(edges[E_OWNERS] + 4 * row * stride)
        records = i32_at(edges[E_RECORDS] + 4 * row * room)
        places = i32_at(edges[E_PLACES] + 4 * row * room)
        weights = u8_at(edges[E_WEIGHTS] + row * room)
        mixes = i32_at(edges[E_MIXES] + 4 * row * stride)
        count, mixed, several = np.int64(0), np.int64(0), np.int64(0)
        for column in range(0, width, vec.LANES):
            owner = vec.load(owners, column)
            pending = vec.bits(owner == vec.i32(MIXED))
            vec.store(ids, column, vec.select(owner < vec.i32(0), vec.i32(-1), vec.load(ids, column)))
            vec.store(columns, several, vec.load(lanes, vec.LANES * pending) + vec.i32(column))
            several += vec.count_bits(pending)
        while several > 0 and columns[several - 1] >= width:
            several -= 1
        # Most often, a pixel sees two records. What a pixel is cannot be predicted and is no branch.
        twos, more = np.int64(0), np.int64(0)
        for begin in range(0, several, vec.LANES):
            given = vec.iota() < vec.i32(several - begin)
            xs = vec.select(given, vec.load(columns, begin), vec.i32(columns[begin]))
            two, shown, hidden, less = pairs_of(vec.load_octets(as_f32(samples), vec.gather(slots, xs) << vec.i32(3)))
            vec.scatter(ids, xs, shown)
            pairs_at = vec.load(lanes, vec.LANES * vec.bits(given & two))
            vec.store(shown_at, twos, vec.permute(shown, pairs_at))
            vec.store(others_at, twos, vec.permute(hidden, pairs_at))
            vec.store(about, twos, vec.permute((xs << vec.i32(8)) | less, pairs_at))
            twos += vec.count_bits(vec.bits(given & two))
            others = vec.bits(given & ~two)
            vec.store(columns, more, vec.permute(xs, vec.load(lanes, vec.LANES * others)))
            more += vec.count_bits(others)
        for begin in range(0, twos, vec.LANES):
            different = apart(job, shown_at, others_at, begin, twos - begin, known)
            while different != 0:
                k = begin + vec.lowest_bit(different)
                different &= different - 1
                mark = np.int64(about[k])
                count = _add(found, marks, count, others_at[k], mark >> 8, mark & 255)
                mixes[mixed] = (mark >> 8 << 8) | ((vec.LANES - (mark & 255)) << 4)
                mixed += 1
        for k in range(more):
            x = np.int64(columns[k])
            at = vec.LANES * np.int64(slots[x])
            seen = vec.load(samples, at)
            same = vec.bits(seen == vec.spread0(seen))
            one = np.int64(samples[at])
            if same == 255:
                ids[x] = one
                continue
            other = np.int64(samples[at + vec.lowest_bit(~same)])
            others = vec.bits(seen == vec.i32(other))
            own, rest = vec.count_bits(same), vec.count_bits(others)
            nothing = np.int64(0)
            left = 255 & ~(same | others)
            if left == 0:  # one of the two is nothing
                shown = max(one, other)
                own, nothing = (own, rest) if one >= 0 else (rest, own)
            else:
                third = np.int64(samples[at + vec.lowest_bit(left)])
                thirds = vec.bits(seen == vec.i32(third))
                if left == thirds:
                    last = vec.count_bits(thirds)
                    shown, own, nothing, count = _three(
                        job, x, one, own, other, rest, third, last, found, marks, count, known
                    )
                else:
                    shown, own, nothing, count = _several(job, seen, x, found, marks, count, scratch, known)
            ids[x] = shown
            mixes[mixed] = (x << 8) | (own << 4) | nothing
            mixed += own < vec.LANES
        for k in range(count):
            mark = marks[k]
            records[k], places[k], weights[k] = found[k], mark >> 8, mark & 255
        i32_at(edges[E_COUNTS])[row] = count
        i32_at(edges[E_MIXED])[row] = mixed


@kernel("void(int64, int64, int64, int64, int64)")
def draw_samples(job_at, lens_at, row_begin, row_end, edges_at):
    """Raster the samples of a band of the picture, or of part of one.

    Args:
        job_at, lens_at: as for ``resolve.draw_band``. row_begin, row_end: rows of the picture.
        edges_at: address of E_COLUMNS int64.
    """
    job, edges = i64_at(job_at), i64_at(edges_at)
    own_job = np.empty(J_COLUMNS, np.int64)
    for k in range(J_COLUMNS):
        own_job[k] = job[k]
    # Kernels count pixels from the picture's first row.
    before = 4 * row_begin * job[J_STRIDE]
    own_job[J_SAMPLE_IDS], own_job[J_SAMPLE_INV_Z] = edges[E_SAMPLE_IDS], edges[E_SAMPLE_INV_Z]
    own_job[J_IDS], own_job[J_SLOTS] = edges[E_IDS] - before, edges[E_SLOTS] - before
    own_job[J_OWNERS] = edges[E_OWNERS] - before
    own_job[J_FAR], own_job[J_NEAR] = edges[E_FAR] - before, edges[E_NEAR] - before
    raster_samples(i64_at(np.int64(own_job.ctypes.data)), f64_at(lens_at), row_begin, row_end)
    own_job[0] = 0  # the pointer above does not keep the array alive


@kernel("void(int64, int64, int64, int64)")
def find_edges(job_at, row_begin, row_end, edges_at):
    """Find out what is to be shaded in rows that ``draw_samples`` has drawn; arguments as there."""
    job, edges = i64_at(job_at), i64_at(edges_at)
    room = edges[E_ROOM] + _REACH + vec.LANES
    length = job[J_STRIDE] + vec.LANES
    columns, pairs = 40, 40 + length
    found = pairs + 3 * length + _REACH
    own_scratch = np.empty(found + 2 * room, np.int32)
    own_known = np.zeros(3, np.int64)
    scratch, known = np.int64(own_scratch.ctypes.data), i64_at(np.int64(own_known.ctypes.data))
    entries, marks = i32_at(scratch + 4 * found), i32_at(scratch + 4 * (found + room))
    for k in range(1, _REACH + 1):
        entries[-k] = -1
    columns_at = i32_at(scratch + 4 * columns)
    _sort_out(job, edges, row_end - row_begin, columns_at, scratch + 4 * pairs, entries, marks, i32_at(scratch), known)
    own_scratch[0] = own_known[0] = 0  # the pointers above do not keep the arrays alive


@inner
def _mix(edges, stride, width, row_begin, row_end, background, picture_at, pitch):
    """Mix the band's pixels at edges.

    Args:
        edges: pointer to E_COLUMNS int64, E_COLORS filled; its rows are ``pitch`` colours long. stride: J_STRIDE.
        row_begin, row_end: the band's rows of the picture.
        background: red, green, blue, lowest byte first.
        picture_at: address of (H, W, 3) uint8, which has the colours of E_IDS.
    """
    room = edges[E_ROOM]
    own_sums = np.empty(3 * width, np.int32)
    sums = i32_at(np.int64(own_sums.ctypes.data))
    for y in range(row_begin, row_end):
        row = y - row_begin
        picture = u8_at(picture_at + 3 * y * width)
        mixes = i32_at(edges[E_MIXES] + 4 * row * stride)
        mixed = np.int64(i32_at(edges[E_MIXED])[row])
        for k in range(mixed):
            mix = np.int64(mixes[k])
            x, own, nothing = mix >> 8, (mix >> 4) & 15, mix & 15
            for c in range(3):
                sums[3 * x + c] = own * picture[3 * x + c] + nothing * ((background >> (8 * c)) & 255)
        places = i32_at(edges[E_PLACES] + 4 * row * room)
        weights = u8_at(edges[E_WEIGHTS] + row * room)
        colors = u8_at(edges[E_COLORS] + 3 * row * pitch)
        for k in range(i32_at(edges[E_COUNTS])[row]):
            x, weight = np.int64(places[k]), np.int64(weights[k])
            for c in range(3):
                sums[3 * x + c] += weight * colors[3 * k + c]
        for k in range(mixed):
            x = np.int64(mixes[k]) >> 8
            for c in range(3):
                picture[3 * x + c] = (sums[3 * x + c] + vec.LANES // 2) // vec.LANES
    own_sums[0] = 0  # the pointer above does not keep the array alive


@kernel("void(int64, int64, int64, int64, int64)")
def shade_mixed(own_at, edges_at, stride, row_begin, row_end):
    """Shade a band's pixels and its entries, and mix those at edges as they are shown, as VTK mixes them.

    Args:
        own_at: address of 2 int64: where ``renderers.shading.shade_rows.shade_rows`` lies, and a ``Painter``'s job, of
            the mode ``DIRECT``.
        edges_at: address of E_COLUMNS int64. stride: J_STRIDE.
        row_begin, row_end: the band's rows of the picture.
    """
    shade_at, job_at = i64_at(own_at)[0], i64_at(own_at)[1]
    job, edges = i64_at(job_at), i64_at(edges_at)
    call_kernel(shade_at, (job_at, edges[E_IDS] - 4 * row_begin * stride, row_begin, row_end))
    counts, room = i32_at(edges[E_COUNTS]), edges[E_ROOM]
    most = np.int64(0)
    for row in range(row_end - row_begin):
        most = max(most, np.int64(counts[row]))
    if most > 0:
        own_job = np.empty(S_COLUMNS, np.int64)
        for k in range(S_COLUMNS):
            own_job[k] = job[k]
        # Kernels count from the picture's first row.
        before = 4 * row_begin * room
        own_job[S_WIDTH], own_job[S_STRIDE] = most, room
        own_job[S_PLACES], own_job[S_COUNTS] = edges[E_PLACES] - before, edges[E_COUNTS] - 4 * row_begin
        own_job[S_COLOR] = edges[E_COLORS] - 3 * row_begin * most
        call_kernel(shade_at, (np.int64(own_job.ctypes.data), edges[E_RECORDS] - before, row_begin, row_end))
        own_job[0] = 0  # the address above does not keep the array alive
    _mix(edges, stride, job[S_WIDTH], row_begin, row_end, job[S_BACKGROUND], job[S_COLOR], most)
