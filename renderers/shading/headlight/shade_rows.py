"""Kernel of the headlight looks, which shades rows of an image segment by segment."""

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import I32, I64, Address, Pointer, i64
from renderers.compiler.pointers import address, advance, allocate, i32_at, release
from renderers.shading.headlight.layout import GATHER, UNDER, HeadlightInputs
from renderers.shading.headlight.lighting import fill_spans, is_uniform_lambert, shade
from renderers.shading.headlight.output_merge import gather, write_background, write_under
from renderers.shading.interpolation import interpolate
from renderers.shading.layout import PartPixels, PartSpans, ShadingContext
from renderers.shading.packed_rows import write_packed_row
from renderers.shading.span_setup import set_up_part
from renderers.shading.spans import allocate_row_memory, bind_next_segment, find_part_end, find_spans, free_row_memory


@inlined
def _shade_segment(
    job: HeadlightInputs, context: ShadingContext, first_span: I64, end_span: I64, packed_row: Pointer[I32]
) -> None:
    """Shade the spans ``first_span .. end_span``, of the selected instance, part by part."""
    starts, is_uniform, span = context.span_starts, is_uniform_lambert(job, context), first_span
    begin, end = i64(starts[first_span]), i64(starts[end_span])
    while begin < end:
        part_end, part_end_span = find_part_end(context, span, begin, end)
        has_constant_normals = set_up_part(context, span, part_end_span, end_span)
        if has_constant_normals and is_uniform:
            fill_spans(job, context, span, part_end_span, packed_row)
        else:
            interpolate(context, begin, part_end)
            shade(job, context, begin, part_end, packed_row)
        if job.mode == GATHER:
            gather(job, context, begin, part_end)
        elif job.mode == UNDER:
            write_under(job, context, begin, part_end, packed_row)
        begin, span = part_end, part_end_span


@inlined
def _ids_of_row(job: HeadlightInputs, y: I64) -> tuple[I64, I64]:
    """Return the number of primitive ids of a row of the image, and the segment's ``columns`` for them."""
    if job.columns == 0:
        return job.width, i64(0)
    row = y - job.first_row
    return i64(job.counts[row]), address(advance(i32_at(job.columns), row * job.stride))


@kernel
def shade_rows(job_address: Address, ids_address: Address, row_begin: I64, row_end: I64) -> None:
    """Shade the rows ``row_begin .. row_end`` of the image. Rows are independent of each other.

    Args:
        job_address: a HeadlightInputs. Its arrays of rows begin with its ``first_row``.
        ids_address: primitive ids from row ``row_begin`` on, HeadlightInputs' ``stride`` values apart: int32 per pixel,
            NO_PRIMITIVE for none.
    """
    job = HeadlightInputs(job_address)
    row_pixels = job.width + vec.LANES  # stores overrun a row by up to seven pixels
    own_row = i32_at(allocate(4 * row_pixels))
    context = ShadingContext()
    allocate_row_memory(context, job.shading, job.width, PartSpans(), PartPixels())
    span_starts, instance_index = context.span_starts, i64(0)
    for y in range(row_begin, row_end):
        id_count, columns = _ids_of_row(job, y)
        ids = advance(i32_at(ids_address), (y - row_begin) * job.stride)
        image_row = y - job.first_row
        packed_row = own_row
        if job.has_roots != 0 and job.mode != GATHER:
            packed_row = i32_at(address(job.color) + 4 * image_row * row_pixels)
        span_count = find_spans(context, y, columns, ids, id_count)
        span = i64(0)
        while span < span_count:
            end_span, instance_index, is_background = bind_next_segment(context, span, span_count, instance_index)
            if is_background:
                write_background(job, y, i64(span_starts[span]), i64(span_starts[end_span]), packed_row)
            else:
                _shade_segment(job, context, span, end_span, packed_row)
            span = end_span
        if job.mode != GATHER and job.has_roots == 0:
            write_packed_row(advance(job.color, 3 * image_row * job.width), packed_row, id_count)
    free_row_memory(context)
    release(address(own_row))
