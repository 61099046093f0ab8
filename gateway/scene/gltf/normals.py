"""Normals for meshes that come without, or with bad ones."""

from __future__ import annotations

from array import array

import numpy as np
from numpy.typing import NDArray

from gateway.scene.gltf.bytewise import address_of_new
from gateway.scene.gltf.kernels import read_meshes
from renderers.pointers import address_of


def vertex_normals(positions: NDArray[np.float32], triangles: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Normals as RenderEngineVtk shows them: cross products, hence weighted by area, summed per vertex *index*.

    Vertices at the same place stay apart, so boxes of 24 vertices stay flat.

    Args:
        positions: (N, 3) float32, finite, C-contiguous.
        triangles: (M, 3) uint32, C-contiguous, every value < N (not checked).

    Returns:
        (N, 3) float32, unit length; (0, 0, 1) for vertices of no triangle with an area.
    """
    normals = np.empty(positions.shape, np.float32)
    places, corners = address_of(positions, np.float32), address_of(triangles, np.uint32)
    target = address_of(normals, np.float32)
    row = array("q", (places, len(positions), corners, triangles.size, 4, 0, 0, 0, target, -1))
    sound = bytearray(1)
    read_meshes(row.buffer_info()[0], 1, address_of_new(sound))
    return normals


def unit_rows(vectors: NDArray[np.float32], tolerance: float = 1e-3) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The rows at unit length (unchanged if all of them are within ``tolerance``), and which rows have no direction.

    Args:
        vectors: (N, 3) float32.

    Returns:
        (N, 3) float32 and (N,) bool: True where the row is zero or not finite; such rows are as they were.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        squares = np.einsum("ij,ij->i", vectors, vectors)
        if bool((np.abs(squares - 1.0) <= 2.0 * tolerance).all()):
            return vectors, np.zeros(len(vectors), np.bool_)
        wide = vectors.astype(np.float64)
        lengths = np.sqrt(np.einsum("ij,ij->i", wide, wide))
        bad = ~(np.isfinite(lengths) & (lengths > 0.0))
        lengths[bad] = 1.0
        return (wide / lengths[:, None]).astype(np.float32), bad
