"""Tone curves, and the encoding of finished rows as sRGB bytes.

- ``neutral``: Khronos' PBR Neutral (specification 1.0, 2024). Colours below 0.76 keep hue and saturation, brighter ones
  are compressed towards white.
- ``aces``: Stephen Hill's fit of the Academy's reference rendering and output transforms: a matrix, one rational
  function, and a matrix back. Colours are first multiplied by 1 / 0.6, as in three.js, Babylon.js and the Khronos
  sample viewer.
- ``none``: values are clamped to 0 .. 1.
"""

from typing import Final

from renderers.color import linear_values_from_srgb
from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F32, F64, I32, I64, Address, Pointer
from renderers.compiler.pointers import address, advance, allocate, f32_at, i32_at, release
from renderers.compiler.simd import F32x8, F32x8x3
from renderers.shading.level_cells import encoded_pixels, level_cells, level_thresholds
from renderers.shading.packed_rows import write_packed_row
from renderers.shading.studio.layout import StudioOutput, channel_values_in_kernel
from renderers.shading.vec3 import broadcast3, load3, saturate

TONES: Final = ("neutral", "aces", "none")
"""Names of the tone curves; kernels get the index."""
_NEUTRAL_START: Final = 0.8 - 0.04
"""Largest channel from which PBR Neutral compresses colours."""
_NEUTRAL_DESATURATION: Final = 0.15
_ACES_EXPOSURE: Final = 1.0 / 0.6

SRGB_CELLS: Final = level_cells(level_thresholds(linear_values_from_srgb))


@inlined
def _neutral(r: F32x8, g: F32x8, b: F32x8) -> F32x8x3:
    """Apply Khronos' curve to linear colours. NaN becomes 0."""
    zero, one, start = vec.f32(0.0), vec.f32(1.0), vec.f32(_NEUTRAL_START)
    r, g, b = vec.maximum(r, zero), vec.maximum(g, zero), vec.maximum(b, zero)
    lowest = vec.minimum(r, vec.minimum(g, b))
    offset = vec.select(lowest < vec.f32(0.08), lowest - vec.f32(6.25) * lowest * lowest, vec.f32(0.04))
    r, g, b = r - offset, g - offset, b - offset
    peak = vec.maximum(r, vec.maximum(g, b))
    range_above = one - start
    new_peak = one - range_above * range_above / (peak + range_above - start)
    is_bright, is_white = peak >= start, peak >= vec.f32(1e30)
    color_share = one / (vec.f32(_NEUTRAL_DESATURATION) * (peak - new_peak) + one)
    scale = vec.select(is_bright, new_peak / peak * color_share, one)
    white = vec.select(is_bright, new_peak * (one - color_share), zero)
    return (
        vec.select(is_white, one, r * scale + white),
        vec.select(is_white, one, g * scale + white),
        vec.select(is_white, one, b * scale + white),
    )


@inlined
def _matrix_row(a: F64, b: F64, c: F64, x: F32x8, y: F32x8, z: F32x8) -> F32x8:
    return vec.f32(a) * x + vec.f32(b) * y + vec.f32(c) * z


@inlined
def _aces_channel(v: F32x8) -> F32x8:
    numerator = v * (v + vec.f32(0.0245786)) - vec.f32(0.000090537)
    return numerator / (v * (vec.f32(0.983729) * v + vec.f32(0.4329510)) + vec.f32(0.238081))


@inlined
def _aces(r: F32x8, g: F32x8, b: F32x8) -> F32x8x3:
    """Apply Hill's fit to linear colours. NaN becomes 0."""
    # From 1e6 on, the curve is white to the last digit. The squares of much larger values would overflow.
    zero, limit, exposure = vec.f32(0.0), vec.f32(1e6), vec.f32(_ACES_EXPOSURE)
    r = vec.minimum(vec.maximum(r, zero), limit) * exposure
    g = vec.minimum(vec.maximum(g, zero), limit) * exposure
    b = vec.minimum(vec.maximum(b, zero), limit) * exposure
    x = _aces_channel(_matrix_row(0.59719, 0.35458, 0.04823, r, g, b))
    y = _aces_channel(_matrix_row(0.07600, 0.90834, 0.01566, r, g, b))
    z = _aces_channel(_matrix_row(0.02840, 0.13383, 0.83777, r, g, b))
    return _saturate3(
        _matrix_row(1.60475, -0.53108, -0.07367, x, y, z),
        _matrix_row(-0.10208, 1.10813, -0.00605, x, y, z),
        _matrix_row(-0.00327, -0.07276, 1.07602, x, y, z),
    )


@inlined
def _saturate3(r: F32x8, g: F32x8, b: F32x8) -> F32x8x3:
    return saturate(r), saturate(g), saturate(b)


@inlined
def tone_map(tone: I64, r: F32x8, g: F32x8, b: F32x8) -> F32x8x3:
    """Apply the tone curve ``TONES[tone]`` to linear colours."""
    if tone == 0:
        return _neutral(r, g, b)
    if tone == 1:
        return _aces(r, g, b)
    return _saturate3(r, g, b)


@device_function
def write_image_row(
    accumulated: Pointer[F32], output: StudioOutput, y: I64, width: I64, packed_row: Pointer[I32]
) -> None:
    """Blend a row of surfaces over the background, and write row ``y`` of the image, encoded as sRGB.

    ``accumulated`` is an accumulated row, see ``shade_rows``; ``packed_row`` working memory for channel_values(width).
    """
    channel_size = channel_values_in_kernel(width)
    zero, one, min_share = vec.f32(0.0), vec.f32(1.0), vec.f32(1e-6)
    background_r, background_g, background_b = broadcast3(output.background, 0)
    for x in range(0, width, vec.LANES):
        r, g, b = load3(accumulated, x, channel_size)
        background_share = one - vec.load(accumulated, 3 * channel_size + x)
        background_share = vec.select(background_share > min_share, background_share, zero)
        pixels = encoded_pixels(
            r + background_share * background_r,
            g + background_share * background_g,
            b + background_share * background_b,
            output.srgb_cells,
        )
        vec.store(packed_row, x, pixels)
    write_packed_row(advance(output.color, 3 * y * width), packed_row, width)


@kernel
def write_image_rows(
    accumulated_address: Address, output_address: Address, width: I64, row_begin: I64, row_end: I64
) -> None:
    """Call ``write_image_row`` for the rows ``row_begin .. row_end`` of (H, 4, channel_values(width)) float32."""
    channel_size, output = channel_values_in_kernel(width), StudioOutput(output_address)
    packed_row = i32_at(allocate(4 * channel_size))
    for y in range(row_begin, row_end):
        write_image_row(advance(f32_at(accumulated_address), 4 * y * channel_size), output, y, width, packed_row)
    release(address(packed_row))
