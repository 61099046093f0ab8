"""Converts vertex attributes to the form that ``Mesh`` requires: finite numbers, RGBA, directions of unit length."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.stop import check_stop

_ROWS_PER_STOP_CHECK: Final = 1 << 18
"""Vectors that NumPy processes between two checks of the ``StopFlag``."""
_UNIT_TOLERANCE: Final = 1e-3
"""Maximum deviation of a vector's length from 1 at which the vector is left as it is."""

Floats = NDArray[np.float32]
"""(N, number of components) float32."""


def rgba_colors(values: Floats) -> Floats:
    """Return RGB or RGBA colours, finite, as RGBA, clamped to 0 .. 1."""
    result = np.ones((len(values), 4), np.float32)
    result[:, : values.shape[1]] = np.clip(values, 0.0, 1.0)
    return result


def unit_normals(values: Floats, positions: Floats, elements: NDArray[np.uint32]) -> Floats | None:
    """Return normals at unit length, or None if no row has a direction.

    A vertex whose normal has no direction (zero or not finite) gets the normal of one of its triangles.
    """
    normals, invalid = unit_rows(values)
    if invalid.all():
        return None
    if invalid.any():
        normals[invalid] = (0.0, 0.0, 1.0)
        if elements.shape[1] == 3:
            triangles = elements[invalid[elements].any(axis=1)]
            a, b, c = positions[triangles].astype(np.float64).transpose(1, 0, 2)
            face_normals, has_no_area = unit_rows(np.cross(b - a, c - a))
            for corners in triangles[~has_no_area].T:  # (M,) vertex indices: the first corners, the second, the third
                is_replaced = invalid[corners]
                normals[corners[is_replaced]] = face_normals[~has_no_area][is_replaced]
    return normals


def unit_tangents(values: Floats) -> Floats:
    """Return tangents (N, 4) with xyz of unit length and w of 1 or -1; xyz without a direction becomes (1, 0, 0)."""
    xyz, invalid = unit_rows(np.ascontiguousarray(values[:, :3]))
    result = np.empty(values.shape, np.float32)
    result[:, :3] = xyz
    result[invalid, :3] = (1.0, 0.0, 0.0)
    result[:, 3] = np.where(values[:, 3] < 0.0, -1.0, 1.0)
    return result


def without_invalid_vertices(positions: Floats, elements: NDArray[np.uint32]) -> tuple[Floats, NDArray[np.uint32], int]:
    """Drop the triangles, lines and points with positions that are not finite.

    Return the positions with zeros instead of invalid ones, the remaining elements, and the number of dropped elements.
    """
    invalid = np.asarray(~np.isfinite(positions).all(axis=1))
    remaining = np.ascontiguousarray(elements[~invalid[elements].any(axis=1)])
    finite_positions = positions.copy()
    finite_positions[invalid] = 0.0
    return finite_positions, remaining, len(elements) - len(remaining)


def unit_rows(vectors: NDArray[Any]) -> tuple[Floats, NDArray[np.bool_]]:
    """Scale rows, (N, 3), to unit length; return them as they are if all lengths are 1 within 0.1 %.

    Also returns True, (N,), for rows without a direction (zero or not finite), which are not scaled.
    """
    invalid = np.zeros(len(vectors), np.bool_)
    block_size = _ROWS_PER_STOP_CHECK
    blocks = [slice(begin, begin + block_size) for begin in range(0, len(vectors), block_size)]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        if all(_are_unit_length(vectors[block]) for block in blocks):
            return vectors, invalid
        units = np.empty(vectors.shape, np.float32)
        for block in blocks:
            check_stop()
            float64_vectors = vectors[block].astype(np.float64)
            lengths = np.sqrt(np.einsum("ij,ij->i", float64_vectors, float64_vectors))
            invalid[block] = ~(np.isfinite(lengths) & (lengths > 0.0))
            lengths[invalid[block]] = 1.0
            units[block] = float64_vectors / lengths[:, None]
        return units, invalid


def _are_unit_length(vectors: NDArray[Any]) -> bool:
    check_stop()
    x, y, z = vectors.T
    squared_lengths = x * x + y * y + z * z
    return bool((np.abs(squared_lengths - 1.0) <= 2.0 * _UNIT_TOLERANCE).all())
