"""Rasterization of a band with one sample per pixel: coverage and depth test of the primitives."""

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.kernel_types import F32, I32, I64, Address, f64, i64
from renderers.compiler.pointers import address, stack_array
from renderers.compiler.simd import F64x8x2, I32x8
from renderers.compiler.structs import Struct
from renderers.raster.chunks import pixels_between, primitives_in_bin
from renderers.raster.depth_test import ANY_ORDER, IN_ORDER, PEELED, depth_test, depth_test_pixel
from renderers.raster.fill import Pixel, make_fill
from renderers.raster.layout import (
    COLOR_FACES,
    HALF_PIXEL,
    KEPT_BACK_BIT,
    KEPT_BACK_FACES,
    KIND_SMALL,
    SUBPIXEL,
    Chunk,
    Layer,
    Primitive,
    RasterFrame,
    SmallTriangle,
    set_band_layer,
)
from renderers.raster.small_triangles import SmallTriangleSpans, draw_small, find_small_spans
from renderers.visibility_buffer import BAND_ROWS


class _Target(Struct):
    """The layer that primitives are drawn into and its depth rule, and memory for the spans of a small triangle."""

    layer: Layer
    depth_rule: I64
    small_spans: SmallTriangleSpans


_inv_z_array = stack_array(F32, vec.LANES)
_span_array = stack_array(I32, 2 * vec.LANES)


@inlined
def _sample_points(frame: RasterFrame, row: I64) -> F64x8x2:
    """Return x, y of the sample points of eight rows, grid units, as ``make_fill`` wants them.

    x, the offset from the pixel's centre, is 0; y counts from the image's top.
    """
    lane = vec.to_f64(vec.iota())
    return vec.f64(0.0), (vec.f64(row) + lane) * vec.f64(float(SUBPIXEL)) + vec.f64(float(HALF_PIXEL))


@device_function
def _draw_span(
    frame: RasterFrame, target: _Target, primitive: Primitive, row: I64, start: I64, stop: I64, base: Pixel
) -> None:
    """Draw the pixels ``start .. stop`` of a row.

    1/z is exact to float32 at the first pixel of every vector, wherever the span starts.
    """
    layer, depth_rule, dx = target.layer, target.depth_rule, primitive.inv_z_dx
    row_inv_z = primitive.inv_z_base + primitive.inv_z_dy * f64(row - base.y)
    inv_z_min, inv_z_max = vec.f32(primitive.inv_z_min), vec.f32(primitive.inv_z_max)
    ids, lane = vec.i32(primitive.id), vec.iota()
    # Strips of eight vectors of eight columns. 1/z at the first pixel of each vector is computed in float64, for all of
    # a strip at once, and rounded to float32. Along a vector, float32 is enough.
    first_inv_z = _inv_z_array()
    first_offsets = vec.to_f64(lane * vec.i32(vec.LANES))
    lane_inv_z = vec.f32(dx) * vec.to_f32(lane)
    aligned_start = start & ~i64(vec.LANES - 1)
    pixel = (row - layer.first_row) * frame.stride + aligned_start
    for strip_column in range(aligned_start, stop, vec.LANES * vec.LANES):
        from_base = vec.f64(strip_column - base.x) + first_offsets
        vec.store(first_inv_z, 0, vec.to_f32(vec.f64(row_inv_z) + vec.f64(dx) * from_base))
        columns = vec.i32(strip_column) + lane
        for k in range(min((stop - strip_column + vec.LANES - 1) // vec.LANES, vec.LANES)):
            inv_z = vec.minimum(vec.maximum(vec.f32(first_inv_z[k]) + lane_inv_z, inv_z_min), inv_z_max)
            covered = (columns >= vec.i32(start)) & (columns < vec.i32(stop))
            depth_test(frame, layer, depth_rule, pixel, inv_z, covered, ids)
            columns = columns + vec.i32(vec.LANES)
            pixel += vec.LANES


@inlined
def _draw_spans(
    frame: RasterFrame,
    target: _Target,
    primitive: Primitive,
    row: I64,
    count: I64,
    start: I32x8,
    stop: I32x8,
    base: Pixel,
) -> None:
    """Draw ``count`` rows from ``row`` on, each in the columns of its lane of ``start`` and ``stop``."""
    spans = _span_array()
    vec.store(spans, 0, start)
    vec.store(spans, vec.LANES, stop)
    for k in range(count):
        row_start, row_stop = i64(spans[k]), i64(spans[vec.LANES + k])
        if row_start < row_stop:
            _draw_span(frame, target, primitive, row + k, row_start, row_stop, base)


@inlined
def _draw_point(frame: RasterFrame, target: _Target, primitive: Primitive, first_row: I64, end_row: I64) -> None:
    """Draw a KIND_POINT."""
    geometry = primitive.geometry
    left, top, right, bottom = i64(geometry[0]), i64(geometry[1]), i64(geometry[2]), i64(geometry[3])
    # 1/z is constant, so that any pixel serves as base.
    for row in range(max(top, first_row), min(bottom, end_row)):
        _draw_span(frame, target, primitive, row, left, right, Pixel(left, top))


# Draws large primitives. For every eight rows it calls _sample_points, finds the columns, and calls _draw_spans with
# them. For a KIND_POINT it calls _draw_point alone.
_fill = make_fill(vec.LANES, _sample_points, _draw_spans, _draw_point)


@device_function
def _draw_primitive(frame: RasterFrame, target: _Target, primitive: Primitive, first_row: I64, end_row: I64) -> None:
    """Draw some rows of a Primitive or SmallTriangle."""
    if primitive.kind == KIND_SMALL:
        find_small_spans(frame, SmallTriangle(address(primitive)), first_row, end_row, target.small_spans)
        draw_small(frame, target.layer, target.depth_rule, target.small_spans)
    elif not is_set(frame.stop):  # before each large one: it may take longer than hundreds of small ones
        _fill(frame, target, primitive, first_row, end_row)


@device_function
def _clear_rows(frame: RasterFrame, layer: Layer, first_row: I64, end_row: I64) -> None:
    """Clear a layer's rows."""
    begin, end = (first_row - layer.first_row) * frame.stride, (end_row - layer.first_row) * frame.stride
    # Nothing beyond this 1/z passes the depth test: the far plane needs no test of its own.
    empty_inv_z, no_id = vec.f32(frame.inv_z_far), vec.i32(-1)
    # One array after the other: consecutive stores to a cache line are combined.
    for pixel in range(begin, end, vec.LANES):
        vec.store(layer.ids, pixel, no_id)
    for pixel in range(begin, end, vec.LANES):
        vec.store(layer.inv_z, pixel, empty_inv_z)


@device_function
def _draw_pixels(frame: RasterFrame, target: _Target, chunk: Chunk, begin: I64, end: I64) -> None:
    """Draw a chunk's pixels of tiny triangles whose Chunk.fragment_pixels are ``begin .. end``."""
    layer, depth_rule = target.layer, target.depth_rule
    layer_begin = layer.first_row * frame.stride
    for k in range(0, chunk.fragment_count, vec.LANES):
        pending = pixels_between(chunk, k, begin, end)
        while pending != 0:
            j = k + vec.lowest_bit(pending)
            pending &= pending - 1
            pixel = i64(chunk.fragment_pixels[j] & ~KEPT_BACK_BIT) - layer_begin
            depth_test_pixel(frame, layer, depth_rule, pixel, chunk.fragment_inv_z[j], chunk.fragment_ids[j])


@inlined
def _depth_rule(frame: RasterFrame, faces: I64) -> I64:
    """Return the rule of ``depth_test``; ``faces`` as for ``draw_band``."""
    if faces == KEPT_BACK_FACES:
        # Drawn after the front faces, some of which have higher ids. Never PEELED: only opaque frames keep back faces.
        return ANY_ORDER
    # A pass of depth peeling has layers that bound it, or takes the latest primitive.
    is_peeling = frame.near_bound_ids != 0 or frame.far_bound_ids != 0 or frame.id_limits != 0
    return PEELED if is_peeling or frame.highest_id_wins != 0 else IN_ORDER


@device_function
def _draw_chunk(frame: RasterFrame, target: _Target, chunk: Chunk, first_row: I64, end_row: I64, faces: I64) -> None:
    """Draw what a Chunk has in a band; ``faces`` as for ``draw_band``.

    Primitives are drawn in the order of their ids; pixels of tiny triangles compare ids themselves.
    """
    bin_index, begin_pixel, end_pixel = first_row // BAND_ROWS, first_row * frame.stride, end_row * frame.stride
    if faces == KEPT_BACK_FACES:
        # With KEPT_BACK_BIT, the sign bit of int32, pixels are negative and in the same order. So a range of front
        # faces' pixels has none of back faces, and the other way round.
        bin_index += frame.first_back_bin
        begin_pixel, end_pixel = begin_pixel | KEPT_BACK_BIT, end_pixel | KEPT_BACK_BIT
    for k in range(0, chunk.primitive_count, vec.LANES):
        pending = primitives_in_bin(chunk, k, bin_index)
        while pending != 0:
            _draw_primitive(frame, target, chunk.primitives[k + vec.lowest_bit(pending)], first_row, end_row)
            pending &= pending - 1
    _draw_pixels(frame, target, chunk, begin_pixel, end_pixel)


@kernel
def draw_band(frame_address: Address, first_row: I64, end_row: I64, band_memory: Address, faces: I64) -> None:
    """Rasterize the COLOR_FACES or KEPT_BACK_FACES of a band."""
    frame = RasterFrame(frame_address)
    layer, target = Layer(), _Target()
    set_band_layer(frame, layer, first_row, band_memory)
    target.layer, target.small_spans = layer, SmallTriangleSpans()
    target.depth_rule = _depth_rule(frame, faces)
    if faces == COLOR_FACES:
        _clear_rows(frame, layer, first_row, end_row)
    band = first_row // BAND_ROWS
    for index in range(frame.chunk_count):
        chunk = frame.chunks[index]
        if chunk.first_band <= band and band <= chunk.last_band:
            if is_set(frame.stop):
                break
            _draw_chunk(frame, target, chunk, first_row, end_row, faces)
