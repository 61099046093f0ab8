"""Edge pixels of a band with several samples: which primitives are shaded for them, and mixing their colours.

One primitive is shaded for every pixel. Pixels at edges have further ones: the *entries* of a row. Triangles of one
surface that share an edge and its normals look the same where they meet, and are shaded once. So entries remain only
at silhouettes, creases and seams.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel
from renderers.compiler.pointers import address, advance, allocate, i32_at, i64_at, release
from renderers.compiler.structs import I32, Struct, array_of
from renderers.msaa import sample_band_at
from renderers.raster.layout import frame_at
from renderers.raster.msaa.coverage import draw_sample_rows
from renderers.raster.msaa.edge_merge import CACHE, share_smooth_edge
from renderers.raster.msaa.storage import MIXED
from renderers.shading.headlight.layout import HEADLIGHT_JOB, headlight_job_at

_new_job = HEADLIGHT_JOB.local

_GROUPS: Final = Struct(
    "SampleGroups",
    {
        "sample_ids": array_of(I32, vec.LANES),  # of the pixel's samples
        "ids": array_of(I32, vec.LANES),  # each primitive id once
        "counts": array_of(I32, vec.LANES),  # samples that see it
        "groups": array_of(I32, vec.LANES),  # index of the first primitive of its group
        "group_counts": array_of(I32, vec.LANES),  # samples of the group of which it is the first
    },
)
"""The primitives that a pixel's samples see, grouped by ``share_smooth_edge``."""
_new_groups, _new_cache = _GROUPS.local, CACHE.local


@inlined
def _append_entry(band, row, primitive_id, column, samples):
    """Append an entry to a row of the band: a primitive that ``samples`` of a pixel's samples see."""
    count = band.counts[row]
    entry = row * band.max_entries + count
    band.entry_ids[entry], band.entry_columns[entry], band.entry_weights[entry] = primitive_id, column, samples
    band.counts[row] = count + 1


@device_function
def _mix_pixel(frame, band, row, sample_ids, column, groups, cache):
    """Append the entries of a pixel whose samples see any number of primitives.

    Args:
        sample_ids: i32x8.
        groups: a _GROUPS of scratch.
        cache: a CACHE.

    Returns:
        The primitive id that is shaded for the pixel, the number of samples that it has, and of those that see nothing.
    """
    vec.store(groups.sample_ids, 0, sample_ids)
    groups.ids[0], groups.group_counts[0] = -1, vec.LANES  # if no sample sees a primitive
    remaining, count, background = np.int64(255), 0, 0
    while remaining != 0:
        primitive_id = np.int64(groups.sample_ids[vec.lowest_bit(remaining)])
        same = vec.movemask(sample_ids == vec.i32(primitive_id))
        remaining &= ~same
        samples = vec.count_bits(same)
        if primitive_id < 0:
            background = samples
            continue
        group = count
        for k in range(count):
            if share_smooth_edge(frame, np.int64(groups.ids[k]), primitive_id, cache):
                group = groups.groups[k]
                break
        groups.ids[count], groups.counts[count], groups.groups[count] = primitive_id, samples, group
        groups.group_counts[count] = 0
        groups.group_counts[group] += samples
        count += 1
    best = 0
    for k in range(1, count):
        if groups.group_counts[k] > groups.group_counts[best]:
            best = k
    shown_id = np.int64(groups.ids[best])
    for group in range(count):
        if groups.groups[group] != group:
            continue
        largest = group
        for k in range(group + 1, count):
            if groups.groups[k] == group and groups.counts[k] > groups.counts[largest]:
                largest = k
        if group == best:
            shown_id = np.int64(groups.ids[largest])
        else:
            _append_entry(band, row, groups.ids[largest], column, groups.group_counts[group])
    return shown_id, np.int64(groups.group_counts[best]), background


@device_function
def _find_entries(frame, band, rows, columns):
    """Fill a SAMPLE_BAND's ids, entries and mixed pixels.

    Args:
        rows: number of rows.
        columns: pointer to stride + 8 int32 of scratch.
    """
    stride, width = frame.stride, frame.width
    lane_lists, sample_ids = frame.lane_lists, band.sample_ids
    groups, cache = _new_groups(), _new_cache()
    cache.first_id = cache.end_id = cache.indices = 0
    for row in range(rows):
        first_pixel = row * stride
        slots, ids = advance(band.slots, first_pixel), advance(band.ids, first_pixel)
        owners, mixed = advance(band.owners, first_pixel), advance(band.mixed, first_pixel)
        band.counts[row] = 0
        mixed_count, edge_count = np.int64(0), np.int64(0)
        for column in range(0, width, vec.LANES):
            owner = vec.load(owners, column)
            pending = vec.movemask(owner == vec.i32(MIXED))
            vec.store(ids, column, vec.select(owner < vec.i32(0), vec.i32(-1), vec.load(ids, column)))
            vec.store(columns, edge_count, vec.load(lane_lists, vec.LANES * pending) + vec.i32(column))
            edge_count += vec.count_bits(pending)
        while edge_count > 0 and columns[edge_count - 1] >= width:
            edge_count -= 1
        for k in range(edge_count):
            x = np.int64(columns[k])
            seen_ids = vec.load(sample_ids, vec.LANES * np.int64(slots[x]))
            shown_id, own, background = _mix_pixel(frame, band, row, seen_ids, x, groups, cache)
            ids[x] = shown_id
            mixed[mixed_count] = (x << 8) | (own << 4) | background
            mixed_count += own < vec.LANES
        band.mixed_counts[row] = mixed_count


@kernel("void(int64, int64, int64, int64)")
def draw_samples(frame_address, first_row, end_row, band_address):
    """Rasterize the samples of a band of the image, or of part of one, into a SAMPLE_BAND."""
    draw_sample_rows(frame_at(frame_address), sample_band_at(band_address), first_row, end_row)


@kernel("void(int64, int64, int64, int64)")
def find_edges(frame_address, first_row, end_row, band_address):
    """Find the primitives to shade in rows that ``draw_samples`` has drawn; arguments as there."""
    frame = frame_at(frame_address)
    heap = allocate(4 * (frame.stride + vec.LANES))
    _find_entries(frame, sample_band_at(band_address), end_row - first_row, i32_at(heap))
    release(heap)


@device_function
def _mix_colors(band, stride, width, first_row, end_row, background, color, color_stride):
    """Mix the colours of a band's pixels at edges.

    Args:
        band: a SAMPLE_BAND with shaded entries, in rows of ``color_stride`` colours.
        stride: as in FRAME.
        first_row, end_row: the band's rows of the image.
        background: red, green, blue, lowest byte first.
        color: pointer to (H, W, 3) uint8, which has the colours of the band's ids.
    """
    room = band.max_entries
    heap = allocate(12 * width)
    sums = i32_at(heap)
    for y in range(first_row, end_row):
        row = y - first_row
        image, mixed = advance(color, 3 * y * width), advance(band.mixed, row * stride)
        mixed_count = np.int64(band.mixed_counts[row])
        for k in range(mixed_count):
            mark = np.int64(mixed[k])
            x, own, background_samples = mark >> 8, (mark >> 4) & 15, mark & 15
            for channel in range(3):
                background_value = (background >> (8 * channel)) & 255
                sums[3 * x + channel] = own * image[3 * x + channel] + background_samples * background_value
        columns, weights = advance(band.entry_columns, row * room), advance(band.entry_weights, row * room)
        colors = advance(band.entry_colors, 3 * row * color_stride)
        for k in range(band.counts[row]):
            x, weight = np.int64(columns[k]), np.int64(weights[k])
            for channel in range(3):
                sums[3 * x + channel] += weight * colors[3 * k + channel]
        for k in range(mixed_count):
            x = np.int64(mixed[k]) >> 8
            for channel in range(3):
                image[3 * x + channel] = (sums[3 * x + channel] + vec.LANES // 2) // vec.LANES
    release(heap)


@inlined
def _fill_entry_job(entry_job, job, band, first_row, max_count):
    """Fill a HEADLIGHT_JOB that shades a band's entries, at most ``max_count`` in a row, into their own colours."""
    entry_job.shading, entry_job.mode, entry_job.background = job.shading, job.mode, job.background
    entry_job.gathered, entry_job.height, entry_job.first_row = job.gathered, job.height, first_row
    entry_job.gamma_cells, entry_job.gamma_from_linear = job.gamma_cells, job.gamma_from_linear
    entry_job.width, entry_job.stride = max_count, band.max_entries
    entry_job.color, entry_job.columns = band.entry_colors, address(band.entry_columns)
    entry_job.counts = band.counts


@kernel("void(int64, int64, int64, int64, int64)")
def shade_mixed(own_address, band_address, stride, first_row, end_row):
    """Shade a band's pixels and its entries, and mix edge pixels as bytes, as VTK does.

    Args:
        own_address: address of 2 int64: the kernel ``headlight.shade_rows.shade_rows`` and the address of a
            HEADLIGHT_JOB in the mode DIRECT.
        band_address: address of a SAMPLE_BAND.
        stride: as in FRAME.
        first_row, end_row: the band's rows of the image.
    """
    shade_kernel, job_address = i64_at(own_address)[0], i64_at(own_address)[1]
    job, band = headlight_job_at(job_address), sample_band_at(band_address)
    call_kernel(shade_kernel, (job_address, address(band.ids), first_row, end_row))
    max_count = np.int64(0)
    for row in range(end_row - first_row):
        max_count = max(max_count, np.int64(band.counts[row]))
    if max_count > 0:
        entry_job = _new_job()
        _fill_entry_job(entry_job, job, band, first_row, max_count)
        call_kernel(shade_kernel, (address(entry_job), address(band.entry_ids), first_row, end_row))
    _mix_colors(band, stride, job.width, first_row, end_row, job.background, job.color, max_count)
