"""Primitives as meshes: attributes, elements and what is missing; equal primitives are one ``Mesh``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from gateway.scene.gltf.accessors import Accessor, Accessors
from gateway.scene.gltf.cache import MeshCache
from gateway.scene.gltf.document import Primitive
from gateway.scene.gltf.elements import MODES, element_count, elements_of
from gateway.scene.gltf.errors import GltfError
from gateway.scene.gltf.limits import GltfLimits
from gateway.scene.gltf.normals import unit_rows, vertex_normals
from renderers.drawlist import Mesh

Floats = NDArray[np.float32]
T = TypeVar("T", bound=np.generic)

_OPTIONAL: Final = {"NORMAL": (3,), "TANGENT": (4,), "TEXCOORD_0": (2,), "TEXCOORD_1": (2,), "COLOR_0": (3, 4)}
"""Attributes in use besides POSITION, with their numbers of components."""
_COMPRESSION: Final = "KHR_draco_mesh_compression"
_VERTEX_BYTES: Final = 4 * (3 + 3 + 4 + 2 + 2 + 4)


@dataclass(slots=True, eq=False)
class _Source:
    """A checked primitive."""

    name: str
    mode: int
    attributes: dict[str, Accessor]
    """POSITION and those of ``_OPTIONAL`` that can be used."""
    indices: Accessor | None

    @property
    def key(self) -> tuple[object, ...]:
        attributes = [item for name, accessor in sorted(self.attributes.items()) for item in (name, *accessor.key)]
        return (self.mode, *attributes, *(self.indices.key if self.indices is not None else ()))


class Meshes:
    """Makes the meshes of one document."""

    def __init__(self, accessors: Accessors, cache: MeshCache, limits: GltfLimits, warnings: list[str]) -> None:
        self._accessors = accessors
        self._cache = cache
        self._limits = limits
        self._warnings = warnings
        self._made: dict[tuple[object, ...], Mesh | None] = {}
        self.without_positions = ""
        """The first primitive that has none ..."""
        self.with_positions = False
        """... and whether any has."""
        self._vertices = self._elements = self._nbytes = 0

    def mesh(self, primitive: Primitive, name: str) -> Mesh | None:
        """The mesh of a primitive; None when it has nothing to draw.

        Args:
            name: ``meshes[2].primitives[0]``, for messages.

        Raises:
            GltfError: a reference or an index is out of range, or a limit is exceeded.
        """
        source = self._check(primitive, name)
        if source is None:
            return None
        key = source.key
        if key in self._made:
            return self._made[key]
        mesh = self._cache.mesh(key)
        if mesh is not None:
            self._charge(len(mesh.positions), len(mesh.elements), name)
        else:
            mesh = self._build(source)
            if mesh is not None:
                accessors = [*source.attributes.values(), *([source.indices] if source.indices is not None else [])]
                buffers = {b.uid: b for accessor in accessors for b in accessor.buffers}
                mesh = self._cache.add_mesh(key, mesh, list(buffers.values()))
        self._made[key] = mesh
        return mesh

    def _check(self, primitive: Primitive, name: str) -> _Source | None:
        mode = 4 if primitive.mode is None else primitive.mode
        if not 0 <= mode < len(MODES):
            raise GltfError(f"{name}.mode: {mode} is not between 0 and {len(MODES) - 1}")
        references = {key: value for key, value in (primitive.attributes or {}).items() if value is not None}
        if "POSITION" not in references:
            self.without_positions = self.without_positions or name
            self._warnings.append(f"{name}: no POSITION, nothing to draw")
            return None
        self.with_positions = True
        position = self._accessors.get(references["POSITION"], f"{name}.attributes.POSITION")
        if position.components != 3:
            raise GltfError(f"{name}.attributes.POSITION: {position.name} has {position.components} components, not 3")
        if position.buffer is None and position.sparse is None and _COMPRESSION in (primitive.extensions or {}):
            raise GltfError(f"{name}: {_COMPRESSION} is not supported")
        attributes = {"POSITION": position}
        for key, components in _OPTIONAL.items():
            if key in references:
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
        self._vertices += vertices
        self._elements += elements
        self._nbytes += _VERTEX_BYTES * vertices + 12 * elements
        limits = self._limits
        if self._vertices > limits.max_vertices:
            raise GltfError(f"{name}: the meshes have more vertices than max_vertices = {limits.max_vertices}")
        if self._elements > limits.max_elements:
            raise GltfError(f"{name}: the meshes have more elements than max_elements = {limits.max_elements}")
        if self._nbytes > limits.max_mesh_bytes:
            raise GltfError(f"{name}: the meshes need more bytes than max_mesh_bytes = {limits.max_mesh_bytes}")

    def _build(self, source: _Source) -> Mesh | None:
        position = source.attributes["POSITION"]
        used = source.indices.count if source.indices is not None else position.count
        count = element_count(source.mode, used)
        if count == 0:
            return None
        first, stop = 0, position.count
        if source.indices is None:
            self._charge(stop, count, source.name)
            elements = elements_of(source.mode, np.arange(stop, dtype=np.uint32))
        else:
            # Before the indices are looked at: a client can name the same ones many times.
            self._charge(0, count, source.name)
            indices = source.indices.raw()[:, 0]
            low, high = int(indices.min()), int(indices.max())
            if high == np.iinfo(indices.dtype).max:
                raise GltfError(
                    f"{source.name}.indices: {source.indices.name} has the index {high}, the largest of its component "
                    "type, which glTF forbids: graphics libraries take it for the start of another primitive"
                )
            if low < 0 or high >= position.count:
                raise GltfError(
                    f"{source.name}.indices: {source.indices.name} has the index {low if low < 0 else high}, "
                    f"but {position.name} has {position.count} vertices"
                )
            if 2 * (high + 1 - low) <= position.count:
                # Exporters let primitives share one big vertex buffer: keep only the range that this one uses.
                first, stop = low, high + 1
            self._charge(stop - first, 0, source.name)
            elements = elements_of(source.mode, indices)
            if first:
                elements = elements - np.uint32(first)
        return self._assemble(source, elements, first, stop)

    def _assemble(self, source: _Source, elements: NDArray[np.uint32], first: int, stop: int) -> Mesh | None:
        def read(name: str, repair: Callable[[Floats], Floats] = _finite) -> Floats | None:
            accessor = source.attributes.get(name)
            return None if accessor is None else repair(accessor.floats(first, stop))

        positions = source.attributes["POSITION"].floats(first, stop)
        if not np.isfinite(positions).all():
            positions, elements, dropped = _without_bad_vertices(positions, elements)
            self._warnings.append(f"{source.name}: {dropped} elements with vertices that are not finite are left out")
            if len(elements) == 0:
                return None
        triangles = elements.shape[1] == 3
        normals = read("NORMAL", lambda n: n)
        if normals is not None:
            normals, bad = unit_rows(normals)
            if bad.any():
                repaired = vertex_normals(positions, elements) if triangles else np.array([(0, 0, 1)], np.float32)
                normals = np.where(bad[:, None], repaired, normals)
        elif triangles:
            normals = vertex_normals(positions, elements)
        arrays = (
            positions,
            elements,
            normals,
            read("TEXCOORD_0"),
            read("TEXCOORD_1"),
            read("COLOR_0", _rgba),
            read("TANGENT", _tangents),
        )
        return Mesh(*map(_frozen, arrays))  # type: ignore[arg-type]  # in the order of its fields


def _frozen(array: NDArray[T] | None) -> NDArray[T] | None:
    if array is not None:
        array.flags.writeable = False
    return array


def _finite(values: Floats) -> Floats:
    return values if np.isfinite(values).all() else np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)


def _rgba(values: Floats) -> Floats:
    """RGB or RGBA as RGBA in 0 .. 1."""
    values = np.clip(_finite(values), 0.0, 1.0)
    if values.shape[1] == 4:
        return values
    result = np.ones((len(values), 4), np.float32)
    result[:, :3] = values
    return result


def _tangents(values: Floats) -> Floats:
    """Unit xyz; (1, 0, 0) where there is no direction; w is 1 or -1."""
    xyz, bad = unit_rows(np.ascontiguousarray(values[:, :3]))
    result = np.empty(values.shape, np.float32)
    result[:, :3] = xyz
    result[bad, :3] = (1.0, 0.0, 0.0)
    result[:, 3] = np.where(values[:, 3] < 0.0, -1.0, 1.0)
    return result


def _without_bad_vertices(positions: Floats, elements: NDArray[np.uint32]) -> tuple[Floats, NDArray[np.uint32], int]:
    """Positions with zeros where they are not finite, the elements that use none of those, and how many others."""
    bad = np.asarray(~np.isfinite(positions).all(axis=1))
    kept: NDArray[Any] = np.ascontiguousarray(elements[~bad[elements].any(axis=1)])
    cleaned = positions.copy()
    cleaned[bad] = 0.0
    return cleaned, kept, len(elements) - len(kept)
