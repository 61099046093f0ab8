"""From shaded pixels to the image: bytes, translucent layers, background.

``packed_row`` is a pointer to a row of ``packed_rows``. *Gathered* layers are the
translucent layers blended so far: four channels of float32, one after the other, for red, green, blue and
transmittance. Their rows are eight values longer than those of the image.
"""

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, I32, I64, Pointer, f32
from renderers.compiler.pointers import advance
from renderers.compiler.simd import F32x8, I32x8
from renderers.shading.gamma import byte_from_unit, decode_gamma, encode_gamma
from renderers.shading.headlight.layout import DIRECT, UNDER, HeadlightInputs
from renderers.shading.layout import ROW_STRIDE, ShadingContext
from renderers.shading.level_cells import encoded_pixels
from renderers.shading.material import opacity
from renderers.shading.vec3 import load3, saturate


@inlined
def packed_pixels(job: HeadlightInputs, r: F32x8, g: F32x8, b: F32x8) -> I32x8:
    """Return eight encoded colours, 0 .. 1, as packed pixels, red in the lowest byte; with ``has_roots``, as roots."""
    if job.has_roots != 0:
        table = job.shading.linear_from_gamma
        return _roots(decode_gamma(r, table), decode_gamma(g, table), decode_gamma(b, table))
    return byte_from_unit(r) | (byte_from_unit(g) << vec.i32(8)) | (byte_from_unit(b) << vec.i32(16))


@inlined
def _root(c: F32x8, steps: float) -> I32x8:
    """Return the square root of linear light, rounded to one of ``steps`` + 1 values."""
    return vec.to_i32(vec.sqrt(saturate(c)) * vec.f32(steps) + vec.f32(0.5))


@inlined
def _roots(r: F32x8, g: F32x8, b: F32x8) -> I32x8:
    """Return eight linear colours as in Frame.roots."""
    return _root(r, 2047.0) | (_root(g, 2047.0) << vec.i32(11)) | (_root(b, 1023.0) << vec.i32(22))


@inlined
def write_pixels(
    job: HeadlightInputs, is_linear: bool, packed_row: Pointer[I32], x: I64, r: F32x8, g: F32x8, b: F32x8
) -> None:
    """Store eight shaded pixels in a packed row from pixel x on; ``is_linear``: linear light, encoded first."""
    if is_linear and job.has_roots != 0:
        vec.store(packed_row, x, _roots(r, g, b))
    elif is_linear:
        vec.store(packed_row, x, encoded_pixels(r, g, b, job.gamma_cells))
    else:
        vec.store(packed_row, x, packed_pixels(job, r, g, b))


@inlined
def _encoded(job: HeadlightInputs, is_linear: bool, c: F32x8) -> F32x8:
    """Return the value, 0 .. 1, that ``write_pixels`` would round to a byte."""
    if is_linear:
        return encode_gamma(c, job.gamma_from_linear)
    return saturate(c)


@inlined
def _gathered_row(job: HeadlightInputs, y: I64) -> tuple[Pointer[F32], I64]:
    """Return a pointer to row y of the gathered layers' first channel, and the number of values of a whole channel."""
    row_values = job.width + vec.LANES
    return advance(job.gathered, row_values * y), row_values * job.height


@device_function
def gather(job: HeadlightInputs, context: ShadingContext, begin: I64, end: I64) -> None:
    """Blend the row's pixels ``begin .. end`` under the layers gathered so far, encoded as stored, as VTK does.

    Their colour and alpha are in the rows ``base_color`` of PartPixels.
    """
    gathered, channel_size = _gathered_row(job, context.y)
    material, pixels, is_linear = context.material, context.pixels, context.material.encodes_gamma != 0
    zero, one, lane = vec.f32(0.0), vec.f32(1.0), vec.iota()
    for x in range(begin, end, vec.LANES):
        transmittance = vec.load_volatile(gathered, 3 * channel_size + x)  # volatile: no masked stores, see ``simd``
        alpha = opacity(material, vec.load(pixels.base_color, 3 * ROW_STRIDE + x - begin))
        share = transmittance * alpha
        is_added = (lane < vec.i32(end - x)) & (share > zero)
        for k in range(3):
            color = vec.load_volatile(gathered, k * channel_size + x)
            added = share * _encoded(job, is_linear, vec.load(pixels.base_color, k * ROW_STRIDE + x - begin))
            vec.store(gathered, k * channel_size + x, vec.select(is_added, color + added, color))
        vec.store(gathered, 3 * channel_size + x, vec.select(is_added, transmittance * (one - alpha), transmittance))


@inlined
def _blended_under(
    job: HeadlightInputs, gathered: Pointer[F32], channel_size: I64, x: I64, r: F32x8, g: F32x8, b: F32x8
) -> I32x8:
    """Return the row's pixels x .. x + 8, packed, of colours blended under the gathered layers."""
    transmittance = vec.load(gathered, 3 * channel_size + x)
    return packed_pixels(
        job,
        vec.load(gathered, x) + transmittance * r,
        vec.load(gathered, channel_size + x) + transmittance * g,
        vec.load(gathered, 2 * channel_size + x) + transmittance * b,
    )


@device_function
def write_under(job: HeadlightInputs, context: ShadingContext, begin: I64, end: I64, packed_row: Pointer[I32]) -> None:
    """Write the row's pixels ``begin .. end``, blended under the gathered layers; see ``gather``."""
    gathered, channel_size = _gathered_row(job, context.y)
    pixels, is_linear = context.pixels, context.material.encodes_gamma != 0
    for x in range(begin, end, vec.LANES):
        r, g, b = load3(pixels.base_color, x - begin, ROW_STRIDE)
        r, g, b = _encoded(job, is_linear, r), _encoded(job, is_linear, g), _encoded(job, is_linear, b)
        vec.store(packed_row, x, _blended_under(job, gathered, channel_size, x, r, g, b))


@inlined
def _background_channel(background: I64, k: I64) -> F32x8:
    """Return one channel of the background, 0 .. 1."""
    return vec.f32(f32((background >> (8 * k)) & 255) / f32(255.0))


@device_function
def write_background(job: HeadlightInputs, y: I64, begin: I64, end: I64, packed_row: Pointer[I32]) -> None:
    """Write the background to the pixels ``begin .. end``. The mode UNDER blends it; GATHER writes no image."""
    background = job.background
    r, g, b = (
        _background_channel(background, 0),
        _background_channel(background, 1),
        _background_channel(background, 2),
    )
    if job.mode == DIRECT:
        color = packed_pixels(job, r, g, b)
        for x in range(begin, end, vec.LANES):
            vec.store(packed_row, x, color)
    elif job.mode == UNDER:
        gathered, channel_size = _gathered_row(job, y)
        for x in range(begin, end, vec.LANES):
            vec.store(packed_row, x, _blended_under(job, gathered, channel_size, x, r, g, b))
