"""Normals for meshes that come without, or with bad ones."""

from __future__ import annotations

from array import array
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.gltf.compare import address_of_new
from gateway.gltf.reader_kernels import read_meshes
from renderers.compiler.pointers import address_of
from renderers.stop import check_stop, current_stop

_BLOCK: Final = 1 << 18
"""Rows between two looks at the ``StopFlag``."""


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
    sound, stop = bytearray(1), current_stop()
    read_meshes(row.buffer_info()[0], 1, address_of_new(sound), stop.address)
    stop.check()
    return normals


def unit_rows(vectors: NDArray[np.float32], tolerance: float = 1e-3) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The rows at unit length (unchanged if all of them are within ``tolerance``), and which rows have no direction.

    Args:
        vectors: (N, 3) float32.

    Returns:
        (N, 3) float32 and (N,) bool: True where the row is zero or not finite; such rows are as they were.
    """
    bad = np.zeros(len(vectors), np.bool_)
    blocks = [slice(first, first + _BLOCK) for first in range(0, len(vectors), _BLOCK)]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for block in blocks:
            check_stop()
            squares = np.einsum("ij,ij->i", vectors[block], vectors[block])
            if not bool((np.abs(squares - 1.0) <= 2.0 * tolerance).all()):
                break
        else:
            return vectors, bad
        units = np.empty(vectors.shape, np.float32)
        for block in blocks:
            check_stop()
            wide = vectors[block].astype(np.float64)
            lengths = np.sqrt(np.einsum("ij,ij->i", wide, wide))
            bad[block] = ~(np.isfinite(lengths) & (lengths > 0.0))
            lengths[bad[block]] = 1.0
            units[block] = wide / lengths[:, None]
        return units, bad
