"""Triangle meshes that Drake sends as numbers (``float_data``)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gateway.drakeviewer.config import Limits
from gateway.drakeviewer.messages import MessageError
from gateway.scene.crease_normals import smooth_mesh
from gateway.scene.geometry import Surface
from renderers.drawlist import Mesh


def surface_of(numbers: NDArray[np.float32], limits: Limits) -> Surface | None:
    """Return the mesh in a geometry's ``float_data``; None without drawable triangles.

    Args:
        numbers: (2 + 3 V + 3 T,) float32: V, T, coordinates of V vertices, vertex indices of T triangles.

    Raises:
        MessageError: The numbers are not a mesh, or beyond a limit.
    """
    vertex_count, triangle_count = (_count(numbers, 0), _count(numbers, 1))
    if vertex_count > limits.vertices or triangle_count > limits.triangles:
        raise MessageError(
            f"a mesh has {vertex_count} vertices and {triangle_count} triangles, "
            f"the limits are {limits.vertices} and {limits.triangles}"
        )
    end = 2 + 3 * vertex_count
    if len(numbers) != end + 3 * triangle_count:
        raise MessageError(
            f"a mesh of {vertex_count} vertices and {triangle_count} triangles has {len(numbers)} numbers"
        )
    positions = numbers[2:end].reshape(vertex_count, 3).copy()
    with np.errstate(invalid="ignore"):
        indices = numbers[end:].reshape(triangle_count, 3).astype(np.int64)
    triangles = drawable_triangles(positions, indices)
    return Surface(Mesh(*smooth_mesh(positions, triangles))) if len(triangles) else None


def drawable_triangles(positions: NDArray[np.float32], indices: NDArray[np.integer]) -> NDArray[np.uint32]:
    """Return the triangles whose vertices are finite, (M, 3) uint32. The other vertices become 0.

    Args:
        positions: (V, 3) metres, changed in place.
        indices: (T, 3).

    Raises:
        MessageError: An index is not below V.
    """
    if indices.size and not (indices.min() >= 0 and indices.max() < len(positions)):
        raise MessageError(f"a triangle has the vertices {indices.min()} to {indices.max()} of {len(positions)}")
    triangles = indices.astype(np.uint32)
    finite = np.asarray(np.isfinite(positions).all(axis=1))
    if not finite.all():
        triangles = triangles[finite[triangles].all(axis=1)]
        positions[~finite] = 0.0
    return np.ascontiguousarray(triangles)


def _count(numbers: NDArray[np.float32], index: int) -> int:
    """Return a number as a count. Raises MessageError if it is missing, negative or not whole."""
    value = float(numbers[index]) if len(numbers) > index else -1.0
    if not (value >= 0.0 and value.is_integer()):
        raise MessageError(f"a mesh starts with {value:g}, which is not a number of vertices or triangles")
    return int(value)
