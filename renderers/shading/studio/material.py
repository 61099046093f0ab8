"""Evaluation of glTF materials at pixels: fills the StudioSurfaces that are lit from interpolated attributes."""

from typing import Final

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function
from renderers.compiler.kernel_types import I64
from renderers.shading.layout import ROW_STRIDE, UNLIT, PartPixels, ShadingContext, ShadingMaterial
from renderers.shading.material import apply_normal_map, fill_base_color, opacity, sample_maps, unoccluded_share
from renderers.shading.sampling import sample
from renderers.shading.studio.layout import StudioSurfaces
from renderers.shading.vec3 import broadcast3, load3, multiply3, saturate, scale_to, store3, times

COLOR: Final = 0
"""Fill the surface of opaque pixels."""
COLOR_AND_ALPHA: Final = 1
"""Fill the surface and ``alpha``."""
ALPHA: Final = 2
"""Fill ``alpha`` only."""


@device_function
def fill_surfaces(context: ShadingContext, fill: I64, count: I64, surfaces: StudioSurfaces, first: I64) -> bool:
    """Fill StudioSurfaces, except ``to_camera`` and ``color``, from the segment's first ``count`` PartPixels.

    Args:
        fill: ``COLOR``, ``COLOR_AND_ALPHA`` or ``ALPHA``.
        first: index of the first pixel's surface.

    Returns:
        False if the surfaces are unlit, and ``emitted`` is their colour, or if only ``alpha`` was filled.
    """
    material, pixels = context.material, context.pixels
    fill_base_color(context, count, fill != COLOR)
    if fill != COLOR:
        for pixel in range(0, count, vec.LANES):
            alpha = opacity(material, vec.load(pixels.base_color, 3 * ROW_STRIDE + pixel))
            vec.store(surfaces.alpha, first + pixel, alpha)
        if fill == ALPHA:
            return False
    if material.lighting == UNLIT:
        for pixel in range(0, count, vec.LANES):
            r, g, b = load3(pixels.base_color, pixel, ROW_STRIDE)
            store3(surfaces.emitted, first + pixel, ROW_STRIDE, (saturate(r), saturate(g), saturate(b)))
        return False
    sample_maps(context, count)
    apply_normal_map(context, count)
    _fill_geometry(pixels, count, surfaces, first)
    _fill_metallic_roughness(material, pixels, count, surfaces, first)
    _fill_dielectric(context, material, pixels, count, surfaces, first)
    return True


@device_function
def _fill_geometry(pixels: PartPixels, count: I64, surfaces: StudioSurfaces, first: I64) -> None:
    """Fill the rows ``normal``, ``position`` and ``flat_normal``."""
    one = vec.f32(1.0)
    for pixel in range(0, count, vec.LANES):
        normal = load3(pixels.normal, pixel, ROW_STRIDE)
        store3(surfaces.normal, first + pixel, ROW_STRIDE, times(normal, scale_to(normal, one)))
        store3(surfaces.position, first + pixel, ROW_STRIDE, load3(pixels.position, pixel, ROW_STRIDE))
        store3(surfaces.flat_normal, first + pixel, ROW_STRIDE, load3(pixels.flat_normal, pixel, ROW_STRIDE))


@device_function
def _fill_metallic_roughness(
    material: ShadingMaterial, pixels: PartPixels, count: I64, surfaces: StudioSurfaces, first: I64
) -> None:
    """Fill the rows ``base_color``, ``metallic``, ``roughness``, ``unoccluded`` and ``emitted``."""
    zero = vec.f32(0.0)
    for pixel in range(0, count, vec.LANES):
        r, g, b = load3(pixels.base_color, pixel, ROW_STRIDE)
        base = vec.maximum(r, zero), vec.maximum(g, zero), vec.maximum(b, zero)
        store3(surfaces.base_color, first + pixel, ROW_STRIDE, base)
        metallic, roughness = vec.f32(material.metallic), vec.f32(material.roughness)
        if material.metallic_roughness_texture >= 0:
            roughness = roughness * vec.load(pixels.metallic_roughness, ROW_STRIDE + pixel)
            metallic = metallic * vec.load(pixels.metallic_roughness, 2 * ROW_STRIDE + pixel)
        vec.store(surfaces.metallic, first + pixel, saturate(metallic))
        vec.store(surfaces.roughness, first + pixel, saturate(roughness))
        vec.store(surfaces.unoccluded, first + pixel, unoccluded_share(material, pixels, pixel))
        emitted = broadcast3(material.emissive, 0)
        if material.emissive_texture >= 0:
            emitted = multiply3(emitted, load3(pixels.emissive, pixel, ROW_STRIDE))
        store3(surfaces.emitted, first + pixel, ROW_STRIDE, emitted)


@device_function
def _fill_dielectric(
    context: ShadingContext,
    material: ShadingMaterial,
    pixels: PartPixels,
    count: I64,
    surfaces: StudioSurfaces,
    first: I64,
) -> None:
    """Fill the rows ``f0`` and ``f90`` (KHR_materials_ior, KHR_materials_specular)."""
    one, reflectance = vec.f32(1.0), vec.f32(material.reflectance)
    if material.specular_texture >= 0:
        sample(context, material.specular_texture, count, pixels.scratch_color, True)
    for pixel in range(0, count, vec.LANES):
        f90 = vec.f32(material.specular)
        if material.specular_texture >= 0:
            f90 = f90 * vec.load(pixels.scratch_color, 3 * ROW_STRIDE + pixel)
        vec.store(surfaces.f90, first + pixel, f90)
    if material.specular_color_texture >= 0:
        sample(context, material.specular_color_texture, count, pixels.scratch_color, False)
    for pixel in range(0, count, vec.LANES):
        tint, f90 = broadcast3(material.specular_color, 0), vec.load(surfaces.f90, first + pixel)
        if material.specular_color_texture >= 0:
            tint = multiply3(tint, load3(pixels.scratch_color, pixel, ROW_STRIDE))
        f0 = (
            vec.minimum(reflectance * tint[0], one) * f90,
            vec.minimum(reflectance * tint[1], one) * f90,
            vec.minimum(reflectance * tint[2], one) * f90,
        )
        store3(surfaces.f0, first + pixel, ROW_STRIDE, f0)
