"""Converts vertex attributes to the form that ``Mesh`` requires: finite numbers, RGBA, tangents of unit length."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gateway.gltf.normals import unit_rows
from renderers.stop import check_stop

Floats = NDArray[np.float32]
"""(N, number of components) float32."""


def zero_if_not_finite(values: Floats) -> Floats:
    """Replace numbers that are not finite by zero."""
    return values if np.isfinite(values).all() else np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)


def rgba_colors(values: Floats) -> Floats:
    """Return RGB or RGBA colours as RGBA, clamped to 0 .. 1."""
    result = np.ones((len(values), 4), np.float32)
    result[:, : values.shape[1]] = np.clip(zero_if_not_finite(values), 0.0, 1.0)
    return result


def unit_tangents(values: Floats) -> Floats:
    """Return tangents (N, 4) with xyz of unit length and w of 1 or -1; xyz without a direction becomes (1, 0, 0)."""
    xyz, invalid = unit_rows(np.ascontiguousarray(values[:, :3]))
    check_stop()
    result = np.empty(values.shape, np.float32)
    result[:, :3] = xyz
    result[invalid, :3] = (1.0, 0.0, 0.0)
    result[:, 3] = np.where(values[:, 3] < 0.0, -1.0, 1.0)
    return result


def without_invalid_vertices(positions: Floats, elements: NDArray[np.uint32]) -> tuple[Floats, NDArray[np.uint32], int]:
    """Drop the triangles, lines and points with positions that are not finite.

    Returns:
        The positions with zeros instead of invalid ones, the remaining elements, and the number of dropped elements.
    """
    invalid = np.asarray(~np.isfinite(positions).all(axis=1))
    remaining = np.ascontiguousarray(elements[~invalid[elements].any(axis=1)])
    finite_positions = positions.copy()
    finite_positions[invalid] = 0.0
    return finite_positions, remaining, len(elements) - len(remaining)
