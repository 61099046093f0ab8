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

_OPTIONAL: Final = {"NORMAL": (3,), "TANGENT": (4,), "TEXCOORD_0": (2,), "TEXCOORD_1": (2,), "COLOR_0": (3, 4)}
"""Attributes that are read besides POSITION, with their numbers of components."""
_ATTRIBUTES: Final = ("POSITION", *_OPTIONAL)
_DRACO: Final = "KHR_draco_mesh_compression"
_RESTART: Final = {1: 0xFF, 2: 0xFFFF, 4: 0xFFFFFFFF}
"""Primitive restart values, which glTF forbids, by the size of an index."""
_VERTEX_BYTES: Final = 4 * (3 + 3 + 4 + 2 + 2 + 4)
_ELEMENT_BYTES: Final = 12


class _Source(msgspec.Struct, frozen=True, gc=False, eq=False):
    """A primitive whose references are checked."""

    name: str
    mode: int
    attributes: dict[str, Accessor]
    """POSITION and the attributes of ``_OPTIONAL`` that can be used."""
    indices: Accessor | None

    @property
    def key(self) -> MeshKey:
        accessors = (self.indices, *map(self.attributes.get, _ATTRIBUTES))
        return bytes((self.mode,)) + b"".join([b"\0" if a is None else b"\1" + a.key for a in accessors])


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
        if key in self._meshes:
            return self._meshes[key]
        mesh = self._meshes[key] = self._shared_or_new(key, source)
        self.nbytes += 0 if mesh is None else mesh.nbytes
        return mesh

    def _shared_or_new(self, key: MeshKey, source: _Source) -> Mesh | None:
        found = self._content.get(key)
        if isinstance(found, Mesh):
            self._charge(len(found.positions), len(found.elements), source.name)
            return found
        warning_count = len(self._warnings)
        mesh = self._build(source)
        # A mesh with a warning is not shared: the next document would not get the warning.
        if mesh is not None and len(self._warnings) == warning_count:
            self._content.put(key, mesh, mesh.nbytes)
        return mesh

    def _check(self, primitive: Primitive, name: str) -> _Source | None:
        """Check a primitive's references; None when it has no positions."""
        mode = TRIANGLES if primitive.mode is None else primitive.mode
        if not 0 <= mode < MODE_COUNT:
            raise GltfError(f"{name}.mode: {mode} is not between 0 and {MODE_COUNT - 1}")
        references = {key: value for key, value in (primitive.attributes or {}).items() if value is not None}
        if "POSITION" not in references:
            self.first_without_positions = self.first_without_positions or name
            self._warnings.append(f"{name}: no POSITION, nothing to draw")
            return None
        self.any_positions = True
        position = self._accessors.get(references["POSITION"], f"{name}.attributes.POSITION")
        if position.components != 3:
            raise GltfError(f"{name}.attributes.POSITION: {position.name} has {position.components} components, not 3")
        if position.buffer is None and position.sparse is None and _DRACO in (primitive.extensions or {}):
            raise GltfError(f"{name}: {_DRACO} is not supported")
        attributes = {"POSITION": position}
        for key, components in _OPTIONAL.items():
            if key not in references:
                continue
            accessor = self._accessors.get(references[key], f"{name}.attributes.{key}")
            if accessor.components not in components:
                self._warnings.append(f"{name}.attributes.{key}: {accessor.components} components, ignored")
            elif accessor.count < position.count:
                self._warnings.append(
                    f"{name}.attributes.{key}: {accessor.count} values for {position.count} vertices, ignored"
                )
            else:
                attributes[key] = accessor
        indices = None
        if primitive.indices is not None:
            indices = self._accessors.get(primitive.indices, f"{name}.indices")
            if indices.components != 1 or indices.dtype.kind == "f":
                raise GltfError(f"{name}.indices: {indices.name} is not an accessor of integers")
        return _Source(name, mode, attributes, indices)

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
        position, name = source.attributes["POSITION"], source.name
        count = element_count(source.mode, position.count if source.indices is None else source.indices.count)
        if count == 0:
            return None
        begin, end = 0, position.count
        self._charge(0, count, name)
        if source.indices is None:
            self._charge(end, 0, name)
            elements = elements_of(source.mode, np.arange(end, dtype=np.uint32))
        else:
            indices = source.indices.values()[:, 0]
            low, high = _index_range(source, indices)
            if 2 * (high + 1 - low) <= position.count:
                # Exporters let primitives share one big vertex buffer: keep only the range that this one uses.
                begin, end = low, high + 1
            self._charge(end - begin, 0, name)
            elements = elements_of(source.mode, indices)
            if begin:
                elements -= np.uint32(begin)
        return self._assemble(source, elements, begin, end)

    def _assemble(self, source: _Source, elements: NDArray[np.uint32], begin: int, end: int) -> Mesh | None:
        """Read the attributes of the vertices from ``begin`` to ``end``."""

        def read(name: str, convert: Callable[[Floats], Floats]) -> Floats | None:
            accessor = source.attributes.get(name)
            if accessor is None:
                return None
            check_stop()
            return convert(accessor.floats(begin, end))

        positions = source.attributes["POSITION"].floats(begin, end)
        if not np.isfinite(positions).all():
            positions, elements, dropped = without_invalid_vertices(positions, elements)
            self._warnings.append(f"{source.name}: {dropped} elements with vertices that are not finite are left out")
            if len(elements) == 0:
                return None
        normals = _normals(read("NORMAL", lambda normals: normals), positions, elements)
        uv0, uv1 = read("TEXCOORD_0", finite), read("TEXCOORD_1", finite)
        colors, tangents = read("COLOR_0", rgba), read("TANGENT", unit_tangents)
        for array in (positions, elements, normals, uv0, uv1, colors, tangents):
            if array is not None:
                array.setflags(write=False)
        return Mesh(positions, elements, normals, uv0, uv1, colors, tangents)


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


def _index_range(source: _Source, indices: NDArray[Any]) -> tuple[int, int]:
    """Return the smallest and the largest index.

    Raises:
        GltfError: An index is beyond the vertices, or the primitive restart value.
    """
    assert source.indices is not None
    position = source.attributes["POSITION"]
    low, high = int(np.minimum.reduce(indices)), int(np.maximum.reduce(indices))
    check_stop()
    if high == _RESTART[indices.itemsize]:
        raise GltfError(
            f"{source.name}.indices: {source.indices.name} has the index {high}, the largest of its component "
            "type, which glTF forbids: graphics libraries take it for the start of another primitive"
        )
    if low < 0 or high >= position.count:
        raise GltfError(
            f"{source.name}.indices: {source.indices.name} has the index {low if low < 0 else high}, "
            f"but {position.name} has {position.count} vertices"
        )
    return low, high
