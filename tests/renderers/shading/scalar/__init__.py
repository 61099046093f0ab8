"""Scalar reference for shading: one span, one pixel, one value at a time, weights in float64.

Images of ``renderers.shading``, which interpolates along spans in float32, may differ from it by one level of 255.
"""

from __future__ import annotations

import numpy as np

from renderers.camera import Camera
from renderers.drawlist import DrawList
from renderers.interface import Look
from renderers.shading import prepare
from renderers.shading.gamma import DECODED, THRESHOLDS
from renderers.visibility_buffer import Visibility
from tests.renderers.shading.scalar.kernels import shade_rows
from tests.renderers.shading.scalar.sampling import LINEAR_FROM_BYTE
from tests.renderers.shading.scalar.tables import instance_table, normal_matrices
from tests.renderers.shading.scalar.transfer import GUESSES


def shaded(scene: DrawList, seen: Visibility, camera: Camera, look: Look) -> np.ndarray:
    """(H, W, 3) uint8: the surface that is seen, opaque whatever the materials say."""
    shading = prepare(scene.instances, look.name)
    table, keep = instance_table(scene.instances, shading)
    color = np.empty((camera.height, camera.width, 3), np.uint8)
    shade_rows(
        look.name == "pbr",
        seen.ids,
        seen.first_ids,
        seen.X_camera_mesh,
        normal_matrices(seen.X_camera_mesh),
        np.array((camera.fx, camera.fy, camera.cx, camera.cy)),
        table,
        shading.material_integers,
        shading.material_floats,
        shading.texture_integers,
        shading.texture_floats,
        LINEAR_FROM_BYTE,
        DECODED,
        THRESHOLDS,
        GUESSES,
        np.array(look.background, np.uint8),
        0,
        camera.height,
        color,
    )
    del keep
    return color
