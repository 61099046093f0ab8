"""Texture sampling: fills rows of ShadedPixels from a texture, with OpenGL's filters or, with ``area_filter``, averaged
over each pixel's area.

Materials call ``sample``, and it the kernel ``sample_texture``, which calls the steps above it. In these, ``uv`` and
``uv_gradient`` point to the rows of ShadedPixels of the texture's set of coordinates: two, and four if they are filled.
``rows``: four rows that are filled with RGBA. ``view``: the texture's TextureView. ``uv_transform``: from
``_load_uv_transform``.
"""

from __future__ import annotations

from typing import Final

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel
from renderers.compiler.kernel_types import F32, I32, I64, Address, Pointer, i64
from renderers.compiler.pointers import address, advance, f32_at
from renderers.compiler.simd import F32x8, F32x8x2, F32x8x4, F32x8x6
from renderers.shading.area_filter import is_within_texel, sample_area, squared_sides
from renderers.shading.layout import ROW_STRIDE, ShadedPixels, ShadingContext, ShadingTexture
from renderers.shading.mip_levels import MAGNIFIED, is_minified, mip_levels
from renderers.shading.texels import TextureView, locate, read_texels, texels_of_level, texture_view, wrapped
from renderers.shading.texture_table import MIPS_NONE
from renderers.shading.vec3 import load3, store3

_MIN_PREFETCHED_TEXELS: Final = 1 << 17
"""Number of texels from which an image is prefetched: half a megabyte, more than a second-level cache holds.
Shading with a texture of 2048 x 2048 takes 20 to 30 % less time, with mip levels 12 to 15 %."""


@inlined
def _load_uv_transform(texture: ShadingTexture) -> F32x8x6:
    """Return the six values of a texture's uv_transform."""
    m = texture.uv_transform
    return vec.f32(m[0]), vec.f32(m[1]), vec.f32(m[2]), vec.f32(m[3]), vec.f32(m[4]), vec.f32(m[5])


@inlined
def _transformed_uv(uv_transform: F32x8x6, uv: Pointer[F32], x: I64) -> F32x8x2:
    """Return (u, v) of eight pixels, transformed; ``uv``: pointer to the two rows of a set in ShadedPixels."""
    a, b, c, d, e, f = uv_transform
    u, v = vec.load(uv, x), vec.load(uv, ROW_STRIDE + x)
    return a * u + b * v + c, d * u + e * v + f


@inlined
def _transformed_gradient(uv_transform: F32x8x6, uv_gradient: Pointer[F32], x: I64) -> F32x8x4:
    """Return the sides of eight pixels' footprints as texture coordinates: du/dx, dv/dx, du/dy, dv/dy.

    Args:
        uv_gradient: pointer to the four rows of ShadedPixels for the texture's set of coordinates.
    """
    a, b, _, d, e, _ = uv_transform
    du_dx, dv_dx = vec.load(uv_gradient, x), vec.load(uv_gradient, x + ROW_STRIDE)
    du_dy, dv_dy = vec.load(uv_gradient, x + 2 * ROW_STRIDE), vec.load(uv_gradient, x + 3 * ROW_STRIDE)
    return a * du_dx + b * dv_dx, d * du_dx + e * dv_dx, a * du_dy + b * dv_dy, d * du_dy + e * dv_dy


@inlined
def _store_texel(rows: Pointer[F32], x: I64, rgba: F32x8x4, alpha: bool) -> None:
    """Store RGB, and A only if ``alpha``, in four rows of ShadedPixels."""
    store3(rows, x, ROW_STRIDE, rgba)
    if alpha:
        vec.store(rows, 3 * ROW_STRIDE + x, rgba[3])


@inlined
def _sample_areas(
    texture: ShadingTexture,
    view: TextureView,
    uv_transform: F32x8x6,
    uv: Pointer[F32],
    uv_gradient: Pointer[F32],
    pixels: ShadedPixels,
    count: I64,
    rows: Pointer[F32],
    alpha: bool,
) -> None:
    """Fill ``rows`` with the texture's means over the pixels' areas."""
    for x in range(0, count, vec.LANES):
        u, v = _transformed_uv(uv_transform, uv, x)
        gradient = _transformed_gradient(uv_transform, uv_gradient, x)
        if is_within_texel(texture, gradient):
            offsets, weights = texels_of_level(pixels, 0)
            level, is_linear = vec.i32(0), vec.i32(0) == vec.i32(0)
            locate(view, offsets, weights, x, level, is_linear, wrapped(u, view.wrap_s), wrapped(v, view.wrap_t))
            rgba = read_texels(view, offsets, weights, x, alpha)
        else:
            rgba = sample_area(texture, view, pixels, x, u, v, gradient, alpha)
        _store_texel(rows, x, rgba, alpha)


@inlined
def _select_levels(
    texture: ShadingTexture,
    view: TextureView,
    uv_transform: F32x8x6,
    uv: Pointer[F32],
    uv_gradient: Pointer[F32],
    pixels: ShadedPixels,
    count: I64,
) -> bool:
    """Fill ``level``, ``next_level_weight`` and ``sample_uv``; return True if any pixel is between two levels.

    If the filter does not depend on the scale, ``level`` is 0 and not MAGNIFIED, and the filters of both are the same.
    If it does, ``uv_gradient`` is filled: ``materials`` sets ``reads_gradients`` by Sampler.depends_on_scale.
    """
    depends_on_scale = texture.mip_mode != MIPS_NONE or texture.mag_linear != texture.min_linear
    width, height, zero = vec.f32(view.width), vec.f32(view.height), vec.f32(0.0)
    any_is_between = False
    for x in range(0, count, vec.LANES):
        u, v = _transformed_uv(uv_transform, uv, x)
        level, next_level_weight = vec.i32(0), zero
        if depends_on_scale:
            squared_across, squared_down = squared_sides(
                _transformed_gradient(uv_transform, uv_gradient, x), width, height
            )
            squared_side = vec.maximum(squared_across, squared_down)
            minified = is_minified(texture, squared_side)
            level = vec.i32(MAGNIFIED)
            if vec.movemask(minified) != 0:
                minified_level, minified_weight = mip_levels(texture, squared_side)
                level = vec.select(minified, minified_level, level)
                next_level_weight = vec.select(minified, minified_weight, zero)
                any_is_between = any_is_between or vec.movemask(next_level_weight > zero) != 0
        vec.store(pixels.level, x, level)
        vec.store(pixels.next_level_weight, x, next_level_weight)
        vec.store(pixels.sample_uv, x, wrapped(u, view.wrap_s))
        vec.store(pixels.sample_uv, ROW_STRIDE + x, wrapped(v, view.wrap_t))
    return any_is_between


@inlined
def _any_between_levels(pixels: ShadedPixels, x: I64) -> bool:
    """Return True if any of eight pixels is between two mip levels."""
    return vec.movemask(vec.load(pixels.next_level_weight, x) > vec.f32(0.0)) != 0


@inlined
def _prefetch(texels: Pointer[I32], offsets: Pointer[I32], x: I64) -> None:
    """Prefetch the texels that ``locate`` has stored for eight pixels."""
    for k in range(0, 2 * ROW_STRIDE, ROW_STRIDE):  # the rows of the upper and of the lower texels
        for lane in range(vec.LANES):
            vec.prefetch(texels, i64(offsets[k + x + lane]))


@inlined
def _locate_in_levels(
    texture: ShadingTexture, view: TextureView, pixels: ShadedPixels, count: I64, level_count: I64
) -> None:
    """Fill ``texel_offsets`` and ``texel_weights`` for each pixel's level, and for the next one if it is between two.

    Args:
        level_count: 2 if any pixel is between two levels, else 1.
    """
    zero, last_level = vec.i32(0), vec.i32(view.last_level)
    mag_linear, min_linear = vec.i32(texture.mag_linear) != zero, vec.i32(texture.min_linear) != zero
    prefetches = view.width * view.height > _MIN_PREFETCHED_TEXELS
    for level_offset in range(level_count):
        offsets, weights = texels_of_level(pixels, level_offset)
        for x in range(0, count, vec.LANES):
            if level_offset == 1 and not _any_between_levels(pixels, x):
                continue
            level = vec.load(pixels.level, x)
            is_magnified = level < zero  # MAGNIFIED
            is_linear = (is_magnified & mag_linear) | (~is_magnified & min_linear)
            level = vec.minimum(vec.maximum(level, zero) + vec.i32(level_offset), last_level)
            u, v = vec.load(pixels.sample_uv, x), vec.load(pixels.sample_uv, ROW_STRIDE + x)
            locate(view, offsets, weights, x, level, is_linear, u, v)
            if prefetches:
                _prefetch(view.texels, offsets, x)


@inlined
def _read_levels(
    view: TextureView, pixels: ShadedPixels, count: I64, level_count: I64, rows: Pointer[F32], alpha: bool
) -> None:
    """Fill ``rows`` with the texels that ``_locate_in_levels`` has found, interpolated between levels."""
    for k in range(level_count):
        offsets, weights = texels_of_level(pixels, k)
        for x in range(0, count, vec.LANES):
            if k == 1 and not _any_between_levels(pixels, x):
                continue
            rgba = read_texels(view, offsets, weights, x, alpha)
            if k == 1:
                rgba = _mix_with_stored(rows, x, rgba, vec.load(pixels.next_level_weight, x))
            _store_texel(rows, x, rgba, alpha)


@inlined
def _mix_with_stored(rows: Pointer[F32], x: I64, rgba: F32x8x4, weight: F32x8) -> F32x8x4:
    """Return RGBA between that in four rows of ShadedPixels (weight 0) and ``rgba`` (weight 1).

    Without ``alpha``, A is undefined and not stored.
    """
    r, g, b = load3(rows, x, ROW_STRIDE)
    a = vec.load(rows, 3 * ROW_STRIDE + x)
    return (
        r + weight * (rgba[0] - r),
        g + weight * (rgba[1] - g),
        b + weight * (rgba[2] - b),
        a + weight * (rgba[3] - a),
    )


@device_function
def sample(context: ShadingContext, index: I64, count: I64, rows: Pointer[F32], alpha: bool) -> None:
    """Sample a texture at the first ``count`` pixels, 0 .. 1 per channel, by ``sample_texture``.

    Texel centres are at ((i + 0.5) / width, (j + 0.5) / height). Mip levels and areas need the rows ``uv_gradient``.

    Args:
        index: index of the texture in ShadingInputs.textures.
        rows: pointer to four rows of ShadedPixels that are filled.
        alpha: True: fill the fourth row, too. Otherwise it is undefined.
    """
    call_kernel(context.inputs.sampling_kernel, (address(context), index, count, address(rows), i64(alpha)))


@kernel
def sample_texture(context_address: Address, index: I64, count: I64, rows_address: Address, has_alpha: I64) -> None:
    """Do what ``sample`` says: a kernel of its own, compiled once for all looks.

    Args:
        context_address: address of a ShadingContext.
        rows_address: address of ``rows``.
        has_alpha: ``alpha``, 1 or 0.
    """
    context, rows, alpha = ShadingContext(context_address), f32_at(rows_address), has_alpha != 0
    inputs, pixels = context.inputs, context.pixels
    texture = inputs.textures[index]
    view = texture_view(texture, inputs.linear_from_byte)
    uv = advance(pixels.uv, 2 * ROW_STRIDE * texture.uv_set)
    uv_gradient = advance(pixels.uv_gradient, 4 * ROW_STRIDE * texture.uv_set)
    uv_transform = _load_uv_transform(texture)
    if inputs.area_filter != 0 and context.material.reads_gradients != 0:
        _sample_areas(texture, view, uv_transform, uv, uv_gradient, pixels, count, rows, alpha)
    else:
        # Loops of their own, which a processor overlaps better than one: the texels of all pixels are prefetched.
        any_between_levels = _select_levels(texture, view, uv_transform, uv, uv_gradient, pixels, count)
        level_count = 2 if any_between_levels else 1
        _locate_in_levels(texture, view, pixels, count, level_count)
        _read_levels(view, pixels, count, level_count, rows, alpha)
