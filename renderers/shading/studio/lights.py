"""Lights of an image: their automatic exposure, and their structs for kernels, in the camera's optical frame."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import Light, LightKind
from renderers.shading.studio.layout import StudioLight

DIRECTIONAL: Final = 0
POINT: Final = 1
SPOT: Final = 2
_KINDS: Final = {LightKind.DIRECTIONAL: DIRECTIONAL, LightKind.POINT: POINT, LightKind.SPOT: SPOT}

_WHITE_ILLUMINANCE: Final = math.pi
"""Illuminance at which a matt white surface has the radiance 1, which is white in the image."""
_MIN_RANGE: Final = 1e-6
"""Minimum range of a light, metres: the square of a smaller one may be 0."""
_MIN_DISTANCE: Final = 0.01
"""Minimum distance from a light, metres, in the measurement of exposure: a point in a lamp would be infinitely bright.
Lighting has a limit of a micrometre."""


def dimmed_to_expose(lights: tuple[Light, ...], points: NDArray[np.float64]) -> tuple[Light, ...]:
    """Return a file's lights, dimmed by one factor if they would overexpose the median of the lit points of the world.

    KHR_lights_punctual has photometric units (the sun has 100,000 lux), but no exposure to go with them. Viewers show
    such files white; many files have intensities near 1 instead, which stay as they are. Shadows and the direction of
    surfaces are left out of the measurement.
    """
    with np.errstate(over="ignore"):
        illuminance = sum((_illuminance(light, points) for light in lights), np.zeros(len(points)))
    lit = illuminance[illuminance > 0.0]
    overexposure = float(np.median(lit)) / _WHITE_ILLUMINANCE if len(lit) else 0.0
    if overexposure <= 1.0:
        return lights
    return tuple(replace(light, intensity=light.intensity / overexposure) for light in lights)


def _illuminance(light: Light, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the illuminance of surfaces that face the light, in lux, of its brightest channel, (n,) float64."""
    brightest = max(light.color) * light.intensity
    if light.kind is LightKind.DIRECTIONAL:
        return np.full(len(points), brightest)
    towards = points - np.array(light.position)
    distance = np.maximum(np.linalg.norm(towards, axis=1), _MIN_DISTANCE)
    attenuation = 1.0 / distance**2
    if light.range is not None:
        attenuation *= np.clip(1.0 - (distance / light.range) ** 4, 0.0, 1.0)
    if light.kind is LightKind.SPOT:
        scale, offset = _spot_falloff(light)
        attenuation *= np.clip(towards @ np.array(light.direction) / distance * scale + offset, 0.0, 1.0) ** 2
    illuminance: NDArray[np.float64] = brightest * attenuation
    return illuminance


def _spot_falloff(light: Light) -> tuple[float, float]:
    """Return scale and offset of a spot's falloff, a function of the cosine of the angle to its axis, before squaring.

    It is that of KHR_lights_punctual: (cos - cos outer) / (cos inner - cos outer), squared.
    """
    cos_inner, cos_outer = math.cos(light.inner_cone), math.cos(light.outer_cone)
    scale = 1.0 / max(cos_inner - cos_outer, 1e-3)
    return scale, -cos_outer * scale


def light_structs(lights: Sequence[Light], shadow_maps: Sequence[int], camera: Camera) -> NDArray[Any]:
    """Return an array of StudioLight, at least one; ``shadow_maps``: index of each light's shadow map, or -1."""
    X_camera_world = camera.X_camera_world
    structs = np.zeros(max(len(lights), 1), StudioLight.dtype)
    # Without lights, one struct is left as it is: zeros.
    for struct, light, shadow_map in zip(structs, lights, shadow_maps, strict=False):
        struct["kind"] = _KINDS[light.kind]
        struct["position"] = X_camera_world[:3, :3] @ light.position + X_camera_world[:3, 3]
        direction = X_camera_world[:3, :3] @ light.direction
        struct["direction"] = direction / np.linalg.norm(direction)
        struct["color"] = np.array(light.color) * light.intensity
        struct["inv_range_squared"] = 0.0 if light.range is None else 1.0 / max(light.range, _MIN_RANGE) ** 2
        struct["spot_scale"], struct["spot_offset"] = _spot_falloff(light)
        struct["shadow_map"] = shadow_map
    return structs
