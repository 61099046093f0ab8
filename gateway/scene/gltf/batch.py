"""Meshes of plain accessors, many at once: one call of a kernel looks at them all and makes what they lack.

Drake's scenes have hundreds of meshes of a few triangles, of which each would cost more to call for than to read.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gateway.scene.gltf.accessors import ALIGNED_INDICES, Accessor
from gateway.scene.gltf.attributes import Floats, finite, frozen, rgba, tangents, with_alpha
from gateway.scene.gltf.bytewise import address_of_new
from gateway.scene.gltf.kernels import ROW, read_meshes
from renderers.drawlist import Mesh

Layout: TypeAlias = tuple[Accessor, Accessor, Accessor | None, Accessor | None, dict[str, Accessor] | None]
"""The plain accessors of indexed triangles, whose numbers fit: indices, positions, normals, texture coordinates, and
those of ``OTHERS`` by name."""
OTHERS: Final = {"TEXCOORD_1": finite, "COLOR_0": rgba, "TANGENT": tangents}
"""Attributes that are put right one by one."""

_F32: Final = np.dtype("<f4")
_U32: Final = np.dtype("<u4")
_SMALL: Final = 256
"""Vertices or triangles up to which a mesh's new arrays are copied out of a common place: to make an array takes longer
than copying them."""


def _repaired(name: str, accessor: Accessor, n: int) -> Floats:
    values = accessor.floats(0, n)
    if name == "COLOR_0" and accessor.kind.normalized and accessor.kind.dtype.kind == "u":
        return with_alpha(values)  # they are in 0 .. 1
    return OTHERS[name](values)


def read_together(layouts: Sequence[Layout]) -> list[tuple[Mesh, int] | None]:
    """The meshes, views of their buffers where that is possible, and the bytes of what had to be made, -1 where it has
    to be looked for. None: there is a fault in it."""
    size = 0
    for indices, position, normal, _, _ in layouts:
        if normal is None and position.count <= _SMALL:
            size += 12 * position.count
        if indices.kind is not ALIGNED_INDICES and indices.count <= 3 * _SMALL:
            size += 4 * indices.count
    common = bytearray(size)
    place = address_of_new(common) if size else 0
    own: list[NDArray[Any]] = []
    numbers: list[int] = []
    for indices, position, normal, uv, _ in layouts:
        n, m, width = position.count, indices.count, indices.kind.nbytes
        to_normals = to_elements = 0
        if normal is None:
            if n > _SMALL:
                own.append(large := np.empty((n, 3), _F32))
                to_normals = address_of_new(large)
            else:
                to_normals, place = place, place + 12 * n
        if indices.kind is not ALIGNED_INDICES:
            if m > 3 * _SMALL:
                own.append(large := np.empty((m // 3, 3), _U32))
                to_elements = address_of_new(large)
            else:
                to_elements, place = place, place + 4 * m
        numbers += (
            position.buffer.address + position.offset,
            n,
            indices.buffer.address + indices.offset,
            m,
            width,
            0 if uv is None else uv.buffer.address + uv.offset,
            0 if normal is None else normal.buffer.address + normal.offset,
            to_elements,
            to_normals,
            min(n, (1 << 8 * width) - 1),  # the largest index of a type is forbidden
        )
    rows = array("q", numbers)
    read_meshes(rows.buffer_info()[0], len(layouts))
    made: list[tuple[Mesh, int] | None] = []
    begin, whole, rest = 0, bytes(common), iter(own)
    for (indices, position, normal, uv, others), sound in zip(layouts, rows[ROW - 1 :: ROW], strict=True):
        n, m, nbytes = position.count, indices.count, 0
        normals: Floats
        elements: NDArray[np.uint32]
        if normal is not None:
            normals = np.ndarray((n, 3), _F32, normal.buffer.data, normal.offset)
        else:
            nbytes += 12 * n
            if n > _SMALL:
                normals = next(rest)
                normals.setflags(write=False)
            else:
                end = begin + 12 * n
                normals, begin = np.ndarray((n, 3), _F32, whole[begin:end]), end
        if indices.kind is ALIGNED_INDICES:
            elements = np.ndarray((m // 3, 3), _U32, indices.buffer.data, indices.offset)
        else:
            nbytes += 4 * m
            if m > 3 * _SMALL:
                elements = next(rest)
                elements.setflags(write=False)
            else:
                end = begin + 4 * m
                elements, begin = np.ndarray((m // 3, 3), _U32, whole[begin:end]), end
        if not sound:
            made.append(None)
            continue
        positions: Floats = np.ndarray((n, 3), _F32, position.buffer.data, position.offset)
        uvs = None if uv is None else np.ndarray((n, 2), _F32, uv.buffer.data, uv.offset)
        if others is None:
            made.append((Mesh(positions, elements, normals, uvs), nbytes))
            continue
        repaired = [
            None if (accessor := others.get(name)) is None else frozen(_repaired(name, accessor, n)) for name in OTHERS
        ]
        made.append((Mesh(positions, elements, normals, uvs, *repaired), -1))
    return made
