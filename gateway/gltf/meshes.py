"""Primitives as ``Mesh`` objects; primitives of equal content share one object."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.gltf.accessors import Accessor, Accessors
from gateway.gltf.errors import GltfError
from gateway.gltf.gltf_cache import ContentKey, MeshKey
from gateway.gltf.limits import GltfLimits
from gateway.gltf.normals import unit_rows, vertex_normals
from gateway.gltf.schema import Primitive
from gateway.gltf.topology import MODE_COUNT, TRIANGLES, element_count, elements_of
from gateway.gltf.vertex_attributes import Floats, finite, rgba, unit_tangents, without_invalid_vertices
from renderers.cache import Cache
from renderers.drawlist import Image, Mesh
from renderers.stop import check_stop

_COMPONENTS: Final = {
    "POSITION": (3,),
    "NORMAL": (3,),
    "TANGENT": (4,),
    "TEXCOORD_0": (2,),
    "TEXCOORD_1": (2,),
    "COLOR_0": (3, 4),
}
"""Attributes that are read, with their allowed numbers of components."""
_CONVERSIONS: Final[dict[str, tuple[str, Callable[[Floats], Floats]]]] = {
    "TEXCOORD_0": ("uv0", finite),
    "TEXCOORD_1": ("uv1", finite),
    "COLOR_0": ("colors", rgba),
    "TANGENT": ("tangents", unit_tangents),
}
"""Fields of ``Mesh`` and the functions that bring an attribute into their form."""
_MODE_KEYS: Final = [bytes((mode,)) for mode in range(MODE_COUNT)]
_DRACO: Final = "KHR_draco_mesh_compression"
_RESTART: Final = {1: 0xFF, 2: 0xFFFF, 4: 0xFFFFFFFF}
"""Primitive restart values, which glTF forbids, by the size of an index."""
_VERTEX_BYTES: Final = 4 * (3 + 3 + 4 + 2 + 2 + 4)
_ELEMENT_BYTES: Final = 12


class _Source(msgspec.Struct, frozen=True, gc=False, eq=False):
    """A primitive whose references are checked."""

    name: str
    """``meshes[2].primitives[0]``, for messages."""
    mode: int
    position: Accessor
    indices: Accessor | None
    attributes: dict[str, Accessor]
    """POSITION and the other attributes of ``_COMPONENTS`` that can be used."""

    @property
    def key(self) -> MeshKey:
        accessors = (self.indices, *map(self.attributes.get, _COMPONENTS))
        return b"".join([_MODE_KEYS[self.mode], *[b"\0" if a is None else a.key for a in accessors]])


class Meshes:
    """Reads the primitives of one document."""

    def __init__(
        self,
        accessors: Accessors,
        content: Cache[ContentKey, Mesh | Image],
        limits: GltfLimits,
        warnings: list[str],
    ) -> None:
        self._accessors = accessors
        self._content = content
        self._limits = limits
        self._warnings = warnings
        self._meshes: dict[MeshKey, Mesh | None] = {}
        self._vertex_count = self._element_count = self._nbytes = 0
        self.nbytes = 0
        """Size of all meshes, each counted once."""
        self.first_without_positions = ""
        """Name of the first primitive without POSITION."""
        self.any_positions = False
        """True once a primitive had a POSITION."""

    def read(self, primitive: Primitive, name: str) -> Mesh | None:
        """Return the mesh of a primitive; None when it draws nothing.

        Args:
            name: ``meshes[2].primitives[0]``, for messages.

        Raises:
            GltfError: A reference or an index is out of range, or a limit is exceeded.
        """
        check_stop()
        source = self._check(primitive, name)
        if source is None:
            return None
        key = source.key
        if key not in self._meshes:
            self._meshes[key] = self._cached_or_new(key, source)
        return self._meshes[key]

    def _cached_or_new(self, key: MeshKey, source: _Source) -> Mesh | None:
        cached = self._content.get(key)
        if isinstance(cached, Mesh):
            self._charge(len(cached.positions), len(cached.elements), source.name)
            self.nbytes += cached.nbytes
            return cached
        warning_count = len(self._warnings)
        mesh = self._build(source)
        if mesh is None:
            return None
        nbytes = mesh.nbytes
        self.nbytes += nbytes
        if len(self._warnings) == warning_count:  # otherwise the next document would not get the warning
            self._content.put(key, mesh, nbytes)
        return mesh

    def _check(self, primitive: Primitive, name: str) -> _Source | None:
        """Check a primitive's references; None when it has no positions."""
        mode = TRIANGLES if primitive.mode is None else primitive.mode
        if not 0 <= mode < MODE_COUNT:
            raise GltfError(f"{name}.mode: {mode} is not between 0 and {MODE_COUNT - 1}")
        references = primitive.attributes or {}
        position_index = references.get("POSITION")
        if position_index is None:
            self.first_without_positions = self.first_without_positions or name
            self._warnings.append(f"{name}: no POSITION, nothing to draw")
            return None
        self.any_positions = True
        position = self._accessors.get(position_index, f"{name}.attributes.POSITION")
        if position.components != 3:
            raise GltfError(f"{name}.attributes.POSITION: {position.name} has {position.components} components, not 3")
        if position.buffer is None and position.sparse is None and _DRACO in (primitive.extensions or {}):
            raise GltfError(f"{name}: {_DRACO} is not supported")
        attributes = {"POSITION": position}
        for attribute, index in references.items():
            if index is None or attribute not in _COMPONENTS or attribute == "POSITION":
                continue
            where = f"{name}.attributes.{attribute}"
            accessor = self._accessors.get(index, where)
            if accessor.components not in _COMPONENTS[attribute]:
                self._warnings.append(f"{where}: {accessor.components} components, ignored")
            elif accessor.count < position.count:
                self._warnings.append(f"{where}: {accessor.count} values for {position.count} vertices, ignored")
            else:
                attributes[attribute] = accessor
        indices = None
        if primitive.indices is not None:
            indices = self._accessors.get(primitive.indices, f"{name}.indices")
            if indices.components != 1 or indices.dtype.kind == "f":
                raise GltfError(f"{name}.indices: {indices.name} is not an accessor of integers")
        return _Source(name, mode, position, indices, attributes)

    def _charge(self, vertices: int, elements: int, name: str) -> None:
        """Count a mesh against the limits before it is allocated."""
        limits = self._limits
        self._vertex_count += vertices
        self._element_count += elements
        self._nbytes += _VERTEX_BYTES * vertices + _ELEMENT_BYTES * elements
        if self._vertex_count > limits.max_vertices:
            raise GltfError(f"{name}: the meshes have more vertices than max_vertices = {limits.max_vertices}")
        if self._element_count > limits.max_elements:
            raise GltfError(f"{name}: the meshes have more elements than max_elements = {limits.max_elements}")
        if self._nbytes > limits.max_mesh_bytes:
            raise GltfError(f"{name}: the meshes need more bytes than max_mesh_bytes = {limits.max_mesh_bytes}")

    def _build(self, source: _Source) -> Mesh | None:
        begin, end = 0, source.position.count
        count = element_count(source.mode, end if source.indices is None else source.indices.count)
        if count == 0:
            return None
        if source.indices is None:
            self._charge(end, count, source.name)
            elements = elements_of(source.mode, np.arange(end, dtype=np.uint32))
        else:
            self._charge(0, count, source.name)  # before the indices are searched
            indices = source.indices.values()[:, 0]
            low, high = _index_range(source, source.indices, indices)
            if 2 * (high + 1 - low) <= end:
                # Exporters let primitives share one big vertex buffer: keep only the range that this one uses.
                begin, end = low, high + 1
            self._charge(end - begin, 0, source.name)
            elements = elements_of(source.mode, indices)
            if begin:
                elements -= np.uint32(begin)
        return self._assemble(source, elements, begin, end)

    def _assemble(self, source: _Source, elements: NDArray[np.uint32], begin: int, end: int) -> Mesh | None:
        """Read the attributes of the vertices from ``begin`` to ``end``. Arrays of a ``Mesh`` are read-only."""
        positions = source.position.floats(begin, end)
        if not np.isfinite(positions).all():
            positions, elements, dropped = without_invalid_vertices(positions, elements)
            self._warnings.append(f"{source.name}: {dropped} elements with vertices that are not finite are left out")
            if len(elements) == 0:
                return None
        positions.setflags(write=False)
        elements.setflags(write=False)
        optional: dict[str, Floats] = {}
        normal = source.attributes.get("NORMAL")
        normals = _normals(None if normal is None else normal.floats(begin, end), positions, elements)
        if normals is not None:
            normals.setflags(write=False)
            optional["normals"] = normals
        for attribute, (field, convert) in _CONVERSIONS.items():
            if (accessor := source.attributes.get(attribute)) is not None:
                check_stop()
                values = optional[field] = convert(accessor.floats(begin, end))
                values.setflags(write=False)
        return Mesh(positions, elements, **optional)


def _normals(given: Floats | None, positions: Floats, elements: NDArray[np.uint32]) -> Floats | None:
    """Return the given normals at unit length, and computed ones of triangles where none are given."""
    triangles = elements.shape[1] == 3
    if given is None:
        return vertex_normals(positions, elements) if triangles else None
    normals, invalid = unit_rows(given)
    if invalid.any():
        computed = vertex_normals(positions, elements) if triangles else np.array([(0, 0, 1)], np.float32)
        normals = np.where(invalid[:, None], computed, normals)
    return normals


def _index_range(source: _Source, accessor: Accessor, indices: NDArray[Any]) -> tuple[int, int]:
    """Return the smallest and the largest index.

    Args:
        indices: (N,), N > 0, the values of ``accessor``.

    Raises:
        GltfError: An index is beyond the vertices, or the primitive restart value.
    """
    low, high = int(np.minimum.reduce(indices)), int(np.maximum.reduce(indices))
    check_stop()
    if high == _RESTART[indices.itemsize]:
        raise GltfError(
            f"{source.name}.indices: {accessor.name} has the index {high}, the largest of its component "
            "type, which glTF forbids: graphics libraries take it for the start of another primitive"
        )
    if low < 0 or high >= source.position.count:
        raise GltfError(
            f"{source.name}.indices: {accessor.name} has the index {low if low < 0 else high}, "
            f"but {source.position.name} has {source.position.count} vertices"
        )
    return low, high
