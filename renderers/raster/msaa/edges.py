"""Edge pixels of a band with several samples: which primitives are shaded for them, and mixing their colours.

One primitive is shaded for every pixel, and further ones, the *entries* of a row, for pixels at edges. Triangles of one
surface that share an edge and its normals look the same where they meet, and are shaded once: what is left are
silhouettes, creases and seams.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import types

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel
from renderers.compiler.pointers import address, allocate, as_f32, i32_at, i64_at, release, stack_array, u8_at
from renderers.msaa import sample_band_at
from renderers.raster.layout import frame_at
from renderers.raster.msaa.coverage import draw_sample_rows
from renderers.raster.msaa.edge_merge import are_joined, pairs_of, separate_pairs
from renderers.raster.msaa.storage import MIXED
from renderers.shading.layout import (
    S_BACKGROUND,
    S_COLOR,
    S_COLUMNS,
    S_COUNTS,
    S_PLACES,
    S_STRIDE,
    S_WIDTH,
)

_REACH: Final = 32
"""Positions by which an entry may move to lie beside those of its instance; rows are nearly sorted anyway."""
_LAST: Final = 2**31 - 1
"""Greater than any primitive id."""
_job_array = stack_array(types.int64, S_COLUMNS)
_known_array = stack_array(types.int64, 3)


@inlined
def _add(entries, marks, count, primitive_id, column, weight):
    """Insert an entry among the last ones of a row, which are sorted by id; return the new count.

    Args:
        entries: pointer to int32 ids; _REACH values before the first are less than any id.
        marks: pointer to int32: column << 8 | weight of each.
    """
    end = count
    entries[end] = _LAST
    new, mark = vec.i32(primitive_id), vec.i32((column << 8) | weight)
    for _ in range(_REACH // vec.LANES):
        old, before = vec.load(entries, end - 7), vec.load(entries, end - 8)
        old_marks, marks_before = vec.load(marks, end - 7), vec.load(marks, end - 8)
        moves, stays = before > new, old <= new
        vec.store(entries, end - 7, vec.select(moves, before, vec.select(stays, old, new)))
        vec.store(marks, end - 7, vec.select(moves, marks_before, vec.select(stays, old_marks, mark)))
        end -= vec.LANES
        if entries[end] <= primitive_id:
            return count + 1
    entries[end], marks[end] = primitive_id, (column << 8) | weight
    return count + 1


@inlined
def _two(a, own, b, rest):
    """Return the id with more samples (the first of equals) and its samples; then the other's."""
    if own >= rest:
        return a, own, b, rest
    return b, rest, a, own


@device_function
def _three(frame, x, a, n, b, m, c, o, entries, marks, count, known):
    """``_several`` for three ids ``a``, ``b`` and ``c`` with ``n``, ``m`` and ``o`` samples; one may be -1."""
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
        if are_joined(frame, a, b, known):
            return shown, own + rest, nothing, count
        return shown, own, nothing, _add(entries, marks, count, other, x, rest)
    with_b, with_c = are_joined(frame, a, b, known), are_joined(frame, a, c, known)
    b_with_c = are_joined(frame, b, c, known)
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
        return shown, own, np.int64(0), _add(entries, marks, count, other, x, rest)
    shown, own, first, n = _two(a, n, b, m)
    shown, own, second, o = _two(shown, own, c, o)
    count = _add(entries, marks, count, first, x, n)
    return shown, own, np.int64(0), _add(entries, marks, count, second, x, o)


@device_function
def _several(frame, seen, x, entries, marks, count, scratch, known):
    """Add the entries of a pixel whose samples see any number of primitives.

    Args:
        seen: i32x8, the samples' ids. entries, marks, count: as for ``_add``. scratch: pointer to 40 int32.
        known: as for ``are_joined``.

    Returns:
        The id that is shaded for the pixel, the samples it has, those that see nothing, and the new ``count``.
    """
    vec.store(scratch, 32, seen)
    # Each id once: scratch has the id, its samples, the group it is in, and the group's samples.
    remaining, found, nothing = np.int64(255), 0, np.int64(0)
    while remaining != 0:
        primitive_id = np.int64(scratch[32 + vec.lowest_bit(remaining)])
        same = vec.movemask(seen == vec.i32(primitive_id))
        remaining &= ~same
        number = vec.count_bits(same)
        if primitive_id < 0:
            nothing = number
            continue
        group = np.int64(found)
        for k in range(found):
            if are_joined(frame, np.int64(scratch[k]), primitive_id, known):
                group = np.int64(scratch[16 + k])
                break
        scratch[found], scratch[8 + found], scratch[16 + found] = primitive_id, number, group
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
            count = _add(entries, marks, count, scratch[largest], x, scratch[24 + each])
    return shown, np.int64(scratch[24 + best]), nothing, count


@device_function
def _find_entries(frame, band, rows, columns, pairs, found, marks, scratch, known):
    """Fill a SAMPLE_BAND's ids, entries and mixed pixels.

    Args:
        rows: number of rows. columns: pointer to stride + 8 int32. pairs: address of three times as much.
        found, marks: as for ``_add``, with room for all entries of a row.
        scratch: pointer to 40 int32. known: as for ``are_joined``.
    """
    stride, width, room = frame.stride, frame.width, band.room
    lanes, samples = frame.lane_lists, band.sample_ids
    length = stride + vec.LANES
    shown_at, others_at, about = i32_at(pairs), i32_at(pairs + 4 * length), i32_at(pairs + 8 * length)
    for row in range(rows):
        slots = i32_at(address(band.slots) + 4 * row * stride)
        ids = i32_at(address(band.ids) + 4 * row * stride)
        owners = i32_at(address(band.owners) + 4 * row * stride)
        entry_ids = i32_at(address(band.entry_ids) + 4 * row * room)
        entry_columns = i32_at(address(band.entry_columns) + 4 * row * room)
        weights = u8_at(address(band.entry_weights) + row * room)
        mixes = i32_at(address(band.mixed) + 4 * row * stride)
        count, mixed, several = np.int64(0), np.int64(0), np.int64(0)
        for column in range(0, width, vec.LANES):
            owner = vec.load(owners, column)
            pending = vec.movemask(owner == vec.i32(MIXED))
            vec.store(ids, column, vec.select(owner < vec.i32(0), vec.i32(-1), vec.load(ids, column)))
            vec.store(columns, several, vec.load(lanes, vec.LANES * pending) + vec.i32(column))
            several += vec.count_bits(pending)
        while several > 0 and columns[several - 1] >= width:
            several -= 1
        # Mostly two. Without a branch, since it cannot be predicted.
        twos, more = np.int64(0), np.int64(0)
        for begin in range(0, several, vec.LANES):
            given = vec.iota() < vec.i32(several - begin)
            xs = vec.select(given, vec.load(columns, begin), vec.i32(columns[begin]))
            two, shown, hidden, less = pairs_of(vec.load_octets(as_f32(samples), vec.gather(slots, xs) << vec.i32(3)))
            vec.scatter(ids, xs, shown)
            pairs_at = vec.load(lanes, vec.LANES * vec.movemask(given & two))
            vec.store(shown_at, twos, vec.permute(shown, pairs_at))
            vec.store(others_at, twos, vec.permute(hidden, pairs_at))
            vec.store(about, twos, vec.permute((xs << vec.i32(8)) | less, pairs_at))
            twos += vec.count_bits(vec.movemask(given & two))
            others = vec.movemask(given & ~two)
            vec.store(columns, more, vec.permute(xs, vec.load(lanes, vec.LANES * others)))
            more += vec.count_bits(others)
        for begin in range(0, twos, vec.LANES):
            separate = separate_pairs(frame, shown_at, others_at, begin, twos - begin, known)
            while separate != 0:
                k = begin + vec.lowest_bit(separate)
                separate &= separate - 1
                mark = np.int64(about[k])
                count = _add(found, marks, count, others_at[k], mark >> 8, mark & 255)
                mixes[mixed] = (mark >> 8 << 8) | ((vec.LANES - (mark & 255)) << 4)
                mixed += 1
        for k in range(more):
            x = np.int64(columns[k])
            at = vec.LANES * np.int64(slots[x])
            seen = vec.load(samples, at)
            same = vec.movemask(seen == vec.broadcast_lane0(seen))
            one = np.int64(samples[at])
            if same == 255:
                ids[x] = one
                continue
            other = np.int64(samples[at + vec.lowest_bit(~same)])
            others = vec.movemask(seen == vec.i32(other))
            own, rest = vec.count_bits(same), vec.count_bits(others)
            nothing = np.int64(0)
            left = 255 & ~(same | others)
            if left == 0:  # one of the two is nothing
                shown = max(one, other)
                own, nothing = (own, rest) if one >= 0 else (rest, own)
            else:
                third = np.int64(samples[at + vec.lowest_bit(left)])
                thirds = vec.movemask(seen == vec.i32(third))
                if left == thirds:
                    last = vec.count_bits(thirds)
                    shown, own, nothing, count = _three(
                        frame, x, one, own, other, rest, third, last, found, marks, count, known
                    )
                else:
                    shown, own, nothing, count = _several(frame, seen, x, found, marks, count, scratch, known)
            ids[x] = shown
            mixes[mixed] = (x << 8) | (own << 4) | nothing
            mixed += own < vec.LANES
        for k in range(count):
            mark = marks[k]
            entry_ids[k], entry_columns[k], weights[k] = found[k], mark >> 8, mark & 255
        band.counts[row] = count
        band.mixed_counts[row] = mixed


@kernel("void(int64, int64, int64, int64)")
def draw_samples(frame_address, row_begin, row_end, band_address):
    """Rasterize the samples of a band of the image, or of part of one, into a SAMPLE_BAND."""
    draw_sample_rows(frame_at(frame_address), sample_band_at(band_address), row_begin, row_end)


@kernel("void(int64, int64, int64, int64)")
def find_edges(frame_address, row_begin, row_end, band_address):
    """Find what is to be shaded in rows that ``draw_samples`` has drawn; arguments as there."""
    frame, band = frame_at(frame_address), sample_band_at(band_address)
    room = band.room + _REACH + vec.LANES
    length = frame.stride + vec.LANES
    columns, pairs = 40, 40 + length
    found = pairs + 3 * length + _REACH
    heap = allocate(4 * (found + 2 * room))
    known = _known_array()
    known[0] = known[1] = known[2] = 0
    entries, marks = i32_at(heap + 4 * found), i32_at(heap + 4 * (found + room))
    for k in range(1, _REACH + 1):
        entries[-k] = -1
    columns_at = i32_at(heap + 4 * columns)
    _find_entries(frame, band, row_end - row_begin, columns_at, heap + 4 * pairs, entries, marks, i32_at(heap), known)
    release(heap)


@device_function
def _mix(band, stride, width, row_begin, row_end, background, image_address, pitch):
    """Mix the colours of a band's pixels at edges.

    Args:
        band: a SAMPLE_BAND with shaded entries, whose rows are ``pitch`` colours long. stride: as in FRAME.
        row_begin, row_end: the band's rows of the image.
        background: red, green, blue, lowest byte first.
        image_address: address of (H, W, 3) uint8, which has the colours of the band's ids.
    """
    room = band.room
    heap = allocate(12 * width)
    sums = i32_at(heap)
    for y in range(row_begin, row_end):
        row = y - row_begin
        image = u8_at(image_address + 3 * y * width)
        mixes = i32_at(address(band.mixed) + 4 * row * stride)
        mixed = np.int64(band.mixed_counts[row])
        for k in range(mixed):
            mix = np.int64(mixes[k])
            x, own, nothing = mix >> 8, (mix >> 4) & 15, mix & 15
            for c in range(3):
                sums[3 * x + c] = own * image[3 * x + c] + nothing * ((background >> (8 * c)) & 255)
        columns = i32_at(address(band.entry_columns) + 4 * row * room)
        weights = u8_at(address(band.entry_weights) + row * room)
        colors = u8_at(address(band.entry_colors) + 3 * row * pitch)
        for k in range(band.counts[row]):
            x, weight = np.int64(columns[k]), np.int64(weights[k])
            for c in range(3):
                sums[3 * x + c] += weight * colors[3 * k + c]
        for k in range(mixed):
            x = np.int64(mixes[k]) >> 8
            for c in range(3):
                image[3 * x + c] = (sums[3 * x + c] + vec.LANES // 2) // vec.LANES
    release(heap)


@kernel("void(int64, int64, int64, int64, int64)")
def shade_mixed(own_address, band_address, stride, row_begin, row_end):
    """Shade a band's pixels and its entries, and mix edge pixels as bytes, as VTK does.

    Args:
        own_address: address of 2 int64: the kernel ``renderers.shading.shade_rows.shade_rows`` and a ``Painter``'s job
            in the mode DIRECT.
        band_address: address of a SAMPLE_BAND. stride: as in FRAME.
        row_begin, row_end: the band's rows of the image.
    """
    shade_kernel, job_address = i64_at(own_address)[0], i64_at(own_address)[1]
    job, band = i64_at(job_address), sample_band_at(band_address)
    call_kernel(shade_kernel, (job_address, address(band.ids) - 4 * row_begin * stride, row_begin, row_end))
    most = np.int64(0)
    for row in range(row_end - row_begin):
        most = max(most, np.int64(band.counts[row]))
    if most > 0:
        own_job = _job_array()
        for k in range(S_COLUMNS):
            own_job[k] = job[k]
        # Shading counts rows from the image's first one.
        before = 4 * row_begin * band.room
        own_job[S_WIDTH], own_job[S_STRIDE] = most, band.room
        own_job[S_PLACES] = address(band.entry_columns) - before
        own_job[S_COUNTS] = address(band.counts) - 4 * row_begin
        own_job[S_COLOR] = address(band.entry_colors) - 3 * row_begin * most
        call_kernel(shade_kernel, (address(own_job), address(band.entry_ids) - before, row_begin, row_end))
    _mix(band, stride, job[S_WIDTH], row_begin, row_end, job[S_BACKGROUND], job[S_COLOR], most)
