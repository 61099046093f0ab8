"""Lighting of a part of a segment in the headlight looks, eight pixels at a time.

``packed_row`` is explained in ``packed_rows``. Functions with a parameter ``begin`` shade the first ``count`` pixels,
which are the row's pixels from ``begin`` on.
"""

import math

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, I32, I64, Pointer, i64
from renderers.compiler.pointers import address, advance, f32_at, stack_array
from renderers.compiler.simd import F32x8, F32x8x3
from renderers.shading.brdf import headlight_cosines, schlick, vtk_colors, vtk_reflected, vtk_specular
from renderers.shading.camera_light import LightImages, light_pixels, write_light_images
from renderers.shading.headlight.layout import DIRECT, GATHER, HeadlightInputs
from renderers.shading.headlight.output_merge import packed_pixels, write_pixels
from renderers.shading.interpolation import pixel_columns
from renderers.shading.layout import (
    LAMBERT,
    METALLIC_ROUGHNESS,
    ROW_STRIDE,
    TRIANGLE_VERTICES,
    UNLIT,
    PartPixels,
    ShadingContext,
)
from renderers.shading.material import (
    apply_normal_map,
    fill_base_color,
    has_varying_color,
    sample_maps,
    unoccluded_share,
)
from renderers.shading.vec3 import broadcast3, load3, multiply3, scale_to, store3, times

_colors = stack_array(I32, vec.LANES)


@inlined
def _base_color(factor: F32x8x3, pixels: PartPixels, has_rows: bool, pixel: I64) -> F32x8x3:
    """Return the base colour of eight pixels: from the rows ``base_color`` if they are filled, else the factor."""
    return load3(pixels.base_color, pixel, ROW_STRIDE) if has_rows else factor


@inlined
def _store_pixels(
    job: HeadlightInputs,
    pixels: PartPixels,
    is_linear: bool,
    direct: bool,
    packed_row: Pointer[I32],
    begin: I64,
    pixel: I64,
    rgb: F32x8x3,
) -> None:
    """Store eight shaded pixels: packed if ``direct`` (see ``write_pixels``), else in the rows ``base_color``."""
    if direct:
        write_pixels(job, is_linear, packed_row, begin + pixel, rgb[0], rgb[1], rgb[2])
    else:
        store3(pixels.base_color, pixel, ROW_STRIDE, rgb)


@inlined
def _light_images(job: HeadlightInputs, context: ShadingContext, begin: I64) -> LightImages:
    """Return pointers to the row's pixel ``begin``."""
    return LightImages(
        _row_of(job, job.lamp_share, context, begin),
        _row_of(job, job.key_factor, context, begin),
        _row_of(job, job.light, context, begin),
    )


@inlined
def _row_of(job: HeadlightInputs, image: Pointer[F32], context: ShadingContext, begin: I64) -> Pointer[F32]:
    """Return a pointer to the row's pixel ``begin`` of an image; 0 if it is not wanted."""
    if address(image) == 0 or job.mode == GATHER:
        return f32_at(0)
    return advance(image, context.y * (job.width + vec.LANES) + begin)


@device_function
def _shade_unlit(
    job: HeadlightInputs, context: ShadingContext, has_rows: bool, begin: I64, count: I64, packed_row: Pointer[I32]
) -> None:
    """Show the base colour."""
    direct, material, pixels = job.mode == DIRECT, context.material, context.pixels
    is_linear, factor = material.encodes_gamma != 0, broadcast3(material.base_color, 0)
    for pixel in range(0, count, vec.LANES):
        color = _base_color(factor, pixels, has_rows, pixel)
        _store_pixels(job, pixels, is_linear, direct, packed_row, begin, pixel, color)


@inlined
def _headlight_cosine(normal: F32x8x3) -> F32x8:
    """Return max(0, n . (0, 0, -1)): the headlight shines along the optical axis."""
    return vec.maximum(-normal[2] * scale_to(normal, vec.f32(1.0)), vec.f32(0.0))


@device_function
def _shade_lambert(
    job: HeadlightInputs, context: ShadingContext, has_rows: bool, begin: I64, count: I64, packed_row: Pointer[I32]
) -> None:
    """Show the base colour times ``_headlight_cosine`` (Lambert)."""
    direct, pixels, factor = job.mode == DIRECT, context.pixels, broadcast3(context.material.base_color, 0)
    for pixel in range(0, count, vec.LANES):
        cosine = _headlight_cosine(load3(pixels.normal, pixel, ROW_STRIDE))
        color = times(_base_color(factor, pixels, has_rows, pixel), cosine)
        _store_pixels(job, pixels, False, direct, packed_row, begin, pixel, color)


@inlined
def _light_by_headlight(context: ShadingContext, begin: I64, count: I64) -> None:
    """Replace the rows ``normal`` by what ``vtk_reflected`` reads: n . l, the specular term and Schlick's factor."""
    material, pixels, columns, inputs = context.material, context.pixels, context.columns, context.inputs
    center_offset, inv_fx = vec.f32(0.5 - inputs.cx), vec.f32(1.0 / inputs.fx)
    ray_y = vec.f32((context.y + 0.5 - inputs.cy) / inputs.fy)
    roughness_factor, has_roughness_map = vec.f32(material.roughness), material.metallic_roughness_texture >= 0
    for pixel in range(0, count, vec.LANES):
        column = pixel_columns(columns, begin + pixel)
        normal = load3(pixels.normal, pixel, ROW_STRIDE)
        n_l, n_v, v_l = headlight_cosines(normal, (vec.to_f32(column) + center_offset) * inv_fx, ray_y)
        roughness = roughness_factor
        if has_roughness_map:
            roughness = roughness * vec.load(pixels.metallic_roughness, ROW_STRIDE + pixel)
        n_l, specular = vtk_specular(n_l, n_v, v_l, roughness)
        store3(pixels.normal, pixel, ROW_STRIDE, (n_l, specular, schlick(v_l)))


@device_function
def _shade_pbr(
    job: HeadlightInputs, context: ShadingContext, has_rows: bool, begin: I64, count: I64, packed_row: Pointer[I32]
) -> None:
    """Show metallic-roughness reflection as VTK evaluates it, with occlusion and emission.

    Under a camera's light, occlusion reduces the light of sky and ground only (glTF 2.0, 3.9.3).
    """
    if job.has_camera_light != 0:
        light_pixels(job.camera_light, context, count, _light_images(job, context, begin))
    else:
        _light_by_headlight(context, begin, count)
    material, pixels, has_camera_light = context.material, context.pixels, job.has_camera_light != 0
    metallic_factor, inv_pi = vec.f32(material.metallic), vec.f32(1.0 / math.pi)
    has_roughness_map, has_emissive_map = material.metallic_roughness_texture >= 0, material.emissive_texture >= 0
    # A loop of its own: short bodies, so that a processor overlaps their iterations.
    base_factor, emissive_factor = broadcast3(material.base_color, 0), broadcast3(material.emissive, 0)
    direct = job.mode == DIRECT
    for pixel in range(0, count, vec.LANES):
        n_l, specular, fresnel = load3(pixels.normal, pixel, ROW_STRIDE)
        metallic = metallic_factor
        if has_roughness_map:
            metallic = metallic * vec.load(pixels.metallic_roughness, 2 * ROW_STRIDE + pixel)
        diffuse, f0, f90_minus_f0 = vtk_colors(_base_color(base_factor, pixels, has_rows, pixel), metallic)
        unoccluded = vec.f32(1.0)
        if not has_camera_light:
            unoccluded = unoccluded_share(material, pixels, pixel)
        emitted = emissive_factor
        if has_emissive_map:
            emitted = multiply3(emissive_factor, load3(pixels.emissive, pixel, ROW_STRIDE))
        rgb = (
            vtk_reflected(n_l, specular, fresnel, diffuse[0], f0[0], f90_minus_f0[0]) * unoccluded + emitted[0],
            vtk_reflected(n_l, specular, fresnel, diffuse[1], f0[1], f90_minus_f0[1]) * unoccluded + emitted[1],
            vtk_reflected(n_l, specular, fresnel, diffuse[2], f0[2], f90_minus_f0[2]) * unoccluded + emitted[2],
        )
        if has_camera_light:
            red, green, blue = load3(pixels.scratch_color, pixel, ROW_STRIDE)
            rgb = (
                rgb[0] + red * (diffuse[0] + f0[0] * inv_pi),
                rgb[1] + green * (diffuse[1] + f0[1] * inv_pi),
                rgb[2] + blue * (diffuse[2] + f0[2] * inv_pi),
            )
        _store_pixels(job, pixels, True, direct, packed_row, begin, pixel, rgb)


@inlined
def is_uniform_lambert(job: HeadlightInputs, context: ShadingContext) -> bool:
    """Return True if the colour of a segment depends on its normals only, and only colour is wanted."""
    if job.mode != DIRECT or job.has_camera_light != 0:
        return False
    return context.material.lighting == LAMBERT and not has_varying_color(context)


@device_function
def fill_spans(
    job: HeadlightInputs, context: ShadingContext, span: I64, part_end_span: I64, packed_row: Pointer[I32]
) -> None:
    """Write the spans ``span .. part_end_span``, each of one colour. Rooms of flat walls take 30 % longer without.

    The segment is ``is_uniform_lambert`` and has constant normals along each span, as walls, floors and meshes without
    normals have. ``set_up_part`` has filled PartSpans.
    """
    base_color, normals = broadcast3(context.material.base_color, 0), context.part_spans.normal
    span_starts = context.span_starts
    colors = _colors()
    for first in range(span, part_end_span, vec.LANES):
        r, g, b = times(base_color, _headlight_cosine(load3(normals, first - span, ROW_STRIDE)))
        vec.store(colors, 0, packed_pixels(job, r, g, b))
        for k in range(min(part_end_span - first, vec.LANES)):
            color = vec.i32(i64(colors[k]))
            for x in range(span_starts[first + k], span_starts[first + k + 1], vec.LANES):
                vec.store(packed_row, x, color)


@inlined
def shade(job: HeadlightInputs, context: ShadingContext, begin: I64, end: I64, packed_row: Pointer[I32]) -> None:
    """Shade the pixels ``begin .. end`` of a part, whose attributes are the first values of PartPixels.

    In the mode ``DIRECT`` they are stored in ``packed_row``, with up to seven further ones. In the other modes, colour
    and alpha are stored in the rows ``base_color``.
    """
    count, material = end - begin, context.material
    has_rows = has_varying_color(context) or job.mode != DIRECT
    if has_rows:
        fill_base_color(context, count, job.mode != DIRECT)
    wants_light = address(job.key_factor) != 0 or address(job.light) != 0
    is_triangle = context.instance.vertices_per_primitive == TRIANGLE_VERTICES
    if wants_light and is_triangle and material.lighting != METALLIC_ROUGHNESS:
        write_light_images(job.camera_light, context, count, _light_images(job, context, begin))
    if material.lighting == UNLIT:
        _shade_unlit(job, context, has_rows, begin, count, packed_row)
    elif material.lighting == LAMBERT:
        _shade_lambert(job, context, has_rows, begin, count, packed_row)
    else:
        sample_maps(context, count)
        apply_normal_map(context, count)
        _shade_pbr(job, context, has_rows, begin, count, packed_row)
