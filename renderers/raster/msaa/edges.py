"""Edge pixels of a band with several samples: which primitives are shaded for them, and mixing their colours.

One primitive is shaded for every pixel. Pixels at edges have further ones: the *entries* of a row. Triangles of one
surface that share an edge and its normals look the same where they meet, and are shaded once. So entries remain only
at silhouettes, creases and seams.
"""

from typing import Final

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel
from renderers.compiler.kernel_types import I32, I64, U8, Address, Pointer, i64
from renderers.compiler.pointers import address, advance, allocate, i32_at, i64_at, release
from renderers.compiler.simd import I32x8
from renderers.compiler.structs import Struct, inline
from renderers.msaa import SampleBand
from renderers.raster.layout import RasterFrame
from renderers.raster.msaa.coverage import draw_sample_rows
from renderers.raster.msaa.edge_merge import InstanceCache, share_smooth_edge
from renderers.raster.msaa.storage import MIXED
from renderers.shading.headlight.layout import HeadlightInputs

_JOB_WORDS: Final = HeadlightInputs.nbytes // 8


class _SampleGroups(Struct):
    """The primitives that a pixel's samples see, grouped by ``share_smooth_edge``."""

    sample_ids: Pointer[I32] = inline(vec.LANES)  # of the pixel's samples
    ids: Pointer[I32] = inline(vec.LANES)  # each primitive id once
    counts: Pointer[I32] = inline(vec.LANES)  # samples that see it
    groups: Pointer[I32] = inline(vec.LANES)  # index of the first primitive of its group
    group_counts: Pointer[I32] = inline(vec.LANES)  # samples of the group of which it is the first


@inlined
def _append_entry(band: SampleBand, row_in_band: I64, primitive_id: I32, column: I64, samples: I32) -> None:
    """Append an entry to a row of the band: a primitive that ``samples`` of a pixel's samples see."""
    count = band.counts[row_in_band]
    entry = row_in_band * band.max_entries + count
    band.entry_ids[entry], band.entry_columns[entry], band.entry_weights[entry] = primitive_id, column, samples
    band.counts[row_in_band] = count + 1


@inlined
def _group_samples(
    frame: RasterFrame, sample_ids: I32x8, groups: _SampleGroups, cache: InstanceCache
) -> tuple[I64, I64]:
    """Fill a _SampleGroups with the primitives that a pixel's samples see, in the order of the samples.

    Return the number of primitives, and of samples that see nothing.
    """
    vec.store(groups.sample_ids, 0, sample_ids)
    pending, count, background = i64(255), 0, 0
    while pending != 0:
        primitive_id = i64(groups.sample_ids[vec.lowest_bit(pending)])
        same = vec.movemask(sample_ids == vec.i32(primitive_id))
        pending &= ~same
        samples = vec.count_bits(same)
        if primitive_id < 0:
            background = samples
            continue
        group = count
        for k in range(count):
            if share_smooth_edge(frame, i64(groups.ids[k]), primitive_id, cache):
                group = groups.groups[k]
                break
        groups.ids[count], groups.counts[count], groups.groups[count] = primitive_id, samples, group
        groups.group_counts[count] = 0
        groups.group_counts[group] += samples
        count += 1
    return count, background


@inlined
def _most_seen_of(groups: _SampleGroups, group: I64, count: I64) -> I64:
    """Return which of ``count`` primitives most samples of a group see, the first of several."""
    most_seen = group
    for k in range(group + 1, count):
        if groups.groups[k] == group and groups.counts[k] > groups.counts[most_seen]:
            most_seen = k
    return most_seen


@device_function
def _mix_pixel(
    frame: RasterFrame,
    band: SampleBand,
    row_in_band: I64,
    sample_ids: I32x8,
    column: I64,
    groups: _SampleGroups,
    cache: InstanceCache,
) -> tuple[I64, I64, I64]:
    """Append the entries of a pixel whose samples see any number of primitives.

    Return the primitive id that is shaded for the pixel, the number of samples that it has, and of those that see
    nothing.
    """
    count, background = _group_samples(frame, sample_ids, groups, cache)
    if count == 0:
        return i64(-1), i64(vec.LANES), background
    shown_group = 0
    for k in range(1, count):
        if groups.group_counts[k] > groups.group_counts[shown_group]:
            shown_group = k
    for group in range(count):
        if groups.groups[group] == group and group != shown_group:
            entry_id = groups.ids[_most_seen_of(groups, group, count)]
            _append_entry(band, row_in_band, entry_id, column, groups.group_counts[group])
    shown_id = i64(groups.ids[_most_seen_of(groups, shown_group, count)])
    return shown_id, i64(groups.group_counts[shown_group]), background


@device_function
def _find_entries(frame: RasterFrame, band: SampleBand, row_count: I64, columns: Pointer[I32]) -> None:
    """Fill a SampleBand's ids, entries and mixed pixels; ``columns``: stride + 8 values of scratch."""
    stride = frame.stride
    groups, cache = _SampleGroups(), InstanceCache()
    cache.first_id = cache.end_id = cache.indices = 0
    for row_in_band in range(row_count):
        first_pixel = row_in_band * stride
        slots, ids = advance(band.slots, first_pixel), advance(band.ids, first_pixel)
        mixed, mixed_count = advance(band.mixed, first_pixel), i64(0)
        band.counts[row_in_band] = 0
        for k in range(_find_mixed(frame, advance(band.owners, first_pixel), ids, columns)):
            x = i64(columns[k])
            seen_ids = vec.load(band.sample_ids, vec.LANES * i64(slots[x]))
            shown_id, own, background = _mix_pixel(frame, band, row_in_band, seen_ids, x, groups, cache)
            ids[x] = shown_id
            mixed[mixed_count] = (x << 8) | (own << 4) | background  # unpacked in _mix_colors
            mixed_count += own < vec.LANES
        band.mixed_counts[row_in_band] = mixed_count


@inlined
def _find_mixed(frame: RasterFrame, owners: Pointer[I32], ids: Pointer[I32], columns: Pointer[I32]) -> I64:
    """Write the columns of a row's MIXED pixels, and -1 to the ids of its other pixels without an owner.

    Return the number of columns, for which there is room of stride + 8.
    """
    count = i64(0)
    for column in range(0, frame.width, vec.LANES):
        owner = vec.load(owners, column)
        mixed_bits = vec.movemask(owner == vec.i32(MIXED))
        vec.store(ids, column, vec.select(owner < vec.i32(0), vec.i32(-1), vec.load(ids, column)))
        vec.store(columns, count, vec.load(frame.lanes_of_mask, vec.LANES * mixed_bits) + vec.i32(column))
        count += vec.count_bits(mixed_bits)
    while count > 0 and columns[count - 1] >= frame.width:
        count -= 1
    return count


@kernel
def draw_samples(frame_address: Address, first_row: I64, end_row: I64, band_address: Address) -> None:
    """Rasterize the samples of a band of the image, or of part of one, into a SampleBand."""
    draw_sample_rows(RasterFrame(frame_address), SampleBand(band_address), first_row, end_row)


@kernel
def find_edges(frame_address: Address, first_row: I64, end_row: I64, band_address: Address) -> None:
    """Find the primitives to shade in rows that ``draw_samples`` has drawn."""
    frame = RasterFrame(frame_address)
    heap = allocate(4 * (frame.stride + vec.LANES))
    _find_entries(frame, SampleBand(band_address), end_row - first_row, i32_at(heap))
    release(heap)


@device_function
def _mix_colors(
    band: SampleBand,
    stride: I64,
    width: I64,
    first_row: I64,
    end_row: I64,
    background: I64,
    color: Pointer[U8],
    color_stride: I64,
) -> None:
    """Mix the colours of a band's pixels at edges.

    Args:
        color_stride: shaded entries in a row of ``entry_colors``.
        background: red, green, blue, lowest byte first.
        color: (H, W, 3), which has the colours of the band's ids.
    """
    room = band.max_entries
    heap = allocate(12 * width)
    sums = i32_at(heap)
    for y in range(first_row, end_row):
        row = y - first_row
        image, mixed = advance(color, 3 * y * width), advance(band.mixed, row * stride)
        mixed_count = i64(band.mixed_counts[row])
        for k in range(mixed_count):
            mark = i64(mixed[k])
            x, own, background_samples = mark >> 8, (mark >> 4) & 15, mark & 15
            for channel in range(3):
                background_value = (background >> (8 * channel)) & 255
                sums[3 * x + channel] = own * image[3 * x + channel] + background_samples * background_value
        columns, weights = advance(band.entry_columns, row * room), advance(band.entry_weights, row * room)
        colors = advance(band.entry_colors, 3 * row * color_stride)
        for k in range(band.counts[row]):
            x, weight = i64(columns[k]), i64(weights[k])
            for channel in range(3):
                sums[3 * x + channel] += weight * colors[3 * k + channel]
        for k in range(mixed_count):
            x = i64(mixed[k]) >> 8
            for channel in range(3):
                image[3 * x + channel] = (sums[3 * x + channel] + vec.LANES // 2) // vec.LANES
    release(heap)


@inlined
def _set_entry_job(
    entry_job: HeadlightInputs, job: HeadlightInputs, band: SampleBand, first_row: I64, width: I64
) -> None:
    """Set ``entry_job`` to a job that shades a band's entries, at most ``width`` in a row, into their own colours."""
    target, source = i64_at(address(entry_job)), i64_at(address(job))
    for word in range(_JOB_WORDS):
        target[word] = source[word]
    entry_job.width, entry_job.stride, entry_job.first_row = width, band.max_entries, first_row
    entry_job.color, entry_job.columns = band.entry_colors, address(band.entry_columns)
    entry_job.counts = band.counts


@kernel
def shade_mixed(own_address: Address, band_address: Address, stride: I64, first_row: I64, end_row: I64) -> None:
    """Shade a band's pixels and its entries, and mix edge pixels as bytes, as VTK does.

    ``own_address`` is that of two int64: the kernel ``shade_rows``, and the address of a HeadlightInputs in the mode
    DIRECT.
    """
    shade_kernel, job_address = i64_at(own_address)[0], i64_at(own_address)[1]
    job, band = HeadlightInputs(job_address), SampleBand(band_address)
    call_kernel(shade_kernel, (job_address, address(band.ids), first_row, end_row))
    max_count = i64(0)
    for row in range(end_row - first_row):
        max_count = max(max_count, i64(band.counts[row]))
    if max_count > 0:
        entry_job = HeadlightInputs()
        _set_entry_job(entry_job, job, band, first_row, max_count)
        call_kernel(shade_kernel, (address(entry_job), address(band.entry_ids), first_row, end_row))
    _mix_colors(band, stride, job.width, first_row, end_row, job.background, job.color, max_count)
