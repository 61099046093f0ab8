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
def _append_entry(band, row_in_band, primitive_id, column, samples):
    """Append an entry to a row of the band: a primitive that ``samples`` of a pixel's samples see."""
    count = band.counts[row_in_band]
    entry = row_in_band * band.max_entries + count
    band.entry_ids[entry], band.entry_columns[entry], band.entry_weights[entry] = primitive_id, column, samples
    band.counts[row_in_band] = count + 1


@inlined
def _group_samples(frame, sample_ids, groups, cache):
    """Fill a _GROUPS with the primitives that a pixel's samples see, in the order of the samples.

    Args:
        sample_ids: i32x8.
        groups: a _GROUPS.
        cache: a CACHE.

    Returns:
        Number of primitives, and of samples that see nothing; int64.
    """
    vec.store(groups.sample_ids, 0, sample_ids)
    pending, count, background = np.int64(255), 0, 0
    while pending != 0:
        primitive_id = np.int64(groups.sample_ids[vec.lowest_bit(pending)])
        same = vec.movemask(sample_ids == vec.i32(primitive_id))
        pending &= ~same
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
    return count, background


@inlined
def _most_seen_of(groups, group, count):
    """Return the index of the primitive of a group that most samples see, the first of several.

    Args:
        groups: a _GROUPS of ``count`` primitives.
        group: index of the group's first primitive.
    """
    most_seen = group
    for k in range(group + 1, count):
        if groups.groups[k] == group and groups.counts[k] > groups.counts[most_seen]:
            most_seen = k
    return most_seen


@device_function
def _mix_pixel(frame, band, row_in_band, sample_ids, column, groups, cache):
    """Append the entries of a pixel whose samples see any number of primitives.

    Args:
        sample_ids: i32x8.
        groups: a _GROUPS of scratch.
        cache: a CACHE.

    Returns:
        The primitive id that is shaded for the pixel, the number of samples that it has, and of those that see nothing.
    """
    count, background = _group_samples(frame, sample_ids, groups, cache)
    if count == 0:
        return np.int64(-1), np.int64(vec.LANES), background
    shown_group = 0
    for k in range(1, count):
        if groups.group_counts[k] > groups.group_counts[shown_group]:
            shown_group = k
    for group in range(count):
        if groups.groups[group] == group and group != shown_group:
            entry_id = groups.ids[_most_seen_of(groups, group, count)]
            _append_entry(band, row_in_band, entry_id, column, groups.group_counts[group])
    shown_id = np.int64(groups.ids[_most_seen_of(groups, shown_group, count)])
    return shown_id, np.int64(groups.group_counts[shown_group]), background


@device_function
def _find_entries(frame, band, row_count, columns):
    """Fill a SAMPLE_BAND's ids, entries and mixed pixels.

    Args:
        row_count: number of rows.
        columns: pointer to stride + 8 int32 of scratch.
    """
    stride = frame.stride
    groups, cache = _new_groups(), _new_cache()
    cache.first_id = cache.end_id = cache.indices = 0
    for row_in_band in range(row_count):
        first_pixel = row_in_band * stride
        slots, ids = advance(band.slots, first_pixel), advance(band.ids, first_pixel)
        mixed, mixed_count = advance(band.mixed, first_pixel), np.int64(0)
        band.counts[row_in_band] = 0
        for k in range(_find_mixed(frame, advance(band.owners, first_pixel), ids, columns)):
            x = np.int64(columns[k])
            seen_ids = vec.load(band.sample_ids, vec.LANES * np.int64(slots[x]))
            shown_id, own, background = _mix_pixel(frame, band, row_in_band, seen_ids, x, groups, cache)
            ids[x] = shown_id
            mixed[mixed_count] = (x << 8) | (own << 4) | background  # unpacked in _mix_colors
            mixed_count += own < vec.LANES
        band.mixed_counts[row_in_band] = mixed_count


@inlined
def _find_mixed(frame, owners, ids, columns):
    """Write the columns of a row's MIXED pixels, and -1 to the ids of its other pixels without an owner.

    Args:
        owners, ids: pointers to the row's, int32.
        columns: pointer to stride + 8 int32.

    Returns:
        Number of the columns.
    """
    count = np.int64(0)
    for column in range(0, frame.width, vec.LANES):
        owner = vec.load(owners, column)
        mixed_bits = vec.movemask(owner == vec.i32(MIXED))
        vec.store(ids, column, vec.select(owner < vec.i32(0), vec.i32(-1), vec.load(ids, column)))
        vec.store(columns, count, vec.load(frame.lane_lists, vec.LANES * mixed_bits) + vec.i32(column))
        count += vec.count_bits(mixed_bits)
    while count > 0 and columns[count - 1] >= frame.width:
        count -= 1
    return count


@kernel("void(int64, int64, int64, int64)")
def draw_samples(frame_address, first_row, end_row, band_address):
    """Rasterize the samples of a band of the image, or of part of one, into a SAMPLE_BAND."""
    draw_sample_rows(frame_at(frame_address), sample_band_at(band_address), first_row, end_row)


@kernel("void(int64, int64, int64, int64)")
def find_edges(frame_address, first_row, end_row, band_address):
    """Find the primitives to shade in rows that ``draw_samples`` has drawn."""
    frame = frame_at(frame_address)
    heap = allocate(4 * (frame.stride + vec.LANES))
    _find_entries(frame, sample_band_at(band_address), end_row - first_row, i32_at(heap))
    release(heap)


@device_function
def _mix_colors(band, stride, width, first_row, end_row, background, color, color_stride):
    """Mix the colours of a band's pixels at edges.

    Args:
        band: a SAMPLE_BAND with shaded entries, in rows of ``color_stride`` colours.
        width: pixels of a row of the image.
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
    """Fill a HEADLIGHT_JOB, ``entry_job``, that shades a band's entries into their own colours.

    Args:
        max_count: maximum number of entries of a row.
    """
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
