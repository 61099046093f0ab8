"""Kernels of the look ``studio``: surfaces are gathered segment by segment, lit together, and blended into their row.

An *accumulated row* is four channels of ``channel_values(width)`` float32: tone-mapped linear RGB times coverage, and
coverage.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel, is_set
from renderers.compiler.pointers import address, f32_at, i32_at, i64_at, u8_at
from renderers.msaa import sample_band_at
from renderers.primitive_ids import instance_of
from renderers.shading.interpolation import interpolate
from renderers.shading.layout import (
    G_COLUMNS,
    G_RECORDS,
    G_STARTS,
    PART,
    S_COUNT,
    S_FIRST,
    STRIDE,
)
from renderers.shading.span_setup import set_up_spans
from renderers.shading.spans import begin_rows, find_spans, next_part, row_memory, segment_end, select_instance
from renderers.shading.studio.layout import (
    EDGE_SHADER,
    J_LIGHTING,
    LIGHTING,
    OUTPUT,
    R_ALPHA,
    R_EMITTED,
    R_LIGHT,
    R_VALUES,
    channel_values_in_kernel,
)
from renderers.shading.studio.lighting import light_surfaces
from renderers.shading.studio.material import ALPHA, COLOR, COLOR_AND_ALPHA, fill_surfaces
from renderers.shading.studio.tone_mapping import finish_row

ADD: Final = 0
"""Add the layer's colours with full coverage, whatever their alpha."""
BENEATH: Final = 1
"""Blend the layer behind the accumulated ones."""
EDGES: Final = 2
"""Add the surfaces that samples see: the ids and entries of a ``msaa.SAMPLE_BAND``, weighted by their samples."""
WRITE_ALPHA: Final = 3
"""Only write alpha."""

_lighting_at = LIGHTING.at
_output_at = OUTPUT.at
_edge_shader_at = EDGE_SHADER.at


@inlined
def _blend_one(mode, accumulated, channel, x, surfaces, color_row, k):
    """Blend surface k into column x."""
    share = surfaces[R_ALPHA * STRIDE + k]
    if mode == BENEATH:
        share *= max(np.float32(1.0) - accumulated[3 * channel + x], np.float32(0.0))
    for c in range(3):
        accumulated[c * channel + x] += share * surfaces[(color_row + c) * STRIDE + k]
    accumulated[3 * channel + x] += share


@device_function
def _blend(mode, accumulated, channel, columns, surfaces, color_row, begin, end):
    """Blend the surfaces ``begin .. end - 1`` into their columns.

    Args:
        accumulated: pointer to an accumulated row. channel: number of values of one of its channels.
        columns: pointer to the surfaces' image columns.
        color_row: R_LIGHT or R_EMITTED.
    """
    lane, one, zero = vec.iota(), vec.f32(1.0), vec.f32(0.0)
    for k in range(begin, end, vec.LANES):
        x, count = np.int64(columns[k]), end - k
        in_range = lane < vec.i32(count)
        if vec.movemask(in_range & (vec.load(columns, k) != vec.i32(x) + lane)) != 0:  # not neighbouring columns
            for j in range(min(count, vec.LANES)):
                _blend_one(mode, accumulated, channel, np.int64(columns[k + j]), surfaces, color_row, k + j)
            continue
        share = vec.load(surfaces, R_ALPHA * STRIDE + k)
        coverage = vec.load(accumulated, 3 * channel + x)
        if mode == BENEATH:
            share = share * vec.maximum(one - coverage, zero)
        for c in range(3):
            color = vec.load(accumulated, c * channel + x)
            added = share * vec.load(surfaces, (color_row + c) * STRIDE + k)
            vec.store(accumulated, c * channel + x, color + vec.select(in_range, added, zero))
        vec.store(accumulated, 3 * channel + x, coverage + vec.select(in_range, share, zero))


@device_function
def _light_and_blend(job, mode, accumulated, channel, columns, count, surfaces):
    """Light the first ``count`` gathered surfaces and blend them into the row."""
    if count > 0:
        light_surfaces(_lighting_at(job[J_LIGHTING]), surfaces, count)
        _blend(mode, accumulated, channel, columns, surfaces, R_LIGHT, np.int64(0), count)


@device_function
def _fill_columns(segment, begin, end, weights, columns, surfaces, first):
    """Fill ``columns`` and R_ALPHA from value ``first`` on, for the segment's pixels ``begin .. end - 1``.

    Alpha is 1, or the share of samples (``weights`` of 8) if the segment's pixels have columns of their own.
    """
    one, columns_address = vec.f32(1.0), segment[G_COLUMNS]
    for x in range(begin, end, vec.LANES):
        column = vec.i32(x) + vec.iota()
        if columns_address != 0:
            column = vec.load(i32_at(columns_address), x)
        vec.store(columns, first + x - begin, column)
        vec.store(surfaces, R_ALPHA * STRIDE + first + x - begin, one)
    if columns_address != 0:
        for x in range(begin, end):
            surfaces[R_ALPHA * STRIDE + first + x - begin] = np.float32(weights[x]) * np.float32(0.125)


@device_function
def _gather(job, segment, mode, span, end_span, weights, accumulated, channel, columns, surfaces, gathered):
    """Gather the surfaces of the spans ``span .. end_span - 1`` of the selected instance behind the ``gathered`` ones.

    If there is no room for them, those are lit first. Returns the number of gathered surfaces.
    """
    fill = np.int64(COLOR)
    if mode == BENEATH:
        fill = np.int64(COLOR_AND_ALPHA)
    elif mode == WRITE_ALPHA:
        fill = np.int64(ALPHA)
    starts = i32_at(segment[G_STARTS])
    begin, end = np.int64(starts[span]), np.int64(starts[end_span])
    while begin < end:
        part_end, last_span = next_part(segment, span, begin, end)
        count = part_end - begin
        if gathered + count > PART:
            _light_and_blend(job, mode, accumulated, channel, columns, gathered, surfaces)
            gathered = np.int64(0)
        set_up_spans(segment, span, last_span, end_span)
        interpolate(segment, begin, part_end, np.int64(0))
        _fill_columns(segment, begin, part_end, weights, columns, surfaces, gathered)
        needs_light = fill_surfaces(job, segment, fill, count, surfaces, gathered)
        if mode == WRITE_ALPHA:
            for k in range(gathered, gathered + count):
                accumulated[columns[k]] = surfaces[R_ALPHA * STRIDE + k]
        elif needs_light:
            gathered += count
        else:
            _blend(mode, accumulated, channel, columns, surfaces, R_EMITTED, gathered, gathered + count)
        begin, span = part_end, last_span
    return gathered


@device_function
def _shade_row(
    job, segment, mode, y, ids, columns_address, weights, count, instance, records, accumulated, channel, columns,
    surfaces,
):  # fmt: skip
    """Shade the pixels of one row and blend them into it.

    Args:
        ids: pointer to ``count`` int32: the records that the pixels see.
        columns_address: address of the pixels' image columns, int32; 0: pixel k is in column k.
        weights: pointer to their samples of 8, uint8; read only with ``columns_address``.
        instance: where the search for the first record's instance begins.
        records: as ``begin_rows`` returns it.
        accumulated: pointer to the accumulated row, or with ``WRITE_ALPHA`` to a row of alpha.
        columns: pointer to STRIDE int32.

    Returns:
        The last instance, for the next row.
    """
    first_record, spans = i64_at(job[S_FIRST]), i32_at(segment[G_RECORDS])
    span_count = find_spans(segment, y, columns_address, ids, count, records)
    span, gathered = np.int64(0), np.int64(0)
    while span < span_count:
        record = np.int64(spans[span])
        if record < 0:
            span = segment_end(segment, span, span_count, np.int64(-1), np.int64(0))
            continue
        instance = instance_of(first_record, job[S_COUNT], record, instance)
        end_span = segment_end(segment, span, span_count, first_record[instance], first_record[instance + 1])
        select_instance(job, segment, instance)
        gathered = _gather(
            job, segment, mode, span, end_span, weights, accumulated, channel, columns, surfaces, gathered
        )  # fmt: skip
        span = end_span
    _light_and_blend(job, mode, accumulated, channel, columns, gathered, surfaces)
    return instance


@inlined
def _scale_mixed_pixels(accumulated, channel, mixed, count):
    """Multiply the pixels of a row that other surfaces share by the samples that see their own surface.

    Args:
        mixed: pointer to ``count`` values of ``msaa.SAMPLE_BAND``'s field of this name.
    """
    for k in range(count):
        value = np.int64(mixed[k])
        share = np.float32((value >> 4) & 15) * np.float32(0.125)
        for c in range(4):
            accumulated[c * channel + (value >> 8)] *= share


@kernel("void(int64, int64, int64, int64, int64, int64, int64, int64, int64, int64)")
def shade_rows(
    mode, job_address, ids_address, band_address, stride, width, row_begin, row_end, target_address, output_address
):  # fmt: skip
    """Shade the rows ``row_begin .. row_end - 1`` of a layer. Rows are independent of each other.

    Args:
        mode: ``ADD``, ``BENEATH``, ``EDGES`` or ``WRITE_ALPHA``.
        job_address: address of J_COLUMNS int64.
        ids_address: address of the first row's records: int32 per pixel, -1 for none, rows ``stride`` values apart.
        band_address: address of the band's ``msaa.SAMPLE_BAND``; read only for ``EDGES``.
        target_address: address of (H, 4, channel_values(width)) float32, the accumulated rows of the image, or for
            ``WRITE_ALPHA`` of (H, channel_values(width)) float32. 0: rows are finished and written to the output.
        output_address: address of an OUTPUT; read only without ``target_address``.
    """
    channel = channel_values_in_kernel(width)
    job, band, output = i64_at(job_address), sample_band_at(band_address), _output_at(output_address)
    max_pixels = width
    if mode == EDGES:
        max_pixels = max(width, band.room)
    own_memory = np.empty(row_memory(max_pixels), np.int64)
    own_surfaces = np.zeros(R_VALUES, np.float32)
    own_columns = np.zeros(STRIDE, np.int32)
    own_row = np.zeros(4 * channel, np.float32)
    own_bytes = np.empty(3 * channel + 4, np.uint8)
    surfaces, columns = f32_at(np.int64(own_surfaces.ctypes.data)), i32_at(np.int64(own_columns.ctypes.data))
    accumulated, rgb_bytes = f32_at(np.int64(own_row.ctypes.data)), u8_at(np.int64(own_bytes.ctypes.data))
    segment, records = begin_rows(job, np.int64(own_memory.ctypes.data), max_pixels, np.int64(1))
    own_column, no_weights, instance = np.int64(0), u8_at(np.int64(0)), np.int64(0)
    stop = _lighting_at(job[J_LIGHTING]).stop
    for y in range(row_begin, row_end):
        if is_set(stop):
            break
        row = y - row_begin
        if target_address != 0:
            accumulated = f32_at(target_address + (4 if mode == WRITE_ALPHA else 16) * y * channel)
        else:
            for x in range(0, 4 * channel, vec.LANES):
                vec.store(accumulated, x, vec.f32(0.0))
        ids = i32_at(ids_address + 4 * row * stride)
        instance = _shade_row(
            job, segment, mode, y, ids, own_column, no_weights, width, instance, records, accumulated, channel, columns,
            surfaces,
        )  # fmt: skip
        if mode == EDGES:
            mixed = i32_at(address(band.mixed) + 4 * row * stride)
            _scale_mixed_pixels(accumulated, channel, mixed, band.mixed_counts[row])
            first_entry = row * band.room
            ids = i32_at(address(band.entry_ids) + 4 * first_entry)
            entry_columns = address(band.entry_columns) + 4 * first_entry
            weights, count = u8_at(address(band.entry_weights) + first_entry), np.int64(band.counts[row])
            instance = _shade_row(
                job, segment, mode, y, ids, entry_columns, weights, count, instance, records, accumulated, channel,
                columns, surfaces,
            )  # fmt: skip
        if target_address == 0:
            finish_row(accumulated, output, y, width, rgb_bytes)
    # The pointers above do not keep the arrays alive.
    own_surfaces[0] = own_columns[0] = own_row[0] = own_bytes[0] = own_memory[0] = 0


@kernel("void(int64, int64, int64, int64, int64)")
def shade_edges(shader_address, band_address, stride, row_begin, row_end):
    """Shade a band's pixels and those at edges, and finish its rows; see ``visibility_buffer.SampledShader``.

    Args:
        shader_address: address of an EDGE_SHADER.
        band_address: address of the band's ``msaa.SAMPLE_BAND``.
    """
    shader, ids = _edge_shader_at(shader_address), address(sample_band_at(band_address).ids)
    no_target = np.int64(0)
    call_kernel(
        shader.shade_rows,
        (EDGES, shader.job, ids, band_address, stride, shader.width, row_begin, row_end, no_target, shader.output),
    )
