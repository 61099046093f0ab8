"""Perspective-correct attributes of pixels: the weighted sums of ``span_setup``, divided by the sum of the weights.

Both are evaluated at eight neighbouring pixels, which belong to at most eight spans.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import i32_at
from renderers.shading.layout import HAS_COLORS, HAS_TANGENTS, HAS_UV0, HAS_UV1, SPAN_STRIDE, STRIDE
from renderers.shading.vec3 import store3

_WEIGHTED: Final = HAS_UV0 | HAS_UV1 | HAS_COLORS | HAS_TANGENTS
"""Attributes that are divided by the sum of the weights."""


@inlined
def _starts_after(masks, x):
    """Return int64, a bit for each of the pixels x + 1 .. x + 9 of a row, set where a span begins.

    Args:
        masks: as in SEGMENT.
    """
    word, bit = (x + 1) >> 6, (x + 1) & 63
    low = np.uint64(masks[word]) >> np.uint64(bit)
    return np.int64((low | ((np.uint64(masks[word + 1]) << np.uint64(63 - bit)) << np.uint64(1))) & np.uint64(255))


@inlined
def pixel_columns(columns, x):
    """Return the image columns of the pixels x .. x + 8 of a row, i32x8; ``columns`` as in SEGMENT."""
    if columns != 0:
        return vec.load(i32_at(columns), x)
    return vec.i32(x) + vec.iota()


@inlined
def _span_values(rows, row, span, offsets):
    """Return the values in a row of SPANS for the spans of eight pixels, f32x8.

    Args:
        rows: pointer to a field of SPANS, of which ``row`` is one row.
        span: index of the first pixel's span within the part.
        offsets: i32x8, index of each pixel's span, counted from ``span``.
    """
    return vec.permute(vec.load(rows, row * SPAN_STRIDE + span), offsets)


@inlined
def _along_span(rows, row, count, span, offsets, t):
    """Return a value that is linear along spans, at eight pixels, f32x8.

    Args:
        rows, span, offsets: as in ``_span_values``.
        row: row of the value at the first pixel of each span. Its change per pixel is ``count`` rows further.
        t: f32x8, pixels from the beginning of each pixel's span.
    """
    return _span_values(rows, row, span, offsets) + _span_values(rows, row + count, span, offsets) * t


@device_function
def _clear(rows, row, count, pixel_count):
    """Fill ``count`` rows of PIXELS from ``row`` on with zeros."""
    for k in range(row, row + count):
        for x in range(0, pixel_count, vec.LANES):
            vec.store(rows, k * STRIDE + x, vec.f32(0.0))


@inlined
def interpolate(segment, begin, end):
    """Fill PIXELS with the attributes of the row's pixels ``begin .. end``; ``set_up_spans`` has filled SPANS.

    Up to seven further values per row are overwritten. Texture coordinates that the material reads and the mesh lacks
    become 0, as do their gradients.
    """
    spans, pixels, masks, columns = segment.spans, segment.pixels, segment.masks, segment.columns
    attributes, span_offsets = segment.attributes, segment.job.span_offsets
    has_gradients, has_surface = segment.material.has_gradients != 0, segment.material.has_surface != 0
    span = np.int64(0)
    for x in range(begin, end, vec.LANES):
        pixel = x - begin
        starts = _starts_after(masks, x)
        offsets = vec.load(span_offsets, vec.LANES * (starts & 127))
        column = vec.to_f32(pixel_columns(columns, x))
        t = column - _span_values(spans.begin, 0, span, offsets)
        normal = (
            _along_span(spans.normal, 0, 3, span, offsets, t),
            _along_span(spans.normal, 1, 3, span, offsets, t),
            _along_span(spans.normal, 2, 3, span, offsets, t),
        )
        store3(pixels.normal, pixel, STRIDE, normal)
        if attributes & _WEIGHTED or has_surface:
            weight_sum = _along_span(spans.weight_sum, 0, 1, span, offsets, t)
            inv_weight_sum = vec.f32(1.0) / weight_sum
            for uv_set in range(2):
                if attributes & (HAS_UV0 << uv_set):
                    for k in range(2):
                        uv = _along_span(spans.uv, 4 * uv_set + k, 2, span, offsets, t) * inv_weight_sum
                        vec.store(pixels.uv, (2 * uv_set + k) * STRIDE + pixel, uv)
                        if has_gradients:
                            _store_gradient(segment, uv_set, k, pixel, span, offsets, uv, inv_weight_sum)
            if attributes & HAS_COLORS:
                for k in range(4):
                    color = _along_span(spans.color, k, 4, span, offsets, t) * inv_weight_sum
                    vec.store(pixels.color, k * STRIDE + pixel, color)
            if attributes & HAS_TANGENTS:
                vec.store(pixels.facing, pixel, _span_values(spans.facing, 0, span, offsets))
                for k in range(4):
                    vec.store(pixels.tangent, k * STRIDE + pixel, _along_span(spans.tangent, k, 4, span, offsets, t))
            if has_surface:
                _store_surface(segment, column, pixel, span, offsets, weight_sum)
        span += vec.count_bits(starts)
    for uv_set in range(2):
        if segment.material.uv_sets & (1 << uv_set) and not attributes & (HAS_UV0 << uv_set):
            _clear(pixels.uv, 2 * uv_set, 2, end - begin)
            _clear(pixels.uv_gradient, 4 * uv_set, 4, end - begin)


@inlined
def _store_gradient(segment, uv_set, k, pixel, span, offsets, uv, inv_weight_sum):
    """Store how u (``k`` = 0) or v (1) of eight pixels changes per column and per row of the image.

    Let U be the weighted sum of u, and W the sum of the weights. Both are linear over the image, and u = U / W, so that
    du/dx = (dU/dx - u dW/dx) / W.

    Args:
        pixel: index in the part of the first of the pixels.
        span, offsets: as in ``_span_values``.
        uv: f32x8, u or v.
        inv_weight_sum: f32x8, 1 / W.
    """
    spans = segment.spans
    for axis in range(2):  # columns, rows
        row = 4 * uv_set + 2 * axis + k
        weight_sum_gradient = _span_values(spans.weight_sum_gradient, axis, span, offsets)
        gradient = (_span_values(spans.uv_gradient, row, span, offsets) - uv * weight_sum_gradient) * inv_weight_sum
        vec.store(segment.pixels.uv_gradient, row * STRIDE + pixel, gradient)


@device_function
def _store_surface(segment, column, pixel, span, offsets, weight_sum):
    """Store ``flat_normal`` and ``point`` of eight pixels.

    Args:
        column: f32x8, image columns of the pixels.
        pixel, span, offsets: as in ``_store_gradient``.
        weight_sum: f32x8, sums of the weights.
    """
    spans, pixels, job = segment.spans, segment.pixels, segment.job
    z = _span_values(spans.depth, 0, span, offsets) / weight_sum
    x = (column + vec.f32(0.5 - job.cx)) * vec.f32(1.0 / job.fx) * z
    y = vec.f32((segment.y + 0.5 - job.cy) / job.fy) * z
    store3(pixels.point, pixel, STRIDE, (x, y, z))
    for k in range(3):
        vec.store(pixels.flat_normal, k * STRIDE + pixel, _span_values(spans.flat_normal, k, span, offsets))
