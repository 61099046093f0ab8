"""Perspective-correct attributes of pixels: the weighted sums of ``span_setup``, divided by the sum of the weights.

Both are evaluated at eight neighbouring pixels, which belong to at most eight spans.
"""

from typing import Final

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, I64, Pointer, i64, u64
from renderers.compiler.pointers import i32_at
from renderers.compiler.simd import F32x8, I32x8
from renderers.shading.layout import HAS_COLORS, HAS_TANGENTS, HAS_UV0, HAS_UV1, ROW_STRIDE, ShadingContext
from renderers.shading.vec3 import store3

_OTHER_ATTRIBUTES: Final = HAS_UV0 | HAS_UV1 | HAS_COLORS | HAS_TANGENTS
"""Attributes other than the normal. All but tangents, whose length does not matter, are divided by the sum of the
weights."""


@inlined
def _span_starts_after(start_bits: Pointer[I64], x: I64) -> I64:
    """Return a bit for each of the pixels x + 1 .. x + 9 of a row, set where a span begins.

    The last bit, of the first pixel of the next eight, only counts: see ``interpolate``. The word of pixel x + 1 and
    the next one are read.
    """
    # The upper word moves left by 64 - bit, in two steps, since a shift by 64 is undefined.
    word, bit = (x + 1) >> 6, (x + 1) & 63
    low = u64(start_bits[word]) >> u64(bit)
    return i64((low | ((u64(start_bits[word + 1]) << u64(63 - bit)) << u64(1))) & u64(255))


@inlined
def pixel_columns(columns: I64, x: I64) -> I32x8:
    """Return the image columns of the pixels x .. x + 8 of a row; ``columns`` as in ShadingContext."""
    if columns != 0:
        return vec.load(i32_at(columns), x)
    return vec.i32(x) + vec.iota()


@inlined
def _span_values(rows: Pointer[F32], row: I64, slot: I64, offsets: I32x8) -> F32x8:
    """Return the values in ``row`` of a field of PartSpans for the spans of eight pixels: ``slot`` plus ``offsets``."""
    return vec.permute(vec.load(rows, row * ROW_STRIDE + slot), offsets)


@inlined
def _along_span(rows: Pointer[F32], row: I64, components: I64, slot: I64, offsets: I32x8, t: F32x8) -> F32x8:
    """Return a value that is linear along spans, ``t`` pixels from the beginnings of eight pixels' spans.

    ``row`` has the value at the first pixel of each span. Its change per pixel is ``components`` rows further.
    """
    return _span_values(rows, row, slot, offsets) + _span_values(rows, row + components, slot, offsets) * t


@device_function
def _clear(rows: Pointer[F32], row: I64, row_count: I64, count: I64) -> None:
    """Fill ``row_count`` rows of PartPixels from ``row`` on with zeros."""
    for k in range(row, row + row_count):
        for x in range(0, count, vec.LANES):
            vec.store(rows, k * ROW_STRIDE + x, vec.f32(0.0))


@inlined
def interpolate(context: ShadingContext, begin: I64, end: I64) -> None:
    """Fill PartPixels for the row's pixels ``begin .. end`` from PartSpans.

    Up to seven further values per row are overwritten. Texture coordinates that the material reads and the mesh lacks
    become 0, as do their gradients.
    """
    spans, pixels, start_bits, columns = context.part_spans, context.pixels, context.start_bits, context.columns
    attribute_bits, span_index_of = context.used_attribute_bits, context.inputs.span_index_of_start_bits
    reads_gradients, reads_positions = context.material.reads_gradients != 0, context.inputs.reads_positions != 0
    slot = i64(0)
    for x in range(begin, end, vec.LANES):
        pixel = x - begin  # in the part, as in _store_gradient
        # Seven start bits select a row of ``spans.SPAN_INDEX_OF_START_BITS``. The eighth is that of the next vector's
        # first pixel: counted with the others, it moves ``slot`` on to that pixel's span.
        starts = _span_starts_after(start_bits, x)
        offsets = vec.load(span_index_of, vec.LANES * (starts & 127))
        column = vec.to_f32(pixel_columns(columns, x))
        t = column - _span_values(spans.first_column, 0, slot, offsets)
        normal = (
            _along_span(spans.normal, 0, 3, slot, offsets, t),
            _along_span(spans.normal, 1, 3, slot, offsets, t),
            _along_span(spans.normal, 2, 3, slot, offsets, t),
        )
        store3(pixels.normal, pixel, ROW_STRIDE, normal)
        if attribute_bits & _OTHER_ATTRIBUTES or reads_positions:
            weight_sum = _along_span(spans.weight_sum, 0, 1, slot, offsets, t)
            inv_weight_sum = vec.f32(1.0) / weight_sum
            for uv_set in range(2):
                if attribute_bits & (HAS_UV0 << uv_set):
                    for k in range(2):  # rows of a set in PartSpans: u, v, and their changes
                        uv = _along_span(spans.uv, 4 * uv_set + k, 2, slot, offsets, t) * inv_weight_sum
                        vec.store(pixels.uv, (2 * uv_set + k) * ROW_STRIDE + pixel, uv)
                        if reads_gradients:
                            _store_gradient(context, uv_set, k, pixel, slot, offsets, uv, inv_weight_sum)
            if attribute_bits & HAS_COLORS:
                for k in range(4):
                    color = _along_span(spans.color, k, 4, slot, offsets, t) * inv_weight_sum
                    vec.store(pixels.color, k * ROW_STRIDE + pixel, color)
            if attribute_bits & HAS_TANGENTS:
                # ``material`` reads which side is seen with tangents only.
                vec.store(pixels.facing, pixel, _span_values(spans.facing, 0, slot, offsets))
                for k in range(4):
                    vec.store(
                        pixels.tangent, k * ROW_STRIDE + pixel, _along_span(spans.tangent, k, 4, slot, offsets, t)
                    )
            if reads_positions:
                _store_surface(context, column, pixel, slot, offsets, t)
        slot += vec.count_bits(starts)
    for uv_set in range(2):  # sets that the material reads and the mesh lacks
        if context.material.uv_sets & (1 << uv_set) and not attribute_bits & (HAS_UV0 << uv_set):
            _clear(pixels.uv, 2 * uv_set, 2, end - begin)
            _clear(pixels.uv_gradient, 4 * uv_set, 4, end - begin)


@inlined
def _store_gradient(
    context: ShadingContext, uv_set: I64, k: I64, pixel: I64, slot: I64, offsets: I32x8, uv: F32x8, inv_sum: F32x8
) -> None:
    """Store how u (``k`` = 0) or v (1) of eight pixels changes per column and per row of the image.

    Let U be the weighted sum of u, and W the sum of the weights. Both are linear over the image, and u = U / W, so that
    du/dx = (dU/dx - u dW/dx) / W. ``inv_sum`` is 1 / W.
    """
    spans = context.part_spans
    for axis in range(2):  # columns, rows
        # In PartSpans and in PartPixels: du/dx, dv/dx, du/dy, dv/dy of uv0, then of uv1.
        row = 4 * uv_set + 2 * axis + k
        weight_sum_gradient = _span_values(spans.weight_sum_gradient, axis, slot, offsets)
        gradient = (_span_values(spans.uv_gradient, row, slot, offsets) - uv * weight_sum_gradient) * inv_sum
        vec.store(context.pixels.uv_gradient, row * ROW_STRIDE + pixel, gradient)


@device_function
def _store_surface(context: ShadingContext, columns: F32x8, pixel: I64, slot: I64, offsets: I32x8, t: F32x8) -> None:
    """Store ``position`` of eight pixels in these columns of the image, and ``flat_normal`` if it is read."""
    spans, pixels, inputs = context.part_spans, context.pixels, context.inputs
    z = vec.f32(1.0) / _along_span(spans.inv_z, 0, 1, slot, offsets, t)
    x = (columns + vec.f32(0.5 - inputs.cx)) * vec.f32(1.0 / inputs.fx) * z
    y = vec.f32((context.y + 0.5 - inputs.cy) / inputs.fy) * z
    store3(pixels.position, pixel, ROW_STRIDE, (x, y, z))
    if inputs.reads_flat_normals != 0:
        for k in range(3):
            vec.store(pixels.flat_normal, k * ROW_STRIDE + pixel, _span_values(spans.flat_normal, k, slot, offsets))
