"""Light of camera images, in place of the headlight along the optical axis: a lamp, sky and ground, further lights.

The lamp is a point at the camera. Its light falls with the cosine and the square of the distance. All parts add up, so
that no surface is black because it faces away from one of them.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.camera import Camera
from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, F64, I64, Pointer
from renderers.compiler.pointers import address, address_of
from renderers.compiler.simd import F32x8, F32x8x3
from renderers.compiler.structs import Struct, inline
from renderers.light_rig import CameraLight
from renderers.shading.brdf import vtk_specular
from renderers.shading.layout import STRIDE, Segment
from renderers.shading.material import unoccluded_share
from renderers.shading.studio.layout import StudioLight
from renderers.shading.studio.lighting import direction_and_attenuation
from renderers.shading.studio.lights import light_structs
from renderers.shading.vec3 import broadcast3, dot, load3, minus, scale_to, store3, times

REFERENCE_DISTANCE: Final = 1.5
"""Distance at which lamp and projector have the light that they are configured with, metres."""
MAX_FALLOFF: Final = 4.0
"""Maximum factor by which surfaces nearer to a lamp or projector are brighter: that at half ``REFERENCE_DISTANCE``."""

MIN_AMBIENT: Final = 0.01
"""Minimum light of sky and ground: added light could not be seen on black pixels."""


class CameraLightInputs(Struct):
    lamp: F64  # light on a surface that faces the lamp at REFERENCE_DISTANCE
    position: Pointer[F64] = inline(3)  # of the lamp, optical frame, metres
    up: Pointer[F64] = inline(3)  # the world's z axis in the optical frame
    sky: F64  # light on a surface that faces up
    ground: F64  # light on a surface that faces down
    lights: StudioLight  # further lights; their shadow maps are not used
    light_count: I64


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
        )
        self.address = address_of(job, CameraLightInputs.dtype)
        """Valid while this object is alive."""
        self._keep = (job, lights)


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
    """Return the light of the further lights on surfaces, RGB. It casts no shadows.

    Args:
        normal: unit vectors, optical frame.
    """
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
def total_light(light: CameraLightInputs, normal: F32x8x3, point: F32x8x3) -> F32x8:
    """Return all light on surfaces, the mean of RGB; arguments are those of ``diffuse_light``."""
    to_lamp, strength = _lamp(light, point)
    lamp = strength * vec.maximum(dot(normal, to_lamp), vec.f32(0.0))
    red, green, blue = diffuse_light(light, normal, point)
    return lamp + ambient_light(light, normal) + (red + green + blue) * vec.f32(1.0 / 3.0)


@device_function
def light_pixels(light: CameraLightInputs, segment: Segment, count: I64, lamp_share: Pointer[F32]) -> None:
    """Write the light on the segment's first ``count`` pixels, after ``sample_maps`` and ``apply_normal_map``.

    Rows ``normal`` become those that ``vtk_reflected`` reads for the lamp: its light times n . l, its light times the
    specular term, and Schlick's factor, which is 0. The first three rows ``texel`` become all other light, RGB.

    Args:
        lamp_share: pointer to the pixels' values of ``Frame.lamp_share``; null: not wanted.
    """
    material, pixels = segment.material, segment.pixels
    one = vec.f32(1.0)
    for x in range(0, count, vec.LANES):
        normal, point = load3(pixels.normal, x, STRIDE), load3(pixels.point, x, STRIDE)
        normal, to_camera = times(normal, scale_to(normal, one)), times(point, -scale_to(point, one))
        to_lamp, lamp = _lamp(light, point)
        v_l = dot(to_camera, to_lamp)
        roughness, metallic = vec.f32(material.roughness), vec.f32(material.metallic)
        if material.metallic_roughness_texture >= 0:
            roughness = roughness * vec.load(pixels.metallic_roughness, STRIDE + x)
            metallic = metallic * vec.load(pixels.metallic_roughness, 2 * STRIDE + x)
        cosine = dot(normal, to_lamp)
        n_l, specular = vtk_specular(cosine, dot(normal, to_camera), v_l, roughness)
        ambient = ambient_light(light, normal) * unoccluded_share(material, pixels, x)
        red, green, blue = diffuse_light(light, normal, point)
        if address(lamp_share) != 0:
            cosine = vec.maximum(cosine, vec.f32(0.0))
            total = lamp * cosine + ambient + (red + green + blue) * vec.f32(1.0 / 3.0)
            # Smooth metals reflect dots away from the camera. Limited, and not NaN: the last store overruns into what
            # may be the background.
            width = roughness * roughness
            scattered = one - metallic * (one - width * width)
            share = vec.maximum(scattered * cosine / total, vec.f32(0.0))
            share = vec.minimum(share, vec.f32(1.0 / MIN_AMBIENT))
            vec.store(lamp_share, x, share)
        # Schlick's (1 - h . l)^5 is below 1e-8 for a lamp that is 8 cm beside the camera and 0.3 m from the surface.
        store3(pixels.normal, x, STRIDE, (n_l * lamp, specular * lamp, vec.f32(0.0)))
        store3(pixels.texel, x, STRIDE, (red + ambient, green + ambient, blue + ambient))
