"""Structs that the scalar kernels read of a draw list, beside the materials and textures of ``ShadingScene``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from renderers.color import srgb_colors_from_linear
from renderers.compiler.pointers import address_of
from renderers.compiler.structs import F32, I64, U32, Struct, pointer_to
from renderers.drawlist import Instance
from renderers.shading.mikktspace import with_tangents
from renderers.shading.scene import ShadingScene

INSTANCE = Struct(
    "ScalarInstance",
    {
        "topology": I64,  # vertices of a primitive
        "material": I64,
        "indices": pointer_to(U32),  # (M, topology)
        "positions": pointer_to(F32),
        "normals": I64,  # addresses of float32; 0: none
        "uv0": I64,
        "uv1": I64,
        "colors": I64,
        "tangents": I64,
    },
)


def instance_structs(instances: Sequence[Instance], shading: ShadingScene) -> tuple[np.ndarray, list[object]]:
    """Return (n,) INSTANCE, and the objects that its addresses point into."""
    keep: list[object] = []
    structs: np.ndarray[Any, Any] = np.zeros(max(len(instances), 1), INSTANCE.dtype)
    for i, instance in enumerate(instances):
        mesh, texture = instance.mesh, instance.material.normal_texture
        material = int(shading.instances["material"][i])
        tangents = None
        if texture is not None and shading.materials["normal_texture"][material] >= 0:
            mesh = with_tangents(mesh, texture.uv_set)
            tangents = mesh.tangents
        colors = mesh.colors
        if colors is not None and shading.look == "plain":
            colors = srgb_colors_from_linear(colors)
        arrays = (mesh.positions, mesh.normals, mesh.uv0, mesh.uv1, colors, tangents)
        keep += (mesh, tangents, colors)
        addresses = (address_of(mesh.elements, np.uint32), *(address_of(array, np.float32) for array in arrays))
        structs[i] = (mesh.elements.shape[1], material, *addresses)
    return structs, keep


def normal_matrices(X_camera_mesh: np.ndarray) -> np.ndarray:
    """Return the inverse transpose of each transform up to a positive factor, (n, 3, 3) float64, also for flat scales.

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
