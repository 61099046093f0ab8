"""Meshes of the models of objects, as PLY files. Equal meshes have equal files, whose names are their digests."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.transforms import Matrix
from renderers.drawlist import Instance, Topology, used_vertices
from scenegate.datasets.manifest import MODELS_FOLDER, ModelRecord
from scenegate.datasets.ply import encode_ply

_DIGEST_CHARS: Final = 32
"""Number of hexadecimal digits in the name of a file."""


def make_model(instances: Iterable[Instance], X_model_node: Matrix) -> tuple[ModelRecord, bytes] | None:
    """Return the record of the model of an object, and its file; None if it has no finite vertex.

    Args:
        instances: geometry of the object in the frame of its node. Points and lines have vertices, but no triangles.
        X_model_node: (4, 4), affine.
    """
    all_vertices: list[NDArray[np.float32]] = []
    all_triangles: list[NDArray[np.int64]] = []
    count = 0
    for instance in instances:
        mesh = instance.mesh
        used, elements = used_vertices(mesh.elements, len(mesh.positions))
        X = X_model_node @ instance.X_world_mesh
        all_vertices.append((mesh.positions[used] @ X[:3, :3].T + X[:3, 3]).astype(np.float32))
        if mesh.topology is Topology.TRIANGLES:
            flip = np.linalg.det(X[:3, :3]) < 0.0  # fronts stay fronts
            all_triangles.append((elements[:, ::-1] if flip else elements).astype(np.int64) + count)
        count += len(used)
    vertices = np.concatenate(all_vertices or [np.zeros((0, 3), np.float32)])
    triangles = np.concatenate(all_triangles or [np.zeros((0, 3), np.int64)])
    finite = vertices[np.isfinite(vertices).all(axis=1)]
    if not len(finite):
        return None
    data = encode_ply(vertices, triangles, "metres")
    digest = hashlib.sha256(data).hexdigest()
    low, high = (tuple(corner.tolist()) for corner in (finite.min(axis=0), finite.max(axis=0)))
    path = f"{MODELS_FOLDER}/{digest[:_DIGEST_CHARS]}.ply"
    return ModelRecord(path=path, sha256=digest, box=(low, high)), data
