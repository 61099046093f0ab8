"""Lights of an image as structs for kernels, in the camera's optical frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import Light, LightKind
from renderers.shading.studio.layout import LIGHT

DIRECTIONAL: Final = 0
POINT: Final = 1
SPOT: Final = 2
_KINDS: Final = {LightKind.DIRECTIONAL: DIRECTIONAL, LightKind.POINT: POINT, LightKind.SPOT: SPOT}


def light_structs(lights: Sequence[Light], shadow_maps: Sequence[int], camera: Camera) -> NDArray[Any]:
    """Return an array of LIGHT, one per light and at least one.

    Args:
        shadow_maps: each light's index among the shadow maps, or -1.
    """
    X_camera_world = camera.X_camera_world
    structs = np.zeros(max(len(lights), 1), LIGHT.dtype)
    for struct, light, shadow_map in zip(structs, lights, shadow_maps, strict=False):
        struct["kind"] = _KINDS[light.kind]
        struct["position"] = X_camera_world[:3, :3] @ light.position + X_camera_world[:3, 3]
        direction = X_camera_world[:3, :3] @ light.direction
        struct["direction"] = direction / np.linalg.norm(direction)
        struct["color"] = np.array(light.color) * light.intensity
        struct["inv_range_squared"] = 0.0 if light.range is None else 1.0 / light.range**2
        # The falloff of KHR_lights_punctual: (cos - cos outer) / (cos inner - cos outer), squared.
        cos_inner, cos_outer = math.cos(light.inner_cone), math.cos(light.outer_cone)
        scale = 1.0 / max(cos_inner - cos_outer, 1e-3)
        struct["spot_scale"], struct["spot_offset"] = scale, -cos_outer * scale
        struct["shadow_map"] = shadow_map
    return structs
