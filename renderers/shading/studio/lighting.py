"""Light on gathered surfaces, eight pixels at a time: lights with shadows, the environment map, the tone curve."""

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, I64, Pointer
from renderers.compiler.simd import F32x8, F32x8x2, F32x8x3, I32x8
from renderers.shading.brdf import ambient_channel, reflected
from renderers.shading.layout import ROW_STRIDE
from renderers.shading.studio.environment_map import LEVELS
from renderers.shading.studio.layout import StudioLight, StudioLighting, StudioSurfaces
from renderers.shading.studio.lights import DIRECTIONAL, SPOT
from renderers.shading.studio.shadow_sampling import unshadowed_share
from renderers.shading.studio.tone_mapping import tone_map
from renderers.shading.vec3 import broadcast3, dot, load3, minus, saturate, store3, times, transform_directions


@device_function
def light_surfaces(lighting: StudioLighting, surfaces: StudioSurfaces, count: I64) -> None:
    """Fill the rows ``to_camera`` and ``color`` of the first ``count`` surfaces."""
    zero = vec.f32(0.0)
    for pixel in range(0, count, vec.LANES):
        store3(surfaces.color, pixel, ROW_STRIDE, (zero, zero, zero))
        point = load3(surfaces.position, pixel, ROW_STRIDE)
        distance = vec.sqrt(point[0] * point[0] + point[1] * point[1] + point[2] * point[2])
        scale = vec.select(distance > zero, vec.f32(-1.0) / distance, zero)
        store3(surfaces.to_camera, pixel, ROW_STRIDE, times(point, scale))
    for k in range(lighting.light_count):
        _add_light(lighting, lighting.lights[k], surfaces, count)
    if lighting.has_environment != 0:
        _add_environment(lighting, surfaces, count)
    exposure = vec.f32(lighting.exposure)
    tone = lighting.tone
    for pixel in range(0, count, vec.LANES):
        r, g, b = load3(surfaces.color, pixel, ROW_STRIDE)
        emitted_r, emitted_g, emitted_b = load3(surfaces.emitted, pixel, ROW_STRIDE)
        mapped = tone_map(tone, (r + emitted_r) * exposure, (g + emitted_g) * exposure, (b + emitted_b) * exposure)
        store3(surfaces.color, pixel, ROW_STRIDE, mapped)


@inlined
def direction_and_attenuation(light: StudioLight, point: F32x8x3) -> tuple[F32x8x3, F32x8]:
    """Return unit vectors from points to a light, and the factors of its colour at the points, without shadows."""
    zero, one = vec.f32(0.0), vec.f32(1.0)
    direction = broadcast3(light.direction, 0)
    if light.kind == DIRECTIONAL:
        return (-direction[0], -direction[1], -direction[2]), one
    x, y, z = minus(broadcast3(light.position, 0), point)
    distance_squared = vec.maximum(x * x + y * y + z * z, vec.f32(1e-12))
    scale = one / vec.sqrt(distance_squared)
    x, y, z = x * scale, y * scale, z * scale
    attenuation = one / distance_squared
    if light.inv_range_squared > 0.0:
        relative = distance_squared * vec.f32(light.inv_range_squared)
        attenuation = attenuation * vec.maximum(vec.minimum(one - relative * relative, one), zero)
    if light.kind == SPOT:
        cosine = -(x * direction[0] + y * direction[1] + z * direction[2])
        falloff = saturate(cosine * vec.f32(light.spot_scale) + vec.f32(light.spot_offset))
        attenuation = attenuation * falloff * falloff
    return (x, y, z), attenuation


@device_function
def _add_light(lighting: StudioLighting, light: StudioLight, surfaces: StudioSurfaces, count: I64) -> None:
    """Add the reflection of one light to the rows ``color`` of the first ``count`` surfaces."""
    zero = vec.f32(0.0)
    light_r, light_g, light_b = broadcast3(light.color, 0)
    for pixel in range(0, count, vec.LANES):
        normal = load3(surfaces.normal, pixel, ROW_STRIDE)
        point = load3(surfaces.position, pixel, ROW_STRIDE)
        to_light, attenuation = direction_and_attenuation(light, point)
        n_l = dot(normal, to_light)
        attenuation = vec.select(n_l > zero, attenuation, zero)
        if light.shadow_map >= 0:
            flat_normal = load3(surfaces.flat_normal, pixel, ROW_STRIDE)
            # A triangle shadows its own back.
            attenuation = vec.select(dot(flat_normal, to_light) > zero, attenuation, zero)
            if vec.movemask(attenuation > zero) != 0:
                shadow_map = lighting.shadow_maps[light.shadow_map]
                attenuation = attenuation * unshadowed_share(shadow_map, lighting.shadow_radius, point, flat_normal)
        is_lit = attenuation > zero
        if vec.movemask(is_lit) == 0:
            continue
        r, g, b = reflected(
            normal,
            load3(surfaces.to_camera, pixel, ROW_STRIDE),
            to_light,
            n_l,
            load3(surfaces.base_color, pixel, ROW_STRIDE),
            vec.load(surfaces.metallic, pixel),
            vec.load(surfaces.roughness, pixel),
            load3(surfaces.f0, pixel, ROW_STRIDE),
            vec.load(surfaces.f90, pixel),
        )
        red, green, blue = load3(surfaces.color, pixel, ROW_STRIDE)
        red = red + vec.select(is_lit, attenuation * light_r * r, zero)
        green = green + vec.select(is_lit, attenuation * light_g * g, zero)
        blue = blue + vec.select(is_lit, attenuation * light_b * b, zero)
        store3(surfaces.color, pixel, ROW_STRIDE, (red, green, blue))


@inlined
def _octahedral_uv(direction: F32x8x3) -> F32x8x2:
    """Return the position (u, v) of directions in an octahedral table, 0 .. 1 each; the centre for a zero vector."""
    zero, half = vec.f32(0.0), vec.f32(0.5)
    total = vec.absolute(direction[0]) + vec.absolute(direction[1]) + vec.absolute(direction[2])
    scale = vec.select(total > zero, vec.f32(1.0) / total, zero)
    u, v = direction[0] * scale, direction[1] * scale
    fold = vec.maximum(zero - direction[2] * scale, zero)
    u = vec.select(u >= zero, u + fold, u - fold)
    v = vec.select(v >= zero, v + fold, v - fold)
    return half * u + half, half * v + half


@inlined
def _sample_environment(lighting: StudioLighting, table: I32x8, direction: F32x8x3) -> F32x8x3:
    """Sample octahedral tables bilinearly at directions of the world, of any length. Return RGB.

    ``table`` is the index of the table for each lane: a level of ``Environment``, or LEVELS for the irradiance.
    """
    tables = lighting.environment_tables
    two, four = vec.i32(2), vec.i32(4)
    u, v = _octahedral_uv(direction)
    offset, side = vec.gather(tables, table * two), vec.gather(tables, table * two + vec.i32(1))
    size = vec.to_f32(side)
    half = vec.f32(0.5)
    x = vec.minimum(vec.maximum(u * size + half, vec.f32(0.0)), size + half)
    y = vec.minimum(vec.maximum(v * size + half, vec.f32(0.0)), size + half)
    i, j = vec.to_i32(x), vec.to_i32(y)
    tx, ty = x - vec.to_f32(i), y - vec.to_f32(j)
    one_minus_tx, one_minus_ty = vec.f32(1.0) - tx, vec.f32(1.0) - ty
    row_values = (side + two) * four
    first = offset + j * row_values + i * four
    # Each load reads two neighbouring texels of four values.
    upper = vec.load_octets(lighting.environment_texels, first)
    lower = vec.load_octets(lighting.environment_texels, first + row_values)
    w00, w10, w01, w11 = one_minus_tx * one_minus_ty, tx * one_minus_ty, one_minus_tx * ty, tx * ty
    return (
        upper[0] * w00 + upper[4] * w10 + lower[0] * w01 + lower[4] * w11,
        upper[1] * w00 + upper[5] * w10 + lower[1] * w01 + lower[5] * w11,
        upper[2] * w00 + upper[6] * w10 + lower[2] * w01 + lower[6] * w11,
    )


@inlined
def _sample_split_sum(table: Pointer[F32], side: I64, n_v: F32x8, roughness: F32x8) -> F32x8x2:
    """Return scale and bias of ``environment_map.split_sum``, interpolated. ``n_v`` and ``roughness`` are 0 .. 1."""
    one, two, last = vec.f32(1.0), vec.i32(2), vec.i32(side - 2)
    x, y = n_v * vec.f32(side - 1), roughness * vec.f32(side - 1)
    i, j = vec.minimum(vec.to_i32(x), last), vec.minimum(vec.to_i32(y), last)
    tx, ty = x - vec.to_f32(i), y - vec.to_f32(j)
    first = (i * vec.i32(side) + j) * two
    w00, w10, w01, w11 = (one - tx) * (one - ty), tx * (one - ty), (one - tx) * ty, tx * ty
    # Scale and bias at one roughness and at the next one, for the lower and for the higher cosine.
    lower_cosine = vec.load_quads(table, first)
    higher_cosine = vec.load_quads(table, first + vec.i32(2 * side))
    return (
        lower_cosine[0] * w00 + higher_cosine[0] * w10 + lower_cosine[2] * w01 + higher_cosine[2] * w11,
        lower_cosine[1] * w00 + higher_cosine[1] * w10 + lower_cosine[3] * w01 + higher_cosine[3] * w11,
    )


@device_function
def _add_environment(lighting: StudioLighting, surfaces: StudioSurfaces, count: I64) -> None:
    """Add the reflection of the environment to the rows ``color`` of the first ``count`` surfaces."""
    R_world_camera = lighting.R_world_camera
    one, two = vec.f32(1.0), vec.f32(2.0)
    for pixel in range(0, count, vec.LANES):
        normal = load3(surfaces.normal, pixel, ROW_STRIDE)
        view = load3(surfaces.to_camera, pixel, ROW_STRIDE)
        roughness = saturate(vec.load(surfaces.roughness, pixel))
        n_v = dot(normal, view)
        # The rougher a surface, the more its dominant direction of reflection turns from the mirrored direction to the
        # normal (Lagarde and de Rousiers, "Moving Frostbite to PBR", 2014, 4.9.3).
        alpha = roughness * roughness
        mirror_share = (one - alpha) * (vec.sqrt(one - alpha) + alpha)
        along_normal = one - mirror_share + mirror_share * two * n_v
        reflection = (
            along_normal * normal[0] - mirror_share * view[0],
            along_normal * normal[1] - mirror_share * view[1],
            along_normal * normal[2] - mirror_share * view[2],
        )
        n_v = saturate(n_v)
        scale, bias = _sample_split_sum(lighting.split_sum, lighting.split_sum_side, n_v, roughness)
        normal_world = transform_directions(R_world_camera, normal)
        irradiance = _sample_environment(lighting, vec.i32(LEVELS), normal_world)
        level = roughness * vec.f32(float(LEVELS - 1))
        lower_level = vec.minimum(vec.to_i32(level), vec.i32(LEVELS - 2))
        t = level - vec.to_f32(lower_level)
        reflection_world = transform_directions(R_world_camera, reflection)
        r0, g0, b0 = _sample_environment(lighting, lower_level, reflection_world)
        r1, g1, b1 = _sample_environment(lighting, lower_level + vec.i32(1), reflection_world)
        base = load3(surfaces.base_color, pixel, ROW_STRIDE)
        f0, f90 = load3(surfaces.f0, pixel, ROW_STRIDE), vec.load(surfaces.f90, pixel)
        metallic = vec.load(surfaces.metallic, pixel)
        r = ambient_channel(base[0], metallic, f0[0], f90, scale, bias, irradiance[0], r0 + t * (r1 - r0))
        g = ambient_channel(base[1], metallic, f0[1], f90, scale, bias, irradiance[1], g0 + t * (g1 - g0))
        b = ambient_channel(base[2], metallic, f0[2], f90, scale, bias, irradiance[2], b0 + t * (b1 - b0))
        unoccluded = vec.load(surfaces.unoccluded, pixel)
        red, green, blue = load3(surfaces.color, pixel, ROW_STRIDE)
        lit = red + unoccluded * r, green + unoccluded * g, blue + unoccluded * b
        store3(surfaces.color, pixel, ROW_STRIDE, lit)
