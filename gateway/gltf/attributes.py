"""Attributes of vertices put right: numbers that are finite, colours with alpha, tangents of unit length."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gateway.gltf.normals import unit_rows
from renderers.stop import check_stop

Floats = NDArray[np.float32]
T = TypeVar("T", bound=np.generic)


def frozen(array: NDArray[T] | None) -> NDArray[T] | None:
    """Itself, read-only from now on."""
    if array is not None:
        array.setflags(write=False)
    return array


def finite(values: Floats) -> Floats:
    """Zeros where numbers are not finite."""
    return values if np.isfinite(values).all() else np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)


def rgba(values: Floats) -> Floats:
    """RGB or RGBA as RGBA in 0 .. 1."""
    return with_alpha(np.clip(finite(values), 0.0, 1.0))


def with_alpha(values: Floats) -> Floats:
    """RGB or RGBA as RGBA."""
    if values.shape[1] == 4:
        return values
    result = np.ones((len(values), 4), np.float32)
    result[:, :3] = values
    return result


def tangents(values: Floats) -> Floats:
    """Unit xyz; (1, 0, 0) where there is no direction; w is 1 or -1."""
    xyz, bad = unit_rows(np.ascontiguousarray(values[:, :3]))
    check_stop()
    result = np.empty(values.shape, np.float32)
    result[:, :3] = xyz
    result[bad, :3] = (1.0, 0.0, 0.0)
    result[:, 3] = np.where(values[:, 3] < 0.0, -1.0, 1.0)
    return result


def without_bad_vertices(positions: Floats, elements: NDArray[np.uint32]) -> tuple[Floats, NDArray[np.uint32], int]:
    """Positions with zeros where they are not finite, the elements that use none of those, and how many others."""
    bad = np.asarray(~np.isfinite(positions).all(axis=1))
    kept: NDArray[Any] = np.ascontiguousarray(elements[~bad[elements].any(axis=1)])
    cleaned = positions.copy()
    cleaned[bad] = 0.0
    return cleaned, kept, len(elements) - len(kept)
