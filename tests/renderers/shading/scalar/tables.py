"""What the scalar kernels read of a draw list."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from renderers.compiler.pointers import address_of
from renderers.drawlist import Instance
from renderers.shading.materials import MI_NORMAL
from renderers.shading.mikktspace import with_tangents
from renderers.shading.scene import ShadingScene

# Columns of the instance table.
II_TOPOLOGY = 0
II_MATERIAL = 1
II_ELEMENTS = 2
II_POSITIONS = 3
II_NORMALS = 4
II_UV0 = 5
II_UV1 = 6
II_COLORS = 7
II_TANGENTS = 8
II_COLUMNS = 9


def instance_table(instances: Sequence[Instance], shading: ShadingScene) -> tuple[np.ndarray, list[object]]:
    """(n, II_COLUMNS) int64, and what its addresses point into."""
    keep: list[object] = []
    table = np.zeros((max(len(instances), 1), II_COLUMNS), np.int64)
    for i, instance in enumerate(instances):
        mesh, texture = instance.mesh, instance.material.normal_texture
        material = int(shading.instances[i, 1])
        tangents = None
        if texture is not None and shading.material_integers[material, MI_NORMAL] >= 0:
            mesh = with_tangents(mesh, texture.uv_set)
            tangents = mesh.tangents
        arrays = (mesh.positions, mesh.normals, mesh.uv0, mesh.uv1, mesh.colors, tangents)
        keep += (mesh, tangents)
        addresses = (address_of(mesh.elements, np.uint32), *(address_of(a, np.float32) for a in arrays))
        table[i] = (mesh.elements.shape[1], material, *addresses)
    return table, keep


def normal_matrices(X_camera_mesh: np.ndarray) -> np.ndarray:
    """(n, 3, 3) float64: maps of normals, the inverse transpose up to a positive factor; defined for flat scales, too.

    Args:
        X_camera_mesh: (n, 4, 4) float64.
    """
    a = X_camera_mesh[:, :3, :3]
    with np.errstate(all="ignore"):  # instances that are not finite draw nothing
        cofactors = np.stack(
            (np.cross(a[:, 1], a[:, 2]), np.cross(a[:, 2], a[:, 0]), np.cross(a[:, 0], a[:, 1])),
            axis=1,
        )
        # cofactor(A) = det(A) A^-T: undo the determinant's sign (mirrored instances) and its size.
        size = np.abs(cofactors).max(axis=(1, 2), keepdims=True)
        sign = np.where(np.linalg.det(a) < 0.0, -1.0, 1.0)[:, None, None]
        result: np.ndarray = np.ascontiguousarray(cofactors * sign / np.where(size > 0.0, size, 1.0))
    return result
