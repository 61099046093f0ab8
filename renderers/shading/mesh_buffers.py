"""Interleaved vertex attributes of meshes, so that kernels load a vertex with one instruction."""

import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.cache import WeakCache
from renderers.color import srgb_colors_from_linear
from renderers.compiler.pointers import address_of
from renderers.drawlist import Mesh, used_vertices
from renderers.shading.layout import (
    EXTRA_COLUMNS,
    EXTRA_TANGENT,
    EXTRA_UV1,
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    VERTEX_COLUMNS,
    VERTEX_NORMAL,
    VERTEX_POSITION,
    VERTEX_UV0,
)
from renderers.shading.mikktspace import with_tangents


@dataclass(frozen=True, slots=True, eq=False)
class MeshBuffers:
    """Indices and interleaved vertex attributes of a mesh."""

    indices: NDArray[np.uint32]
    """(M, 1 | 2 | 3) indices into ``vertices``, whose order may differ from that of the mesh."""
    vertices: NDArray[np.float32]
    """(N, VERTEX_COLUMNS) position, normal and first texture coordinates; 0 for attributes that the mesh lacks."""
    colors: NDArray[np.float32] | None
    """(N, 4); None if the mesh has none."""
    extras: NDArray[np.float32] | None
    """(N, EXTRA_COLUMNS) tangent and second texture coordinates; None if the mesh lacks both."""
    attribute_bits: int
    """HAS_ bits of ``layout``."""

    @property
    def fields(self) -> tuple[int, int, int, int, int]:
        """The last five fields of ShadingInstance, from ``indices`` on. Valid while this object is alive."""
        return (
            address_of(self.indices, np.uint32),
            address_of(self.vertices, np.float32),
            address_of(self.colors, np.float32),
            address_of(self.extras, np.float32),
            self.attribute_bits,
        )

    @property
    def nbytes(self) -> int:
        return sum(a.nbytes for a in (self.indices, self.vertices, self.colors, self.extras) if a is not None)


_buffers: WeakCache[Mesh, dict[tuple[int, bool], MeshBuffers]] = WeakCache("vertices")
"""Buffers by mesh and by ``tangent_set`` and ``srgb_colors``, see ``buffers_of``."""
_lock = threading.Lock()


def buffers_of(mesh: Mesh, tangent_set: int, *, srgb_colors: bool = False) -> MeshBuffers:
    """Return the mesh's buffers, from the cache if possible.

    Args:
        tangent_set: 0 or 1: include tangents. If the mesh has none, they are generated from this set of texture
            coordinates. -1: no tangents.
        srgb_colors: True: encode the vertex colours as sRGB.

    Raises:
        ValueError, TypeError: the shape or dtype of an attribute is not as documented in ``Mesh``, so that kernels
            would read beyond its end.
    """
    key = tangent_set, srgb_colors
    buffers = (_buffers.get(mesh) or {}).get(key)
    if buffers is not None:
        return buffers
    buffers = _interleave(mesh, tangent_set, srgb_colors=srgb_colors)
    with _lock:
        by_key = {**(_buffers.get(mesh) or {}), key: buffers}
        _buffers.put(mesh, by_key, sum(each.nbytes for each in by_key.values()))
    return buffers


def _check_attributes(mesh: Mesh) -> None:
    count = len(mesh.positions)
    for name, width in (("positions", 3), ("normals", 3), ("uv0", 2), ("uv1", 2), ("colors", 4), ("tangents", 4)):
        array = getattr(mesh, name)
        if array is not None and array.shape != (count, width):
            raise ValueError(f"mesh with {count} vertices: {name} has shape {array.shape}, not {(count, width)}")
        address_of(array, np.float32)


def _interleave(mesh: Mesh, tangent_set: int, *, srgb_colors: bool) -> MeshBuffers:
    _check_attributes(mesh)
    if tangent_set >= 0:
        mesh = with_tangents(mesh, tangent_set)
    indices, count = mesh.elements, len(mesh.positions)
    used: slice | NDArray[np.intp] = slice(None)
    if count > max(64, indices.size):
        # Many glTF primitives share one long vertex array: keep only the vertices in use.
        used, indices = used_vertices(indices, count)
        count = len(used)
    attribute_bits = 0

    def interleave(rows: NDArray[np.float32], array: NDArray[np.float32] | None, column: int, bit: int) -> None:
        nonlocal attribute_bits
        if array is not None:
            attribute_bits |= bit
            rows[:, column : column + array.shape[1]] = array[used]

    vertices = np.zeros((count, VERTEX_COLUMNS), np.float32)
    vertices[:, VERTEX_POSITION : VERTEX_POSITION + 3] = mesh.positions[used]
    interleave(vertices, mesh.normals, VERTEX_NORMAL, HAS_NORMALS)
    interleave(vertices, mesh.uv0, VERTEX_UV0, HAS_UV0)
    colors = mesh.colors
    if colors is not None:
        attribute_bits |= HAS_COLORS
        colors = np.ascontiguousarray(colors[used])
        colors = srgb_colors_from_linear(colors) if srgb_colors else colors
    tangents = mesh.tangents if tangent_set >= 0 else None
    if mesh.uv1 is None and tangents is None:
        return MeshBuffers(indices, vertices, colors, None, attribute_bits)
    extras = np.zeros((count, EXTRA_COLUMNS), np.float32)
    interleave(extras, mesh.uv1, EXTRA_UV1, HAS_UV1)
    interleave(extras, tangents, EXTRA_TANGENT, HAS_TANGENTS)
    return MeshBuffers(indices, vertices, colors, extras, attribute_bits)
