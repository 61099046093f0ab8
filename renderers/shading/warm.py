"""Compilation of the kernels ahead of their first use."""

from __future__ import annotations

import numpy as np

from renderers.drawlist import Instance, Material, Mesh
from renderers.shading.compose import DIRECT
from renderers.shading.kernels import shade_rows
from renderers.shading.sampling import BYTE_VALUES
from renderers.shading.scene import normal_matrices, prepare
from renderers.shading.transfer import DECODED, GUESSES, THRESHOLDS


def warmup() -> None:
    """Shades one small picture, so that every kernel is compiled and lies in Numba's cache.

    There is one signature per kernel: looks, textures, topologies and modes are values, not types.
    """
    positions = np.array(((-1, -1, 1), (1, -1, 1), (0, 1, 1)), dtype=np.float32)
    mesh = Mesh(positions, np.array(((0, 2, 1),), dtype=np.uint32))
    shading = prepare((Instance(mesh, Material(), np.eye(4)),), "pbr")
    X = np.eye(4)[None]
    N = normal_matrices(X)
    ids = np.zeros((2, 4), dtype=np.int32)
    first_record = np.array((0, 1), dtype=np.int64)
    intrinsics = np.array((4.0, 4.0, 2.0, 1.0))
    color = np.zeros((2, 4, 3), dtype=np.uint8)
    shade_rows(
        True,
        DIRECT,
        ids,
        first_record,
        X,
        N,
        intrinsics,
        shading.instances,
        shading.material_integers,
        shading.material_floats,
        shading.texture_integers,
        shading.texture_floats,
        BYTE_VALUES,
        DECODED,
        THRESHOLDS,
        GUESSES,
        np.zeros(3, dtype=np.uint8),
        0,
        2,
        np.zeros((2, 4, 4), dtype=np.float32),
        color,
    )
