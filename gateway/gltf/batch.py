"""Meshes of plain accessors, many at once: one call of a kernel looks at them all and makes what they lack.

Drake's scenes have hundreds of meshes of a few triangles, of which each would cost more to call for than to read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import itemgetter
from struct import pack
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gateway.gltf.accessors import COMPONENT_TYPES, POINTS, TEXTURE_COORDINATES, ZEROS, Accessor, Kind
from gateway.gltf.attributes import Floats, frozen, tangents
from gateway.gltf.compare import address_of_bytes, address_of_new
from gateway.gltf.content_cache import Buffer, MeshKey
from gateway.gltf.reader_kernels import CLIPPED, FINITE, SIGNED, TANGENT, gather, read_meshes
from renderers.drawlist import Mesh
from renderers.stop import current_stop

Layout: TypeAlias = tuple[Accessor, Accessor, Accessor | None, Accessor | None, dict[str, Accessor] | None, bool]
"""The accessors of triangles, whose numbers fit: indices (in ``ZEROS``: there are none), positions, normals, texture
coordinates, and those of ``OTHERS`` by name; and whether there are none of the latter and all are float32 as meshes
want them."""
_Copied: TypeAlias = tuple[list[Floats | None], int]
OTHERS: Final = {"TEXCOORD_1": (2, FINITE), "COLOR_0": (4, FINITE | CLIPPED), "TANGENT": (4, TANGENT)}
"""Attributes that are copied, their components, and what is put right."""

_AS_IT_LIES: Final = itemgetter(5)
_F32: Final = np.dtype("<f4")
_U32: Final = np.dtype("<u4")
_SMALL: Final = 4096
"""Vertices or triangles up to which a mesh's new arrays are views of ``bytes``, which are made in half of an array's
time; larger ones take longer to be filled with zeros."""
_LARGEST: Final = {1: 0xFF, 2: 0xFFFF, 4: 0xFFFFFFFF}
"""By the bytes of an index: the largest one, which is forbidden."""
_CODES: Final = {dtype: code for code, dtype in COMPONENT_TYPES.items()}
_array: Final[Any] = np.ndarray


def read_together(asked: Mapping[MeshKey, Layout]) -> list[tuple[MeshKey, Mesh, Sequence[Buffer], int]]:
    """The meshes without a fault, views of their buffers where that is possible: their keys, themselves, these buffers,
    and the bytes of what had to be made."""
    given = [*asked.values()]
    layouts, copied = (given, {}) if all(map(_AS_IT_LIES, given)) else _gathered(given)
    numbers: list[int] = []
    rooms: list[tuple[bytes | NDArray[Any] | None, bytes | NDArray[Any] | None]] = []
    for indices, position, normal, uv, *_ in layouts:
        n, m, width = position.count, indices.count, indices.kind.nbytes
        to_normals = to_elements = 0
        for_normals: bytes | NDArray[Any] | None = None
        for_elements: bytes | NDArray[Any] | None = None
        if normal is None:
            for_normals, to_normals = _room(3 * n)
        if width != 4 or indices.buffer is ZEROS:
            for_elements, to_elements = _room(m)
        rooms.append((for_normals, for_elements))
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
    stop = current_stop()
    read_meshes(address_of_bytes(rows), len(layouts), address_of_new(sound), stop.address)
    stop.check()
    made: list[tuple[MeshKey, Mesh, Sequence[Buffer], int]] = []
    elements: NDArray[np.uint32] | None = None
    uvs: Floats | None = None
    of_elements, of_uvs = (ZEROS, 0, 0), (ZEROS, 0, 0)
    at = -1
    for key, layout, room, good in zip(asked, layouts, rooms, sound, strict=True):
        at += 1
        if not good:
            continue
        indices, position, normal, uv, _, as_it_lies = layout
        for_normals, for_elements = room
        n, m, nbytes = position.count, indices.count, 0
        buffer = position.buffer
        of_indices = indices.buffer
        buffers: tuple[Buffer, ...] = (buffer,) if of_indices is ZEROS else (buffer, of_indices)
        positions: Floats = _array((n, 3), _F32, buffer.data, position.offset)
        if for_elements is not None:
            nbytes += 4 * m
            elements, of_elements = _array((m // 3, 3), _U32, for_elements), (ZEROS, 0, 0)
            if m > 3 * _SMALL:
                elements.setflags(write=False)
        elif elements is None or of_elements[0] is not of_indices or of_elements[1:] != (indices.offset, m):
            of_elements = of_indices, indices.offset, m  # boxes and spheres have the same ones
            elements = _array((m // 3, 3), _U32, of_indices.data, indices.offset)
        if normal is None:
            nbytes += 12 * n
            normals: Floats = _array((n, 3), _F32, for_normals)
            if n > _SMALL:
                normals.setflags(write=False)
        else:
            buffer = normal.buffer
            buffers += (buffer,)
            normals = _array((n, 3), _F32, buffer.data, normal.offset)
        if uv is None:
            uvs, of_uvs = None, (ZEROS, 0, 0)
        else:
            buffer = uv.buffer
            buffers += (buffer,)
            if uvs is None or of_uvs[0] is not buffer or of_uvs[1:] != (uv.offset, n):
                of_uvs = buffer, uv.offset, n
                uvs = _array((n, 2), _F32, buffer.data, uv.offset)
        if as_it_lies:
            made.append((key, Mesh(positions, elements, normals, uvs), buffers, nbytes))
        else:
            others, of_copies = copied[at]
            mesh = Mesh(positions, elements, normals, uvs, *others)
            made.append((key, mesh, _buffers(given[at]), nbytes + of_copies))
    return made


def _buffers(layout: Layout) -> list[Buffer]:
    """What a mesh is made of."""
    *accessors, others, _ = layout
    return [
        accessor.buffer
        for accessor in (*accessors, *(others or {}).values())
        if accessor is not None and accessor.buffer is not ZEROS
    ]


def _gathered(layouts: Sequence[Layout]) -> tuple[list[Layout], dict[int, _Copied]]:
    """The layouts with copies of what does not lie as meshes want it; by place, the arrays of ``OTHERS`` and the bytes
    that were copied."""
    result = [*layouts]
    copied: dict[int, _Copied] = {}
    numbers: list[int | float] = []
    arrays: list[Floats] = []
    others: list[tuple[int, int, Accessor, int]] = []
    for at, (indices, position, normal, uv, of_others, as_it_lies) in enumerate(layouts):
        if as_it_lies:
            continue
        n, first = position.count, len(arrays)
        points = _tight(position, n, POINTS, numbers, arrays) or position
        normals, uvs = _tight(normal, n, POINTS, numbers, arrays), _tight(uv, n, TEXTURE_COORDINATES, numbers, arrays)
        if of_others is not None:
            for place, (name, (components, purpose)) in enumerate(OTHERS.items()):
                accessor = of_others.get(name)
                if accessor is not None:
                    others.append((at, place, accessor, len(arrays)))
                    _copy(accessor, n, components, purpose, numbers, arrays)
        result[at] = (indices, points, normals, uvs, of_others, False)
        copied[at] = [None] * len(OTHERS), sum([array.nbytes for array in arrays[first:]])
    rows, sound = pack("8qd" * len(arrays), *numbers), bytearray(len(arrays))
    if arrays:
        stop = current_stop()
        gather(address_of_bytes(rows), len(arrays), address_of_new(sound), stop.address)
        stop.check()
    for at, place, accessor, number in others:
        good = bool(sound[number])
        copied[at][0][place] = arrays[number] if good else frozen(tangents(accessor.floats(0, layouts[at][1].count)))
    return result, copied


def _copy(
    accessor: Accessor, n: int, components: int, purpose: int, numbers: list[int | float], arrays: list[Floats]
) -> int:
    """Adds an array and what ``gather`` has to know to fill it; its address."""
    kind, (room, address) = accessor.kind, _room(components * n)
    if kind.normalized and kind.dtype.kind == "i":
        purpose |= SIGNED
    numbers += (accessor.buffer.address + accessor.offset, n, accessor.stride, _CODES[kind.dtype])
    numbers += (kind.components, components, purpose, address, kind.scale)
    values: Floats = _array((n, components), _F32, room)
    values.setflags(write=False)
    arrays.append(values)
    return address


def _tight(
    accessor: Accessor | None, n: int, kind: Kind, numbers: list[int | float], arrays: list[Floats]
) -> Accessor | None:
    """An accessor, or the one of a copy that lies as ``kind`` says."""
    if accessor is None or (accessor.kind is kind and accessor.stride == kind.nbytes):
        return accessor
    address = _copy(accessor, n, kind.components, 0, numbers, arrays)
    return Accessor(accessor.index, kind, accessor.count, Buffer(arrays[-1].data, address), 0, kind.nbytes)


def _room(count: int) -> tuple[bytes | NDArray[Any], int]:
    """Place for so many values of 4 bytes, and its address. Nobody else has it yet: a kernel may write to ``bytes``."""
    if count > 3 * _SMALL:
        array: NDArray[Any] = np.empty(count, _U32)
        return array, address_of_new(array)
    room = bytes(4 * count)
    return room, address_of_bytes(room)
