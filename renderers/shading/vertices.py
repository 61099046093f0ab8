"""A mesh's vertices as records that kernels load with one instruction, made once per mesh."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import Cache
from renderers.compiler.pointers import address_of
from renderers.drawlist import Mesh, used_vertices
from renderers.shading.layout import (
    E_COLOR,
    E_COLUMNS,
    E_TANGENT,
    E_UV1,
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    V_COLUMNS,
    V_NORMAL,
    V_POSITION,
    V_UV0,
)
from renderers.shading.mikktspace import with_tangents
from renderers.stop import check_stop

MAX_VERTEX_BYTES: Final = 512 << 20
"""Records that are kept for meshes that are alive: sixteen million vertices without colours."""


@dataclass(frozen=True, slots=True, eq=False)
class VertexRecords:
    """What shading reads of a mesh."""

    elements: NDArray[np.uint32]
    """(M, 1 | 2 | 3), into the records, whose order need not be that of the mesh's vertices."""
    vertices: NDArray[np.float32]
    """(N, V_COLUMNS): position, normal and first texture coordinates, 0 where the mesh has none."""
    extras: NDArray[np.float32] | None
    """(N, E_COLUMNS): colour, second texture coordinates and tangent; None where the mesh has none of them."""
    has: int
    """Sum of the HAS_ constants."""

    @property
    def columns(self) -> tuple[int, int, int, int]:
        """As in the instance table from II_ELEMENTS on; valid while this object is alive."""
        return (
            address_of(self.elements, np.uint32),
            address_of(self.vertices, np.float32),
            address_of(self.extras, np.float32),
            self.has,
        )

    @property
    def nbytes(self) -> int:
        return self.elements.nbytes + self.vertices.nbytes + (0 if self.extras is None else self.extras.nbytes)


_records: Cache[Mesh, dict[int, VertexRecords]] = Cache(MAX_VERTEX_BYTES, weak=True)
"""By mesh, then by the set of coordinates that its tangents follow (-1: no tangents)."""
_lock = threading.Lock()


def records_of(mesh: Mesh, tangent_set: int) -> VertexRecords:
    """The mesh's records, made once while it is alive and was used lately.

    Args:
        tangent_set: 0 or 1: tangents are wanted, and where the mesh has none, they follow this set of texture
            coordinates. -1: they are not wanted.

    Raises:
        ValueError, TypeError: an attribute has another shape or dtype than ``Mesh`` says: kernels would read beyond it.
    """
    known = (_records.get(mesh) or {}).get(tangent_set)
    if known is not None:
        return known
    fresh = _make(mesh, tangent_set)
    with _lock:
        sets = {**(_records.get(mesh) or {}), tangent_set: fresh}
        _records.put(mesh, sets, sum(each.nbytes for each in sets.values()))
    return fresh


def _make(mesh: Mesh, tangent_set: int) -> VertexRecords:
    check_stop()
    count = len(mesh.positions)
    for name, array, width in (
        ("positions", mesh.positions, 3),
        ("normals", mesh.normals, 3),
        ("uv0", mesh.uv0, 2),
        ("uv1", mesh.uv1, 2),
        ("colors", mesh.colors, 4),
        ("tangents", mesh.tangents, 4),
    ):
        if array is not None and array.shape != (count, width):
            raise ValueError(f"mesh with {count} vertices: {name} has shape {array.shape}, not {(count, width)}")
        address_of(array, np.float32)
    if tangent_set >= 0:
        mesh = with_tangents(mesh, tangent_set)
        count = len(mesh.positions)
    tangents = mesh.tangents if tangent_set >= 0 else None
    elements = mesh.elements
    used: slice | NDArray[np.intp] = slice(None)
    if count > max(64, elements.size):
        # Many glTF primitives share one long vertex array: keep only what this one uses.
        used, elements = used_vertices(elements, count)
        count = len(used)
    has = 0
    vertices = np.zeros((count, V_COLUMNS), np.float32)
    vertices[:, V_POSITION : V_POSITION + 3] = mesh.positions[used]
    for array, column, bit in ((mesh.normals, V_NORMAL, HAS_NORMALS), (mesh.uv0, V_UV0, HAS_UV0)):
        if array is not None:
            check_stop()
            has |= bit
            vertices[:, column : column + array.shape[1]] = array[used]
    extras = None
    more = ((mesh.colors, E_COLOR, HAS_COLORS), (mesh.uv1, E_UV1, HAS_UV1), (tangents, E_TANGENT, HAS_TANGENTS))
    if any(array is not None for array, _, _ in more):
        extras = np.zeros((count, E_COLUMNS), np.float32)
        for array, column, bit in more:
            if array is not None:
                check_stop()
                has |= bit
                extras[:, column : column + array.shape[1]] = array[used]
    return VertexRecords(elements, vertices, extras, has)
