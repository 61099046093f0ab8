"""Kernels of the look ``studio``, which gather surfaces segment by segment, light them together, and blend them.

An *accumulated row* is the memory that surfaces of a row of pixels are blended into: four channels of
``channel_values(width)`` float32. The first three are tone-mapped linear RGB times coverage, the fourth is coverage.
"""

from typing import Final

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.kernel_types import F32, I32, I64, U8, Address, Pointer, f32, i64
from renderers.compiler.pointers import address, advance, allocate, f32_at, i32_at, release, stack_array
from renderers.compiler.structs import Struct
from renderers.msaa import SampleBand
from renderers.shading.interpolation import interpolate, pixel_columns
from renderers.shading.layout import MAX_PART_PIXELS, ROW_STRIDE, PartPixels, PartSpans, ShadingContext
from renderers.shading.span_setup import set_up_part
from renderers.shading.spans import allocate_row_memory, bind_next_segment, find_part_end, find_spans, free_row_memory
from renderers.shading.studio.layout import StudioInputs, StudioSurfaces, channel_values_in_kernel
from renderers.shading.studio.lighting import light_surfaces
from renderers.shading.studio.material import ALPHA, COLOR, COLOR_AND_ALPHA, fill_surfaces
from renderers.shading.studio.tone_mapping import write_image_row

ADD: Final = 0
"""Add the layer's colours with full coverage, whatever their alpha."""
BENEATH: Final = 1
"""Blend the layer behind the accumulated layers."""
EDGES: Final = 2
"""Add the surfaces of a ``msaa.SampleBand``, each weighted by the number of samples that see it."""
WRITE_ALPHA: Final = 3
"""Only write alpha."""


class _StudioRow(Struct):
    """State of the row that is being shaded."""

    mode: I64  # ADD, BENEATH, EDGES or WRITE_ALPHA
    accumulated: Pointer[F32]  # accumulated row; with WRITE_ALPHA a row of alpha
    channel_size: I64  # number of values of one of its channels
    surfaces: StudioSurfaces  # surfaces that are gathered, but not lit yet
    columns: Pointer[I32]  # image columns of the gathered surfaces
    gathered: I64  # number of gathered surfaces
    weights: Pointer[U8]  # samples (of 8) that see each pixel's surface; read only if the segment has columns


_new_columns = stack_array(I32, ROW_STRIDE)
_SURFACES_VALUES: Final = StudioSurfaces.nbytes // 4


@inlined
def _blend_one(
    mode: I64,
    accumulated: Pointer[F32],
    channel_size: I64,
    x: I64,
    surfaces: StudioSurfaces,
    color: Pointer[F32],
    k: I64,
) -> None:
    """Blend surface k into column x. ``color``: as in ``_blend``."""
    share = surfaces.alpha[k]
    if mode == BENEATH:
        share *= max(f32(1.0) - accumulated[3 * channel_size + x], f32(0.0))
    for c in range(3):
        accumulated[c * channel_size + x] += share * color[c * ROW_STRIDE + k]
    accumulated[3 * channel_size + x] += share


@device_function
def _blend(row: _StudioRow, color: Pointer[F32], begin: I64, end: I64) -> None:
    """Blend the gathered surfaces ``begin .. end``, whose colour is in three rows ``color``, into their columns."""
    mode, surfaces, columns = row.mode, row.surfaces, row.columns
    accumulated, channel_size = row.accumulated, row.channel_size
    lane, one, zero = vec.iota(), vec.f32(1.0), vec.f32(0.0)
    for k in range(begin, end, vec.LANES):
        x, count = i64(columns[k]), end - k
        in_range = lane < vec.i32(count)
        if vec.movemask(in_range & (vec.load(columns, k) != vec.i32(x) + lane)) != 0:  # not neighbouring columns
            for j in range(min(count, vec.LANES)):
                _blend_one(mode, accumulated, channel_size, i64(columns[k + j]), surfaces, color, k + j)
            continue
        share = vec.load(surfaces.alpha, k)
        coverage = vec.load(accumulated, 3 * channel_size + x)
        if mode == BENEATH:
            share = share * vec.maximum(one - coverage, zero)
        for c in range(3):
            old = vec.load(accumulated, c * channel_size + x)
            added = share * vec.load(color, c * ROW_STRIDE + k)
            vec.store(accumulated, c * channel_size + x, old + vec.select(in_range, added, zero))
        vec.store(accumulated, 3 * channel_size + x, coverage + vec.select(in_range, share, zero))


@device_function
def _light_and_blend(job: StudioInputs, row: _StudioRow) -> None:
    """Light the gathered surfaces and blend them into the row."""
    if row.gathered > 0:
        light_surfaces(job.lighting, row.surfaces, row.gathered)
        _blend(row, row.surfaces.color, i64(0), row.gathered)
        row.gathered = 0


@device_function
def _fill_columns(context: ShadingContext, row: _StudioRow, begin: I64, end: I64) -> None:
    """Append the columns and ``alpha`` of the segment's pixels ``begin .. end`` to those of the gathered surfaces.

    Alpha is 1. If the segment has columns, it is the share of the samples that see the surface.
    """
    first, columns, alpha, weights = row.gathered, row.columns, row.surfaces.alpha, row.weights
    one, pixel_columns_address = vec.f32(1.0), context.columns
    for x in range(begin, end, vec.LANES):
        vec.store(columns, first + x - begin, pixel_columns(pixel_columns_address, x))
        vec.store(alpha, first + x - begin, one)
    if pixel_columns_address != 0:
        for x in range(begin, end):
            alpha[first + x - begin] = f32(weights[x]) * f32(0.125)


@device_function
def _gather(job: StudioInputs, context: ShadingContext, row: _StudioRow, span: I64, end_span: I64) -> None:
    """Gather the surfaces of the spans ``span .. end_span`` of the selected instance.

    If there is not enough memory for them, the surfaces gathered before are lit first.
    """
    fill = i64(COLOR)
    if row.mode == BENEATH:
        fill = i64(COLOR_AND_ALPHA)
    elif row.mode == WRITE_ALPHA:
        fill = i64(ALPHA)
    surfaces, starts = row.surfaces, context.span_starts
    begin, end = i64(starts[span]), i64(starts[end_span])
    while begin < end:
        part_end, part_end_span = find_part_end(context, span, begin, end)
        count = part_end - begin
        if row.gathered + count > MAX_PART_PIXELS:
            _light_and_blend(job, row)
        set_up_part(context, span, part_end_span, end_span)
        interpolate(context, begin, part_end)
        _fill_columns(context, row, begin, part_end)
        first = row.gathered
        needs_light = fill_surfaces(context, fill, count, surfaces, first)
        if row.mode == WRITE_ALPHA:
            for k in range(first, first + count):
                row.accumulated[row.columns[k]] = surfaces.alpha[k]
        elif needs_light:
            row.gathered = first + count
        else:
            _blend(row, surfaces.emitted, first, first + count)
        begin, span = part_end, part_end_span


@device_function
def _shade_row(
    job: StudioInputs,
    context: ShadingContext,
    row: _StudioRow,
    y: I64,
    ids: Pointer[I32],
    columns: I64,
    count: I64,
    instance_index: I64,
) -> I64:
    """Shade the pixels of one row and blend them into its accumulated row; return the index of the last instance.

    ``instance_index`` is that of the instance that probably owns the first primitive.
    """
    span_count = find_spans(context, y, columns, ids, count)
    span = i64(0)
    while span < span_count:
        end_span, instance_index, is_background = bind_next_segment(context, span, span_count, instance_index)
        if not is_background:
            _gather(job, context, row, span, end_span)
        span = end_span
    _light_and_blend(job, row)
    return instance_index


@inlined
def _scale_mixed_pixels(accumulated: Pointer[F32], channel_size: I64, mixed: Pointer[I32], count: I32) -> None:
    """Scale the mixed pixels of a row by the share of the samples that see the pixel's main surface.

    ``mixed`` has ``count`` values of the field ``mixed`` of SampleBand.
    """
    for k in range(count):
        value = i64(mixed[k])
        share = f32((value >> 4) & 15) * f32(0.125)
        for c in range(4):
            accumulated[c * channel_size + (value >> 8)] *= share


@device_function
def _clear(values: Pointer[F32], count: I64) -> None:
    """Set the first ``count`` values, a multiple of the lanes, to 0."""
    for x in range(0, count, vec.LANES):
        vec.store(values, x, vec.f32(0.0))


@kernel
def shade_rows(job_address: Address, band_address: Address, stride: I64, row_begin: I64, row_end: I64) -> None:
    """Shade the rows ``row_begin .. row_end`` of a layer, as a ``visibility_buffer.SampledShader`` shades bands.

    Rows are independent of each other.

    Args:
        job_address: a StudioInputs.
        band_address: a SampleBand that begins with row ``row_begin``; without ``EDGES``, only its ``ids`` are set.
    """
    job, band = StudioInputs(job_address), SampleBand(band_address)
    mode, width, channel_size = job.mode, job.width, channel_values_in_kernel(job.width)
    context, row, surfaces = ShadingContext(), _StudioRow(), StudioSurfaces()
    allocate_row_memory(context, job.shading, max(width, band.max_entries), PartSpans(), PartPixels())
    row.mode, row.channel_size, row.gathered = mode, channel_size, 0
    _clear(f32_at(address(surfaces)), _SURFACES_VALUES)  # loops overrun the gathered surfaces
    own_row, packed_row = f32_at(allocate(4 * 4 * channel_size)), i32_at(allocate(4 * channel_size))
    row.accumulated, row.surfaces, row.columns = own_row, surfaces, _new_columns()
    instance_index, stop = i64(0), job.lighting.stop
    for y in range(row_begin, row_end):
        if is_set(stop):
            break
        band_row = y - row_begin
        if job.target != 0:
            row.accumulated = advance(f32_at(job.target), (1 if mode == WRITE_ALPHA else 4) * y * channel_size)
        else:
            _clear(row.accumulated, 4 * channel_size)
        ids = advance(band.ids, band_row * stride)
        instance_index = _shade_row(job, context, row, y, ids, i64(0), width, instance_index)
        if mode == EDGES:
            mixed = advance(band.mixed, band_row * stride)
            _scale_mixed_pixels(row.accumulated, channel_size, mixed, band.mixed_counts[band_row])
            first_entry = band_row * band.max_entries
            ids = advance(band.entry_ids, first_entry)
            columns, count = address(advance(band.entry_columns, first_entry)), i64(band.counts[band_row])
            row.weights = advance(band.entry_weights, first_entry)
            instance_index = _shade_row(job, context, row, y, ids, columns, count, instance_index)
        if job.target == 0:
            write_image_row(row.accumulated, job.output, y, width, packed_row)
    free_row_memory(context)
    release(address(own_row))
    release(address(packed_row))
