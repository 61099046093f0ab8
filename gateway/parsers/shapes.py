"""Converts a parser's arrays to a ``Shape``."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gateway.parsers.mesh_data import Shape


def checked_triangles(faces: NDArray[np.int64], vertex_count: int, warnings: list[str]) -> NDArray[np.int64]:
    """Return the faces whose indices are below ``vertex_count``; a sentence is appended if others are left out."""
    if not faces.size or (faces.min() >= 0 and faces.max() < vertex_count):
        return faces
    worst = int(faces.min()) if faces.min() < 0 else int(faces.max())
    is_valid = ((faces >= 0) & (faces < vertex_count)).all(axis=1)
    count = len(faces) - np.count_nonzero(is_valid)
    warnings.append(
        f"{count} of {len(faces)} triangles refer to vertices that do not exist ({worst} of {vertex_count})"
    )
    return faces[is_valid]


def shape_of(
    positions: ArrayLike,
    triangles: NDArray[np.int64] | None,
    warnings: list[str],
    *,
    normals: ArrayLike | None = None,
    uv: ArrayLike | None = None,
    colors: NDArray[np.uint8] | None = None,
    color: tuple[float, float, float, float] | None = None,
    image: int | None = None,
) -> Shape | None:
    """Return a shape; None if it draws nothing.

    Args:
        warnings: A sentence is appended if triangles are left out, as their vertices are not finite in float32.
        uv: Texture coordinates; (0, 0) is the image's bottom left corner. They are kept without an image, too.
    """
    with np.errstate(over="ignore"):
        points = np.ascontiguousarray(positions, np.float32)
    if triangles is None:
        return Shape(points.tobytes(), None, colors=None if colors is None else colors.tobytes())
    finite = np.asarray(np.isfinite(points).all(axis=1))
    if not finite.all():
        is_drawn = finite[triangles].all(axis=1)
        if not is_drawn.all():
            count = len(triangles) - np.count_nonzero(is_drawn)
            warnings.append(f"{count} of {len(triangles)} triangles with vertices that are not finite are left out")
        triangles = triangles[is_drawn]
        points[~finite] = 0.0
    if not len(triangles):
        return None
    shape = Shape(points.tobytes(), np.ascontiguousarray(triangles, np.uint32).tobytes(), color=color)
    if normals is not None:
        shape.normals = _unit_rows(np.asarray(normals, np.float64)).tobytes()
    if colors is not None:
        shape.colors = np.ascontiguousarray(colors, np.uint8).tobytes()
    if uv is not None and np.shape(uv) == (len(points), 2) and np.isfinite(uv).all():
        flipped = np.array(uv, np.float32)
        flipped[:, 1] = 1.0 - flipped[:, 1]
        shape.uv, shape.image = flipped.tobytes(), image
    return shape


def _unit_rows(vectors: NDArray[np.float64]) -> NDArray[np.float32]:
    with np.errstate(all="ignore"):
        units = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.ascontiguousarray(np.nan_to_num(units, posinf=0.0, neginf=0.0), np.float32)
