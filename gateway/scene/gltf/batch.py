"""Meshes of plain accessors, many at once: one call of a kernel looks at them all and makes what they lack.

Drake's scenes have hundreds of meshes of a few triangles, of which each would cost more to call for than to read.
"""

from __future__ import annotations

from collections.abc import Sequence
from struct import pack
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gateway.scene.gltf.accessors import Accessor
from gateway.scene.gltf.attributes import Floats, finite, frozen, rgba, tangents, with_alpha
from gateway.scene.gltf.bytewise import address_of_bytes, address_of_new
from gateway.scene.gltf.kernels import read_meshes
from renderers.drawlist import Mesh

Layout: TypeAlias = tuple[Accessor, Accessor, Accessor | None, Accessor | None, dict[str, Accessor] | None]
"""The plain accessors of indexed triangles, whose numbers fit: indices, positions, normals, texture coordinates, and
those of ``OTHERS`` by name."""
OTHERS: Final = {"TEXCOORD_1": finite, "COLOR_0": rgba, "TANGENT": tangents}
"""Attributes that are put right one by one."""

_F32: Final = np.dtype("<f4")
_U32: Final = np.dtype("<u4")
_SMALL: Final = 256
"""Vertices or triangles up to which a mesh's new arrays are views of ``bytes``."""
_LARGEST: Final = {1: 0xFF, 2: 0xFFFF, 4: 0xFFFFFFFF}
"""By the bytes of an index: the largest one, which is forbidden."""
_array: Final[Any] = np.ndarray


def _repaired(name: str, accessor: Accessor, n: int) -> Floats:
    values = accessor.floats(0, n)
    if name == "COLOR_0" and accessor.kind.normalized and accessor.kind.dtype.kind == "u":
        return with_alpha(values)  # they are in 0 .. 1
    return OTHERS[name](values)


def read_together(layouts: Sequence[Layout]) -> list[tuple[Mesh, int] | None]:
    """The meshes, views of their buffers where that is possible, and the bytes of what had to be made, -1 where it has
    to be looked for. None: there is a fault in it."""
    numbers: list[int] = []
    places: list[tuple[bytes | NDArray[Any] | None, bytes | NDArray[Any] | None]] = []
    for indices, position, normal, uv, _ in layouts:
        n, m, width = position.count, indices.count, indices.kind.nbytes
        to_normals = to_elements = 0
        normals: bytes | NDArray[Any] | None = None
        elements: bytes | NDArray[Any] | None = None
        if normal is None:
            normals, to_normals = _room(n)
        if width != 4:
            elements, to_elements = _room(m // 3)
        places.append((normals, elements))
        largest = _LARGEST[width]
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
            min(largest, n),
        )
    rows, sound = pack(f"{len(numbers)}q", *numbers), bytearray(len(layouts))
    read_meshes(address_of_bytes(rows), len(layouts), address_of_new(sound))
    made: list[tuple[Mesh, int] | None] = []
    for (indices, position, normal, uv, others), place, good in zip(layouts, places, sound, strict=True):
        if not good:
            made.append(None)
            continue
        n, m, nbytes = position.count, indices.count, 0
        if normal is not None:
            of_normals: Floats = _array((n, 3), _F32, normal.buffer.data, normal.offset)
        else:
            nbytes += 12 * n
            of_normals = _array((n, 3), _F32, place[0])
            if n > _SMALL:
                of_normals.setflags(write=False)
        if place[1] is None:
            of_elements: NDArray[np.uint32] = _array((m // 3, 3), _U32, indices.buffer.data, indices.offset)
        else:
            nbytes += 4 * m
            of_elements = _array((m // 3, 3), _U32, place[1])
            if m > 3 * _SMALL:
                of_elements.setflags(write=False)
        positions: Floats = _array((n, 3), _F32, position.buffer.data, position.offset)
        uvs = None if uv is None else _array((n, 2), _F32, uv.buffer.data, uv.offset)
        if others is None:
            made.append((Mesh(positions, of_elements, of_normals, uvs), nbytes))
            continue
        repaired = [
            None if (accessor := others.get(name)) is None else frozen(_repaired(name, accessor, n)) for name in OTHERS
        ]
        made.append((Mesh(positions, of_elements, of_normals, uvs, *repaired), -1))
    return made


def _room(count: int) -> tuple[bytes | NDArray[Any], int]:
    """Place for ``count`` times three values of 4 bytes, and its address. Nobody else has it yet: a kernel writes even
    to ``bytes``, which are made in a third of an array's time."""
    if count > _SMALL:
        array: NDArray[Any] = np.empty(3 * count, _U32)
        return array, address_of_new(array)
    room = bytes(12 * count)
    return room, address_of_bytes(room)
