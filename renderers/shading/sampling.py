"""Texture sampling: fills four rows of PartPixels with a texture's RGBA at the pixels of a part.

Materials call ``sample``. It calls the kernel ``sample_texture``, at the end of this file, which has two ways:

- OpenGL's filters, in three loops over the pixels: ``_select_levels`` chooses mip levels, ``_locate_in_levels`` finds
  the texels, and ``_read_levels`` reads and mixes them. A processor overlaps the loads of short loops better than those
  of one long loop, and large textures' texels are prefetched before they are read.
- ``_sample_areas``, with ``area_filter``, if the material reads gradients: means over each pixel's area.

Parameters that mean the same in all steps:

- ``coordinates``, ``fields``: the texture's TextureCoordinates and TextureFields.
- ``rows``: the four rows that are filled with RGBA; A only if ``with_alpha``.
"""

from typing import Final, NamedTuple

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel
from renderers.compiler.kernel_types import F32, I32, I64, Address, Pointer, i64
from renderers.compiler.pointers import address, advance, f32_at
from renderers.compiler.simd import F32x8, F32x8x2, F32x8x4, F32x8x6
from renderers.shading.area_filter import is_within_texel, sample_area, squared_sides
from renderers.shading.layout import ROW_STRIDE, PartPixels, ShadingContext, ShadingTexture
from renderers.shading.level_of_detail import MAGNIFIED, is_minified, mip_levels
from renderers.shading.texels import TextureFields, locate, located_rows, read_texels, texture_fields, wrapped
from renderers.shading.texture_table import MIPS_NONE
from renderers.shading.vec3 import load3, store3

_MIN_PREFETCHED_TEXELS: Final = 1 << 17
"""Number of texels from which an image is prefetched: half a megabyte, more than a second-level cache holds.
Shading with a texture of 2048 x 2048 takes 20 to 30 % less time, with mip levels 12 to 15 %."""


class TextureCoordinates(NamedTuple):
    """The set of texture coordinates in PartPixels that a texture reads, and its ``uv_transform``."""

    uv: Pointer[F32]
    """Two rows."""
    uv_gradient: Pointer[F32]
    """Four rows, which are filled if the material ``reads_gradients``."""
    transform: F32x8x6


@inlined
def _coordinates_of(texture: ShadingTexture, pixels: PartPixels) -> TextureCoordinates:
    """Return the TextureCoordinates of a texture."""
    m = texture.uv_transform
    return TextureCoordinates(
        uv=advance(pixels.uv, 2 * ROW_STRIDE * texture.uv_set),
        uv_gradient=advance(pixels.uv_gradient, 4 * ROW_STRIDE * texture.uv_set),
        transform=(vec.f32(m[0]), vec.f32(m[1]), vec.f32(m[2]), vec.f32(m[3]), vec.f32(m[4]), vec.f32(m[5])),
    )


@inlined
def _transformed_uv(coordinates: TextureCoordinates, pixel: I64) -> F32x8x2:
    """Return (u, v) of eight pixels, transformed."""
    a, b, c, d, e, f = coordinates.transform
    u, v = vec.load(coordinates.uv, pixel), vec.load(coordinates.uv, ROW_STRIDE + pixel)
    return a * u + b * v + c, d * u + e * v + f


@inlined
def _transformed_gradient(coordinates: TextureCoordinates, pixel: I64) -> F32x8x4:
    """Return the sides of eight pixels' footprints as texture coordinates: du/dx, dv/dx, du/dy, dv/dy."""
    a, b, _, d, e, _ = coordinates.transform
    rows = coordinates.uv_gradient
    du_dx, dv_dx = vec.load(rows, pixel), vec.load(rows, pixel + ROW_STRIDE)
    du_dy, dv_dy = vec.load(rows, pixel + 2 * ROW_STRIDE), vec.load(rows, pixel + 3 * ROW_STRIDE)
    return a * du_dx + b * dv_dx, d * du_dx + e * dv_dx, a * du_dy + b * dv_dy, d * du_dy + e * dv_dy


@inlined
def _store_rgba(rows: Pointer[F32], pixel: I64, rgba: F32x8x4, with_alpha: bool) -> None:
    """Store RGB, and A if ``with_alpha``, of eight pixels."""
    store3(rows, pixel, ROW_STRIDE, rgba)  # R, G and B
    if with_alpha:
        vec.store(rows, 3 * ROW_STRIDE + pixel, rgba[3])


@inlined
def _sample_areas(
    texture: ShadingTexture,
    fields: TextureFields,
    coordinates: TextureCoordinates,
    pixels: PartPixels,
    count: I64,
    rows: Pointer[F32],
    with_alpha: bool,
) -> None:
    """Fill ``rows`` with the texture's means over the pixels' areas."""
    for pixel in range(0, count, vec.LANES):
        u, v = _transformed_uv(coordinates, pixel)
        gradient = _transformed_gradient(coordinates, pixel)
        if is_within_texel(texture, gradient):
            offsets, weights = located_rows(pixels, 0)
            level_0 = vec.i32(0)
            all_linear = level_0 == level_0  # set in all lanes: one bilinear sample is enough
            u, v = wrapped(u, fields.wrap_s), wrapped(v, fields.wrap_t)
            locate(fields, offsets, weights, pixel, level_0, all_linear, u, v)
            rgba = read_texels(fields, offsets, weights, pixel, with_alpha)
        else:
            rgba = sample_area(texture, fields, pixels, pixel, u, v, gradient, with_alpha)
        _store_rgba(rows, pixel, rgba, with_alpha)


@inlined
def _select_levels(
    texture: ShadingTexture, fields: TextureFields, coordinates: TextureCoordinates, pixels: PartPixels, count: I64
) -> bool:
    """Fill ``level``, ``next_level_weight`` and ``sample_uv``; return True if any pixel is between two levels.

    If the texture has no mip levels and one filter for magnification and minification, all pixels get level 0, not
    MAGNIFIED. The gradient is not read then, since it may not be stored: ``materials`` sets ``reads_gradients`` by the
    same condition, Sampler.depends_on_scale.
    """
    depends_on_scale = texture.mip_mode != MIPS_NONE or texture.mag_linear != texture.min_linear
    width, height, zero = vec.f32(fields.width), vec.f32(fields.height), vec.f32(0.0)
    any_is_between = False
    for pixel in range(0, count, vec.LANES):
        u, v = _transformed_uv(coordinates, pixel)
        level, next_level_weight = vec.i32(0), zero
        if depends_on_scale:
            gradient = _transformed_gradient(coordinates, pixel)
            squared_across, squared_down = squared_sides(gradient, width, height)
            squared_side = vec.maximum(squared_across, squared_down)
            minified = is_minified(texture, squared_side)
            level = vec.i32(MAGNIFIED)
            if vec.movemask(minified) != 0:
                minified_level, minified_weight = mip_levels(texture, squared_side)
                level = vec.select(minified, minified_level, level)
                next_level_weight = vec.select(minified, minified_weight, zero)
                any_is_between = any_is_between or vec.movemask(next_level_weight > zero) != 0
        vec.store(pixels.level, pixel, level)
        vec.store(pixels.next_level_weight, pixel, next_level_weight)
        vec.store(pixels.sample_uv, pixel, wrapped(u, fields.wrap_s))
        vec.store(pixels.sample_uv, ROW_STRIDE + pixel, wrapped(v, fields.wrap_t))
    return any_is_between


@inlined
def _any_between_levels(pixels: PartPixels, pixel: I64) -> bool:
    """Return True if any of eight pixels is between two mip levels."""
    return vec.movemask(vec.load(pixels.next_level_weight, pixel) > vec.f32(0.0)) != 0


@inlined
def _prefetch(texels: Pointer[I32], offsets: Pointer[I32], pixel: I64) -> None:
    """Prefetch the texels that ``locate`` has stored for eight pixels."""
    for k in range(0, 2 * ROW_STRIDE, ROW_STRIDE):  # the rows of the upper and of the lower texels
        for lane in range(vec.LANES):
            vec.prefetch(texels, i64(offsets[k + pixel + lane]))


@inlined
def _locate_in_levels(
    texture: ShadingTexture, fields: TextureFields, pixels: PartPixels, count: I64, level_count: I64
) -> None:
    """Fill ``texel_offsets`` and ``texel_weights`` for each pixel's level, and for the next one if it is between two.

    ``level_count`` is 2 if any pixel is between two levels, else 1.
    """
    zero, last_level = vec.i32(0), vec.i32(fields.last_level)
    mag_linear, min_linear = vec.i32(texture.mag_linear) != zero, vec.i32(texture.min_linear) != zero
    prefetches = fields.width * fields.height > _MIN_PREFETCHED_TEXELS
    for level_offset in range(level_count):
        offsets, weights = located_rows(pixels, level_offset)
        for pixel in range(0, count, vec.LANES):
            if level_offset == 1 and not _any_between_levels(pixels, pixel):
                continue
            level = vec.load(pixels.level, pixel)
            is_magnified = level < zero  # MAGNIFIED
            is_linear = (is_magnified & mag_linear) | (~is_magnified & min_linear)
            level = vec.minimum(vec.maximum(level, zero) + vec.i32(level_offset), last_level)
            u, v = vec.load(pixels.sample_uv, pixel), vec.load(pixels.sample_uv, ROW_STRIDE + pixel)
            locate(fields, offsets, weights, pixel, level, is_linear, u, v)
            if prefetches:
                _prefetch(fields.texels, offsets, pixel)


@inlined
def _read_levels(
    fields: TextureFields, pixels: PartPixels, count: I64, level_count: I64, rows: Pointer[F32], with_alpha: bool
) -> None:
    """Fill ``rows`` from the texels that ``_locate_in_levels`` has found, interpolated between levels."""
    for level_offset in range(level_count):
        offsets, weights = located_rows(pixels, level_offset)
        for pixel in range(0, count, vec.LANES):
            if level_offset == 1 and not _any_between_levels(pixels, pixel):
                continue
            rgba = read_texels(fields, offsets, weights, pixel, with_alpha)
            if level_offset == 1:
                rgba = _mix_with_stored(rows, pixel, rgba, vec.load(pixels.next_level_weight, pixel))
            _store_rgba(rows, pixel, rgba, with_alpha)


@inlined
def _mix_with_stored(rows: Pointer[F32], pixel: I64, rgba: F32x8x4, weight: F32x8) -> F32x8x4:
    """Return RGBA between that in ``rows`` (weight 0) and ``rgba`` (weight 1); A is undefined if ``rows`` has none."""
    r, g, b = load3(rows, pixel, ROW_STRIDE)
    a = vec.load(rows, 3 * ROW_STRIDE + pixel)
    return (
        r + weight * (rgba[0] - r),
        g + weight * (rgba[1] - g),
        b + weight * (rgba[2] - b),
        a + weight * (rgba[3] - a),
    )


@device_function
def sample(context: ShadingContext, index: I64, count: I64, rows: Pointer[F32], with_alpha: bool) -> None:
    """Sample texture ``index`` at the first ``count`` pixels, 0 .. 1 per channel, into four rows of PartPixels.

    Texel centres are at ((i + 0.5) / width, (j + 0.5) / height). Mip levels and areas need the rows ``uv_gradient``.
    Without ``with_alpha``, the fourth row is undefined.
    """
    call_kernel(context.inputs.sampling_kernel, (address(context), index, count, address(rows), i64(with_alpha)))


@kernel
def sample_texture(context_address: Address, index: I64, count: I64, rows_address: Address, fills_alpha: I64) -> None:
    """Do what ``sample`` says: a kernel of its own, compiled once for all looks."""
    context, rows, with_alpha = ShadingContext(context_address), f32_at(rows_address), fills_alpha != 0
    inputs, pixels = context.inputs, context.pixels
    texture = inputs.textures[index]
    fields = texture_fields(texture, inputs.linear_from_byte)
    coordinates = _coordinates_of(texture, pixels)
    if inputs.area_filter != 0 and context.material.reads_gradients != 0:
        _sample_areas(texture, fields, coordinates, pixels, count, rows, with_alpha)
    else:
        any_between_levels = _select_levels(texture, fields, coordinates, pixels, count)
        level_count = 2 if any_between_levels else 1
        _locate_in_levels(texture, fields, pixels, count, level_count)
        _read_levels(fields, pixels, count, level_count, rows, with_alpha)
