"""Light of camera images, in place of the headlight along the optical axis: a lamp, sky and ground, further lights.

The lamp is a point at the camera. Its light falls with the cosine and the square of the distance. All parts add up, so
that no surface is black because it faces away from one of them.
"""

from typing import Any, Final, NamedTuple

import numpy as np

from renderers.camera import Camera
from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, F64, I32, I64, Pointer
from renderers.compiler.pointers import address, address_of, advance, i32_at, stack_array
from renderers.compiler.simd import F32x8, F32x8x3
from renderers.compiler.structs import Struct, inline
from renderers.light_rig import CameraLight, KeyLight
from renderers.shading.brdf import vtk_specular
from renderers.shading.layout import ROW_STRIDE, ShadingContext
from renderers.shading.material import unoccluded_share
from renderers.shading.studio.layout import StudioLight
from renderers.shading.studio.lighting import direction_and_attenuation
from renderers.shading.studio.lights import light_structs
from renderers.shading.vec3 import broadcast3, dot, load3, minus, scale_to, store3, times

REFERENCE_DISTANCE: Final = 1.5
"""Distance at which lamp and projector have the light that they are configured with, metres."""
MAX_FALLOFF: Final = 4.0
"""Maximum factor by which surfaces nearer to a lamp or projector are brighter: that at half ``REFERENCE_DISTANCE``."""

MAX_KEY_FACTOR: Final = 4.0
"""Maximum of ``Frame.key_factor``."""
MIN_AMBIENT: Final = 0.01
"""Minimum light of sky and ground: added light could not be seen on black pixels."""


_offsets = stack_array(I32, 2 * vec.LANES)


class CameraLightInputs(Struct):
    lamp: F64  # light on a surface that faces the lamp at REFERENCE_DISTANCE
    position: Pointer[F64] = inline(3)  # of the lamp, optical frame, metres
    up: Pointer[F64] = inline(3)  # the world's z axis in the optical frame
    sky: F64  # light on a surface that faces up
    ground: F64  # light on a surface that faces down
    lights: StudioLight  # further lights; their shadow maps are not used
    light_count: I64
    # Key light; without one, the other fields are not set.
    key: F32  # light on a surface that faces it
    shadow_depth: Pointer[F32]  # as in KeyLight, (shadow_side, shadow_side)
    shadow_side: I64
    shadow_focal: F32  # focal length and principal point of the shadow map, texels
    shadow_center: F32
    beyond: F32  # as in KeyLight
    normal_offset: F32  # as in KeyLight
    X_light_camera: Pointer[F32] = inline(12)  # (3, 4), from the optical frame to that of the key light's camera


class LightImages(NamedTuple):
    """Pointers to a segment's pixels in images of Frame; 0: not wanted."""

    lamp_share: Pointer[F32]
    key_factor: Pointer[F32]
    light: Pointer[F32]


class CameraLightJob:
    """A CameraLightInputs in the frame of one camera. Immutable, thread-safe."""

    def __init__(self, light: CameraLight, camera: Camera) -> None:
        job, lights = (
            np.empty(1, CameraLightInputs.dtype),
            light_structs(light.lights, [-1] * len(light.lights), camera),
        )
        X_camera_world = camera.X_camera_world
        job[0] = CameraLightInputs.record(
            lamp=light.lamp,
            position=X_camera_world[:3, :3] @ light.position + X_camera_world[:3, 3],
            up=X_camera_world[:3, 2],
            sky=light.sky,
            ground=light.ground,
            lights=address_of(lights, StudioLight.dtype),
            light_count=len(light.lights),
            **(_key_fields(light.key, camera) if light.key is not None else {}),
        )
        self.address = address_of(job, CameraLightInputs.dtype)
        """Valid while this object is alive."""
        self._keep = (job, lights, light.key)


def _key_fields(key: KeyLight, camera: Camera) -> dict[str, Any]:
    return {
        "key": key.level,
        "shadow_depth": address_of(key.depth, np.float32),
        "shadow_side": len(key.depth),
        "shadow_focal": key.camera.fx,
        "shadow_center": key.camera.cx,
        "beyond": key.beyond,
        "normal_offset": key.normal_offset,
        "X_light_camera": (key.camera.X_camera_world @ camera.X_world_camera)[:3].ravel(),
    }


@inlined
def _lamp(light: CameraLightInputs, point: F32x8x3) -> tuple[F32x8x3, F32x8]:
    """Return unit vectors from points to the lamp, and its light on surfaces that face it."""
    to_lamp = minus(broadcast3(light.position, 0), point)
    distance_squared = vec.maximum(dot(to_lamp, to_lamp), vec.f32(1e-12))
    inv_distance = vec.f32(1.0) / vec.sqrt(distance_squared)
    falloff = vec.minimum(vec.f32(REFERENCE_DISTANCE**2) * inv_distance * inv_distance, vec.f32(MAX_FALLOFF))
    return times(to_lamp, inv_distance), vec.f32(light.lamp) * falloff


@inlined
def ambient_light(light: CameraLightInputs, normal: F32x8x3) -> F32x8:
    """Return the light of sky and ground on surfaces with these unit normals."""
    half, sky, ground = vec.f32(0.5), vec.f32(light.sky), vec.f32(light.ground)
    return ground + (sky - ground) * (half + half * dot(normal, broadcast3(light.up, 0)))


@inlined
def diffuse_light(light: CameraLightInputs, normal: F32x8x3, point: F32x8x3) -> F32x8x3:
    """Return the light of the further lights on surfaces with these unit normals, RGB. It casts no shadows."""
    zero = vec.f32(0.0)
    red, green, blue = zero, zero, zero
    for k in range(light.light_count):
        each = light.lights[k]
        to_light, attenuation = direction_and_attenuation(each, point)
        arriving = attenuation * vec.maximum(dot(normal, to_light), zero)
        r, g, b = broadcast3(each.color, 0)
        red, green, blue = red + arriving * r, green + arriving * g, blue + arriving * b
    return red, green, blue


@inlined
def _lit_share(light: CameraLightInputs, u: F32x8, v: F32x8, z: F32x8) -> F32x8:
    """Return the share of the key light that reaches points, from four texels with bilinear weights.

    ``u`` and ``v`` are positions in the map in texels; ``z`` is the depth of the points.
    """
    shadow_depth, side = light.shadow_depth, light.shadow_side
    zero, one, last = vec.f32(0.0), vec.f32(1.0), vec.f32(side - 1)
    u, v = u - vec.f32(0.5), v - vec.f32(0.5)
    is_inside = (zero < u) & (u < last) & (zero < v) & (v < last)
    u, v = vec.select(is_inside, u, zero), vec.select(is_inside, v, zero)
    i, j = vec.to_i32(u), vec.to_i32(v)
    fu, fv = u - vec.to_f32(i), v - vec.to_f32(j)
    texels, offsets = i32_at(address(shadow_depth)), _offsets()
    vec.store(offsets, 0, j * vec.i32(side) + i)
    vec.store(offsets, vec.LANES, (j + vec.i32(1)) * vec.i32(side) + i)
    left, right = vec.load_pairs(texels, offsets, 0)
    lower_left, lower_right = vec.load_pairs(texels, offsets, vec.LANES)
    depth = vec.float_bits(vec.maximum(z, zero))  # positive numbers are in the order of their bits
    upper = vec.select(left >= depth, one - fu, zero) + vec.select(right >= depth, fu, zero)
    lower = vec.select(lower_left >= depth, one - fu, zero) + vec.select(lower_right >= depth, fu, zero)
    return vec.select(is_inside, upper + fv * (lower - upper), vec.f32(light.beyond))


@inlined
def _coordinate(row: Pointer[F32], point: F32x8x3) -> F32x8:
    """Return one coordinate of points, transformed by a row of a (3, 4) matrix."""
    return vec.f32(row[0]) * point[0] + vec.f32(row[1]) * point[1] + vec.f32(row[2]) * point[2] + vec.f32(row[3])


@inlined
def _key_factor(light: CameraLightInputs, normal: F32x8x3, point: F32x8x3, other_light: F32x8) -> F32x8:
    """Return ``Frame.key_factor``.

    With n the surface's normal, l the direction to the key light, and s the share of it that reaches the surface, the
    key light adds ``key s max(n . l, 0)`` to the other light.
    """
    zero, one, center = vec.f32(0.0), vec.f32(1.0), vec.f32(light.shadow_center)
    x_row, y_row, z_row = light.X_light_camera, advance(light.X_light_camera, 4), advance(light.X_light_camera, 8)
    # The light looks along its z axis, in one direction for all points: it is far away.
    n_l = zero - dot(normal, broadcast3(z_row, 0))
    if vec.movemask(n_l > zero) == 0:
        return one
    offset = vec.f32(light.normal_offset) * _coordinate(z_row, point)
    point = point[0] + offset * normal[0], point[1] + offset * normal[1], point[2] + offset * normal[2]
    light_z = _coordinate(z_row, point)
    scale = vec.f32(light.shadow_focal) / light_z
    # A texel has one depth, but the depths of a slanted surface differ within it.
    bias = vec.f32(0.5) * offset / vec.maximum(n_l, vec.f32(0.2))
    u, v = _coordinate(x_row, point) * scale + center, _coordinate(y_row, point) * scale + center
    share = _lit_share(light, u, v, light_z - bias)
    added = vec.f32(light.key) * share * vec.maximum(n_l, zero) / other_light
    return vec.minimum(one + added, vec.f32(MAX_KEY_FACTOR))


@inlined
def _store_light_images(
    light: CameraLightInputs, images: LightImages, pixel: I64, count: I64, normal: F32x8x3, point: F32x8x3, total: F32x8
) -> None:
    """Store ``key_factor`` and ``light`` of eight pixels of a segment, which has ``count``."""
    is_pixel = vec.iota() < vec.i32(count - pixel)
    if address(images.key_factor) != 0:
        vec.store_where(images.key_factor, pixel, is_pixel, _key_factor(light, normal, point, total))
    if address(images.light) != 0:
        vec.store_where(images.light, pixel, is_pixel, total)


@device_function
def write_light_images(light: CameraLightInputs, context: ShadingContext, count: I64, images: LightImages) -> None:
    """Write ``key_factor`` and ``light`` of the segment's first ``count`` pixels, which have no camera light."""
    pixels = context.pixels
    for pixel in range(0, count, vec.LANES):
        normal, point = load3(pixels.normal, pixel, ROW_STRIDE), load3(pixels.position, pixel, ROW_STRIDE)
        normal = times(normal, scale_to(normal, vec.f32(1.0)))
        to_lamp, lamp = _lamp(light, point)
        red, green, blue = diffuse_light(light, normal, point)
        total = lamp * vec.maximum(dot(normal, to_lamp), vec.f32(0.0)) + ambient_light(light, normal)
        total = total + (red + green + blue) * vec.f32(1.0 / 3.0)
        _store_light_images(light, images, pixel, count, normal, point, total)


@device_function
def light_pixels(light: CameraLightInputs, context: ShadingContext, count: I64, images: LightImages) -> None:
    """Write the light on the segment's first ``count`` pixels, after ``sample_maps`` and ``apply_normal_map``.

    Rows ``normal`` become those that ``vtk_reflected`` reads for the lamp: its light times n . l, its light times the
    specular term, and Schlick's factor, which is 0. The first three rows ``scratch_color`` become all other light, RGB.
    """
    lamp_share = images.lamp_share
    material, pixels, has_lamp = context.material, context.pixels, light.lamp > 0.0
    zero, one = vec.f32(0.0), vec.f32(1.0)
    for pixel in range(0, count, vec.LANES):
        normal, point = load3(pixels.normal, pixel, ROW_STRIDE), load3(pixels.position, pixel, ROW_STRIDE)
        normal = times(normal, scale_to(normal, one))
        roughness, metallic = vec.f32(material.roughness), vec.f32(material.metallic)
        if material.metallic_roughness_texture >= 0:
            roughness = roughness * vec.load(pixels.metallic_roughness, ROW_STRIDE + pixel)
            metallic = metallic * vec.load(pixels.metallic_roughness, 2 * ROW_STRIDE + pixel)
        lamp, cosine, n_l, specular = zero, zero, zero, zero
        if has_lamp or address(lamp_share) != 0:
            to_lamp, lamp = _lamp(light, point)
            cosine = dot(normal, to_lamp)
            if has_lamp:
                to_camera = times(point, -scale_to(point, one))
                n_l, specular = vtk_specular(cosine, dot(normal, to_camera), dot(to_camera, to_lamp), roughness)
            cosine = vec.maximum(cosine, zero)
        ambient = ambient_light(light, normal) * unoccluded_share(material, pixels, pixel)
        red, green, blue = diffuse_light(light, normal, point)
        total = lamp * cosine + ambient + (red + green + blue) * vec.f32(1.0 / 3.0)
        _store_light_images(light, images, pixel, count, normal, point, total)
        if address(lamp_share) != 0:
            width = roughness * roughness  # smooth metals reflect dots away from the camera
            share = vec.maximum((one - metallic * (one - width * width)) * cosine / total, zero)  # NaN: 0
            share = vec.minimum(share, vec.f32(1.0 / MIN_AMBIENT))
            vec.store_where(lamp_share, pixel, vec.iota() < vec.i32(count - pixel), share)
        # Schlick's (1 - h . l)^5 is below 1e-8 for a lamp that is 8 cm beside the camera and 0.3 m from the surface.
        store3(pixels.normal, pixel, ROW_STRIDE, (n_l * lamp, specular * lamp, zero))
        store3(pixels.scratch_color, pixel, ROW_STRIDE, (red + ambient, green + ambient, blue + ambient))
