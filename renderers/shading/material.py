"""Material maps at the pixels of a part: base colour, normal map, metallic-roughness, occlusion, emissive.

Functions here fill rows of the segment's PartPixels for its first ``count`` pixels.
"""

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import I64
from renderers.compiler.simd import F32x8
from renderers.shading.gamma import decode_gamma
from renderers.shading.layout import HAS_COLORS, HAS_TANGENTS, ROW_STRIDE, PartPixels, ShadingContext, ShadingMaterial
from renderers.shading.materials import ALPHA_BLEND, ALPHA_MASK, COLORS_DECODE, COLORS_REPLACE
from renderers.shading.sampling import sample
from renderers.shading.vec3 import cross, dot, load3, saturate, scale_to, select3, store3, times


@inlined
def has_varying_color(context: ShadingContext) -> bool:
    """Return True if the base colour differs between the pixels of a segment."""
    return context.material.base_color_texture >= 0 or (context.used_attribute_bits & HAS_COLORS) != 0


@device_function
def fill_base_color(context: ShadingContext, count: I64, with_alpha: bool) -> None:
    """Fill the rows ``base_color``, the fourth one if ``with_alpha``: factor x vertex colour x texture."""
    material, pixels = context.material, context.pixels
    is_textured, is_colored = material.base_color_texture >= 0, (context.used_attribute_bits & HAS_COLORS) != 0
    if is_textured:
        sample(context, material.base_color_texture, count, pixels.base_color, with_alpha)
    rule, linear_from_gamma = material.vertex_color_rule, context.inputs.linear_from_gamma
    for k in range(4 if with_alpha else 3):
        if is_textured and not is_colored and material.base_color[k] == 1.0:
            continue
        factor = vec.f32(material.base_color[k])
        if k < 3 and is_colored and rule & COLORS_REPLACE:
            factor = vec.f32(1.0)
        decodes = k < 3 and (rule & COLORS_DECODE) != 0
        for pixel in range(0, count, vec.LANES):
            value = factor
            if is_colored:
                color = vec.load(pixels.color, k * ROW_STRIDE + pixel)
                if decodes:
                    color = decode_gamma(color, linear_from_gamma)
                value = value * color
            if is_textured:
                value = value * vec.load(pixels.base_color, k * ROW_STRIDE + pixel)
            vec.store(pixels.base_color, k * ROW_STRIDE + pixel, value)


@inlined
def opacity(material: ShadingMaterial, alpha: F32x8) -> F32x8:
    """Return the share of a surface in a pixel's colour, by its alpha mode; NaN is opaque."""
    one = vec.f32(1.0)
    if material.alpha_mode == ALPHA_BLEND:
        return vec.select(alpha == alpha, saturate(alpha), one)
    if material.alpha_mode == ALPHA_MASK:
        return vec.select(alpha < vec.f32(material.alpha_cutoff), vec.f32(0.0), one)
    return one


@device_function
def sample_maps(context: ShadingContext, count: I64) -> None:
    """Fill the rows ``metallic_roughness``, ``occlusion`` and ``emissive``, if the material has these textures."""
    material, pixels = context.material, context.pixels
    if material.metallic_roughness_texture >= 0:
        sample(context, material.metallic_roughness_texture, count, pixels.metallic_roughness, False)
    if material.occlusion_texture >= 0 and material.occlusion_texture != material.metallic_roughness_texture:
        sample(context, material.occlusion_texture, count, pixels.occlusion, False)
    if material.emissive_texture >= 0:
        sample(context, material.emissive_texture, count, pixels.emissive, False)


@inlined
def unoccluded_share(material: ShadingMaterial, pixels: PartPixels, pixel: I64) -> F32x8:
    """Return the share of the light that occlusion leaves at eight pixels, after ``sample_maps``."""
    one = vec.f32(1.0)
    if material.occlusion_texture < 0:
        return one
    rows = pixels.occlusion
    if material.occlusion_texture == material.metallic_roughness_texture:  # usually one texture holds both
        rows = pixels.metallic_roughness
    return one + vec.f32(material.occlusion_strength) * (vec.load(rows, pixel) - one)


@device_function
def apply_normal_map(context: ShadingContext, count: I64) -> None:
    """Replace the rows ``normal`` by unit normals from the material's normal map, where the tangent has a direction."""
    material, pixels = context.material, context.pixels
    if material.normal_texture < 0 or (context.used_attribute_bits & HAS_TANGENTS) == 0:
        return
    sample(context, material.normal_texture, count, pixels.scratch_color, False)
    mirror_sign, strength = vec.f32(context.matrices.mirror_sign), vec.f32(material.normal_scale)
    one, two, zero = vec.f32(1.0), vec.f32(2.0), vec.f32(0.0)
    for pixel in range(0, count, vec.LANES):
        visible_normal = load3(pixels.normal, pixel, ROW_STRIDE)
        visible_normal = times(visible_normal, scale_to(visible_normal, one))
        # The map is in the tangent frame of the front; a back face shows the reversed normal (glTF 3.9.6).
        facing = vec.load(pixels.facing, pixel)
        n = times(visible_normal, facing)
        t = load3(pixels.tangent, pixel, ROW_STRIDE)
        n_t = dot(n, t)
        t = t[0] - n_t * n[0], t[1] - n_t * n[1], t[2] - n_t * n[2]
        scale = scale_to(t, one)
        is_valid = scale > zero
        t = times(t, scale)
        # The bitangent of a mirror image is the mirrored one.
        handedness = vec.select(vec.load(pixels.tangent, 3 * ROW_STRIDE + pixel) * mirror_sign >= zero, one, -one)
        b = cross(n, t)
        texel = load3(pixels.scratch_color, pixel, ROW_STRIDE)
        along_t, along_b = (two * texel[0] - one) * strength, (two * texel[1] - one) * strength * handedness
        along_n = two * texel[2] - one
        normal = (
            along_t * t[0] + along_b * b[0] + along_n * n[0],
            along_t * t[1] + along_b * b[1] + along_n * n[1],
            along_t * t[2] + along_b * b[2] + along_n * n[2],
        )
        scale = scale_to(normal, facing)
        is_valid = is_valid & (scale != zero)
        store3(pixels.normal, pixel, ROW_STRIDE, select3(is_valid, times(normal, scale), visible_normal))
