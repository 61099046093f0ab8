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
from gateway.scene.gltf.attributes import Floats, finite, frozen, rgba, tangents
from gateway.scene.gltf.bytewise import address_of_bytes
from gateway.scene.gltf.kernels import ROW, read_meshes
from renderers.drawlist import Mesh
from renderers.pointers import address_of

Layout: TypeAlias = tuple[Accessor, dict[str, Accessor]]
"""The plain accessors of indexed triangles, whose numbers fit: indices, and attributes by name."""
OTHERS: Final = {"TEXCOORD_1": finite, "COLOR_0": rgba, "TANGENT": tangents}
"""Attributes that are put right one by one."""

_F32: Final = np.dtype("<f4")
_U32: Final = np.dtype("<u4")
_SMALL: Final = 1024
"""Vertices or triangles up to which a mesh's new arrays are copied out of a common place: asking numpy for the address
of an array takes longer than copying them."""


def read_together(layouts: Sequence[Layout]) -> list[Mesh | None]:
    """The meshes: views of their buffers where that is possible. None: there is a fault in it."""
    needs = [_needs(indices, attributes) for indices, attributes in layouts]
    common = array("B", bytes(12 * sum([rows for need in needs for rows in need if rows <= _SMALL])))
    place = common.buffer_info()[0]
    own: list[NDArray[Any]] = []
    numbers: list[int] = []
    for (indices, attributes), (vertices, triangles) in zip(layouts, needs, strict=True):
        position, uv, normal = attributes["POSITION"], attributes.get("TEXCOORD_0"), attributes.get("NORMAL")
        n, size = position.count, indices.kind.nbytes
        to_normals = to_elements = 0
        if vertices > _SMALL:
            own.append(np.empty((vertices, 3), _F32))
            to_normals = address_of(own[-1], np.float32)
        elif vertices:
            to_normals, place = place, place + 12 * vertices
        if triangles > _SMALL:
            own.append(np.empty((triangles, 3), _U32))
            to_elements = address_of(own[-1], np.uint32)
        elif triangles:
            to_elements, place = place, place + 12 * triangles
        numbers += (
            address_of_bytes(position.buffer.data) + position.offset,
            n,
            address_of_bytes(indices.buffer.data) + indices.offset,
            indices.count,
            size,
            0 if uv is None else address_of_bytes(uv.buffer.data) + uv.offset,
            0 if normal is None else address_of_bytes(normal.buffer.data) + normal.offset,
            to_elements,
            to_normals,
            min(n, (1 << 8 * size) - 1),  # the largest index of a type is forbidden
        )
    rows = array("q", numbers)
    read_meshes(rows.buffer_info()[0], len(layouts))
    memory, begin, large = memoryview(common), 0, iter(own)
    made: list[Mesh | None] = []
    for layout, (vertices, triangles), sound in zip(layouts, needs, rows[ROW - 1 :: ROW], strict=True):
        normals = elements = None
        if vertices > _SMALL:
            normals = frozen(next(large))
        elif vertices:
            end = begin + 12 * vertices
            normals, begin = np.ndarray((vertices, 3), _F32, bytes(memory[begin:end])), end
        if triangles > _SMALL:
            elements = frozen(next(large))
        elif triangles:
            end = begin + 12 * triangles
            elements, begin = np.ndarray((triangles, 3), _U32, bytes(memory[begin:end])), end
        made.append(_mesh(*layout, normals, elements) if sound else None)
    return made


def _needs(indices: Accessor, attributes: dict[str, Accessor]) -> tuple[int, int]:
    """Rows of normals and of elements that have to be made."""
    return (
        0 if "NORMAL" in attributes else attributes["POSITION"].count,
        0 if indices.kind is ALIGNED_INDICES else indices.count // 3,
    )


def _mesh(
    indices: Accessor, attributes: dict[str, Accessor], normals: Floats | None, elements: NDArray[np.uint32] | None
) -> Mesh:
    """``normals``, ``elements``: what was made; None: the buffers have it."""
    position, uv = attributes["POSITION"], attributes.get("TEXCOORD_0")
    n = position.count
    positions: Floats = np.ndarray((n, 3), _F32, position.buffer.data, position.offset)
    if elements is None:
        elements = np.ndarray((indices.count // 3, 3), _U32, indices.buffer.data, indices.offset)
    if normals is None:
        normal = attributes["NORMAL"]
        normals = np.ndarray((n, 3), _F32, normal.buffer.data, normal.offset)
    uvs = None if uv is None else np.ndarray((n, 2), _F32, uv.buffer.data, uv.offset)
    if OTHERS.keys().isdisjoint(attributes):
        return Mesh(positions, elements, normals, uvs)
    others = (
        None if (accessor := attributes.get(name)) is None else frozen(repair(accessor.floats(0, n)))
        for name, repair in OTHERS.items()
    )
    return Mesh(positions, elements, normals, uvs, *others)


def own_bytes(indices: Accessor, attributes: dict[str, Accessor]) -> int:
    """Of the normals and elements that have to be made."""
    vertices, triangles = _needs(indices, attributes)
    return 12 * (vertices + triangles)
