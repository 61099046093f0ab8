"""Perspective-correct attributes of pixels, after ``span_setup``: ``sum(b_i a_i) / sum(b_i)``.

Evaluates both sums at eight neighbouring pixels, which belong to at most eight spans.
"""

from __future__ import annotations

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import f32_at, f64_at, i32_at, i64_at
from renderers.shading.layout import (
    A_COLOR,
    A_FACING,
    A_FLAT,
    A_GRADIENT0,
    A_GRADIENT1,
    A_NORMAL,
    A_POINT,
    A_TANGENT,
    A_UV0,
    A_UV1,
    G_COLUMNS,
    G_HAS,
    G_LANES,
    G_LENS,
    G_MASKS,
    G_MATERIAL_INTEGERS,
    G_PIXELS,
    G_SPANS,
    G_SURFACE,
    G_Y,
    HAS_COLORS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    SPAN_ROOM,
    STRIDE,
    T_BEGIN,
    T_COLOR,
    T_DEPTH,
    T_FACING,
    T_FLAT,
    T_NORMAL,
    T_TANGENT,
    T_TOTAL,
    T_TOTAL_GRADIENT,
    T_UV0,
    T_UV0_GRADIENT,
    T_UV1,
    T_UV1_GRADIENT,
)
from renderers.shading.materials import MI_UV


@inlined
def _starts_after(masks, x):
    """Bits of the eight pixels after pixel ``x`` at which a span begins."""
    word, bit = (x + 1) >> 6, (x + 1) & 63
    low = np.uint64(masks[word]) >> np.uint64(bit)
    return np.int64((low | ((np.uint64(masks[word + 1]) << np.uint64(63 - bit)) << np.uint64(1))) & np.uint64(255))


@inlined
def _span_values(spans, row, at, lanes):
    return vec.permute(vec.load(spans, row * SPAN_ROOM + at), lanes)


@inlined
def _along_span(spans, row, count, at, lanes, t):
    """A value of eight pixels that is linear along their spans; its change is ``count`` rows further."""
    return _span_values(spans, row, at, lanes) + _span_values(spans, row + count, at, lanes) * t


@device_function
def _clear(pixels, row, rows, begin, end):
    """Fill rows with zeros."""
    for k in range(row, row + rows):
        for x in range(begin, end, vec.LANES):
            vec.store(pixels, k * STRIDE + x, vec.f32(0.0))


@device_function
def interpolate(segment, begin, end, to):
    """Fill the rows A_ from value ``to`` on with the attributes of the pixels ``begin .. end``, after ``set_up_spans``.

    Up to seven further values are overwritten. Texture coordinates that the material reads and the mesh lacks become 0,
    as do their gradients.
    """
    spans, pixels = f32_at(segment[G_SPANS]), f32_at(segment[G_PIXELS])
    masks, has, columns = i64_at(segment[G_MASKS]), segment[G_HAS], segment[G_COLUMNS]
    lane_tables = i32_at(segment[G_LANES])
    at = np.int64(0)
    for x in range(begin, end, vec.LANES):
        to_x = to + x - begin
        starts = _starts_after(masks, x)
        lanes = vec.load(lane_tables, vec.LANES * (starts & 127))
        column = vec.i32(x) + vec.iota()
        if columns != 0:
            column = vec.load(i32_at(columns), x)
        t = vec.to_f32(column) - _span_values(spans, T_BEGIN, at, lanes)
        nx, ny, nz = (
            _along_span(spans, T_NORMAL, 3, at, lanes, t),
            _along_span(spans, T_NORMAL + 1, 3, at, lanes, t),
            _along_span(spans, T_NORMAL + 2, 3, at, lanes, t),
        )
        vec.store(pixels, A_NORMAL * STRIDE + to_x, nx)
        vec.store(pixels, (A_NORMAL + 1) * STRIDE + to_x, ny)
        vec.store(pixels, (A_NORMAL + 2) * STRIDE + to_x, nz)
        if has & (HAS_UV0 | HAS_COLORS | HAS_UV1 | HAS_TANGENTS):
            share = vec.f32(1.0) / _along_span(spans, T_TOTAL, 1, at, lanes, t)
            if has & HAS_UV0:
                for j in range(2):
                    vec.store(
                        pixels, (A_UV0 + j) * STRIDE + to_x, _along_span(spans, T_UV0 + j, 2, at, lanes, t) * share
                    )
            if has & HAS_UV1:
                for j in range(2):
                    vec.store(
                        pixels, (A_UV1 + j) * STRIDE + to_x, _along_span(spans, T_UV1 + j, 2, at, lanes, t) * share
                    )
            if has & HAS_COLORS:
                for j in range(4):
                    vec.store(
                        pixels, (A_COLOR + j) * STRIDE + to_x, _along_span(spans, T_COLOR + j, 4, at, lanes, t) * share
                    )
            if has & HAS_TANGENTS:
                vec.store(pixels, A_FACING * STRIDE + to_x, _span_values(spans, T_FACING, at, lanes))
                for j in range(4):
                    vec.store(
                        pixels, (A_TANGENT + j) * STRIDE + to_x, _along_span(spans, T_TANGENT + j, 4, at, lanes, t)
                    )
        at += vec.count_bits(starts)
    uv_sets = i64_at(segment[G_MATERIAL_INTEGERS])[MI_UV]
    for which in range(2):
        if uv_sets & (1 << which) and not has & (HAS_UV0 << which):
            _clear(pixels, A_UV0 + 2 * which, 2, to, to + end - begin)
            if segment[G_SURFACE] != 0:
                _clear(pixels, A_GRADIENT0 + 4 * which, 4, to, to + end - begin)
    if segment[G_SURFACE] != 0:
        _interpolate_surface(segment, begin, end, to)


@inlined
def _gradient(spans, pixels, row, uv, gradient, at, lanes, share, to_x):
    """Derivatives of two texture coordinates by column and row of the image.

    With u = U / T and both linear over the image, du/dx = (dU/dx - u dT/dx) / T.
    """
    for k in range(2):
        total = _span_values(spans, T_TOTAL_GRADIENT + k, at, lanes)
        for j in range(2):
            value = vec.load(pixels, (uv + j) * STRIDE + to_x)
            slope = (_span_values(spans, row + 2 * k + j, at, lanes) - value * total) * share
            vec.store(pixels, (gradient + 2 * k + j) * STRIDE + to_x, slope)


@device_function
def _interpolate_surface(segment, begin, end, to):
    """Fill the rows from A_GRADIENT0 to A_POINT after those before them."""
    spans, pixels, lens = f32_at(segment[G_SPANS]), f32_at(segment[G_PIXELS]), f64_at(segment[G_LENS])
    masks, has, columns = i64_at(segment[G_MASKS]), segment[G_HAS], segment[G_COLUMNS]
    lane_tables = i32_at(segment[G_LANES])
    left, across = vec.f32(0.5 - lens[2]), vec.f32(1.0 / lens[0])
    dy = vec.f32((segment[G_Y] + 0.5 - lens[3]) / lens[1])
    at = np.int64(0)
    for x in range(begin, end, vec.LANES):
        to_x = to + x - begin
        starts = _starts_after(masks, x)
        lanes = vec.load(lane_tables, vec.LANES * (starts & 127))
        column = vec.i32(x) + vec.iota()
        if columns != 0:
            column = vec.load(i32_at(columns), x)
        t = vec.to_f32(column) - _span_values(spans, T_BEGIN, at, lanes)
        share = vec.f32(1.0) / _along_span(spans, T_TOTAL, 1, at, lanes, t)
        z = _span_values(spans, T_DEPTH, at, lanes) * share
        vec.store(pixels, A_POINT * STRIDE + to_x, (vec.to_f32(column) + left) * across * z)
        vec.store(pixels, (A_POINT + 1) * STRIDE + to_x, dy * z)
        vec.store(pixels, (A_POINT + 2) * STRIDE + to_x, z)
        for j in range(3):
            vec.store(pixels, (A_FLAT + j) * STRIDE + to_x, _span_values(spans, T_FLAT + j, at, lanes))
        if has & HAS_UV0:
            _gradient(spans, pixels, T_UV0_GRADIENT, A_UV0, A_GRADIENT0, at, lanes, share, to_x)
        if has & HAS_UV1:
            _gradient(spans, pixels, T_UV1_GRADIENT, A_UV1, A_GRADIENT1, at, lanes, share, to_x)
        at += vec.count_bits(starts)
