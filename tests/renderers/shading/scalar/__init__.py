"""Scalar reference for shading: one span, one pixel, one value at a time, weights in float64.

Images of ``renderers.shading``, which interpolates along spans in float32, may differ from it by one level of 255.
"""

from __future__ import annotations

import numpy as np

from renderers.camera import Camera
from renderers.compiler.pointers import address_of
from renderers.drawlist import DrawList
from renderers.interface import Look
from renderers.shading import prepare
from renderers.shading.gamma import LINEAR_FROM_GAMMA, THRESHOLDS
from renderers.shading.layout import MATERIAL, TEXTURE
from renderers.visibility_buffer import Visibility
from tests.renderers.shading.scalar.gamma import GUESSES
from tests.renderers.shading.scalar.sampling import VALUE_FROM_BYTE
from tests.renderers.shading.scalar.shade_rows import TABLES, shade_rows
from tests.renderers.shading.scalar.tables import INSTANCE, instance_structs, normal_matrices


def shaded(scene: DrawList, visible: Visibility, camera: Camera, look: Look) -> np.ndarray:
    """Return the image of the visible surfaces, (H, W, 3) uint8, opaque whatever the materials say."""
    shading = prepare(scene.instances, look.name)
    instances, keep = instance_structs(scene.instances, shading)
    tables = np.zeros(1, TABLES.dtype)
    tables["instances"] = address_of(instances, INSTANCE.dtype)
    tables["materials"] = address_of(shading.materials, MATERIAL.dtype)
    tables["textures"] = address_of(shading.textures, TEXTURE.dtype)
    tables["value_from_byte"] = address_of(VALUE_FROM_BYTE, np.float32)
    tables["linear_from_gamma"] = address_of(LINEAR_FROM_GAMMA, np.float32)
    tables["thresholds"] = address_of(THRESHOLDS, np.float32)
    tables["guesses"] = address_of(GUESSES, np.uint8)
    color = np.empty((camera.height, camera.width, 3), np.uint8)
    shade_rows(
        look.name in ("pbr", "gltf"),
        visible.ids,
        visible.first_ids,
        visible.X_camera_mesh,
        normal_matrices(visible.X_camera_mesh),
        np.array((camera.fx, camera.fy, camera.cx, camera.cy)),
        address_of(tables, TABLES.dtype),
        np.array(look.background, np.uint8),
        color,
    )
    del keep
    return color
