"""Primitives as meshes: attributes, elements and what is missing; equal primitives are one ``Mesh``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from gateway.scene.gltf.accessors import (
    ALIGNED_INDICES,
    INDICES,
    KINDS,
    POINTS,
    TEXTURE_COORDINATES,
    ZEROS,
    Accessor,
    Accessors,
)
from gateway.scene.gltf.cache import MeshCache, MeshKey, mesh_bytes
from gateway.scene.gltf.document import Primitive
from gateway.scene.gltf.elements import MODES, element_count, elements_of
from gateway.scene.gltf.errors import GltfError
from gateway.scene.gltf.kernels import is_sound, sum_normals
from gateway.scene.gltf.limits import GltfLimits
from gateway.scene.gltf.normals import NO_UV, unit_rows, vertex_normals
from renderers.drawlist import Mesh

Floats = NDArray[np.float32]
T = TypeVar("T", bound=np.generic)

_OPTIONAL: Final = {"NORMAL": (3,), "TANGENT": (4,), "TEXCOORD_0": (2,), "TEXCOORD_1": (2,), "COLOR_0": (3, 4)}
"""Attributes in use besides POSITION, with their numbers of components."""
_OTHERS: Final = ("TANGENT", "TEXCOORD_1", "COLOR_0")
_KINDS: Final = {
    "POSITION": {POINTS},
    "NORMAL": {POINTS},
    "TEXCOORD_0": {TEXTURE_COORDINATES},
    **{name: {kind for kind in KINDS if kind.components in _OPTIONAL[name]} for name in _OTHERS},
}
"""Attributes of plain meshes."""
_PLAIN: Final = frozenset({"POSITION", "NORMAL", "TEXCOORD_0"})
"""Those that are taken as they are."""
_F32: Final = np.dtype("<f4")
_U32: Final = np.dtype("<u4")
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


def _key(mode: int, indices: Accessor | None, attributes: dict[str, Accessor]) -> MeshKey:
    """Equal keys are equal meshes."""
    of = attributes.get
    position, normal, uv = of("POSITION"), of("NORMAL"), of("TEXCOORD_0")
    usual = (
        mode,
        indices.key if indices is not None else None,
        position.key if position is not None else None,
        normal.key if normal is not None else None,
        uv.key if uv is not None else None,
    )
    if len(attributes) == 1 + (normal is not None) + (uv is not None):
        return usual
    return (*usual, *[(name, attributes[name].key) for name in _OTHERS if name in attributes])


class Meshes:
    """Makes the meshes of one document."""

    def __init__(
        self,
        accessors: Accessors,
        cache: MeshCache,
        limits: GltfLimits,
        warnings: list[str],
        known: Meshes | None = None,
    ) -> None:
        """``known``: of a document that has the same accessors."""
        self._accessors = accessors
        self._cache = cache
        self._limits = limits
        self._warnings = warnings
        self._made: dict[MeshKey, Mesh | None] = {}
        self._before: dict[MeshKey, Mesh | None] = {} if known is None else known._made
        self._described: dict[tuple[object, ...], Mesh] = {}
        """By what primitives say."""
        self._described_before: dict[tuple[object, ...], Mesh] = {} if known is None else known._described
        self._counted: set[int] = set()
        """Identities of meshes that were counted against the limits; they are held by the tables above."""
        self.without_positions = ""
        """The first primitive that has none ..."""
        self.with_positions = False
        """... and whether any has."""
        self._vertices = self._elements = self.nbytes = 0

    def mesh(self, primitive: Primitive, index: int, number: int) -> Mesh | None:
        """The mesh of ``meshes[index].primitives[number]``; None when it has nothing to draw.

        Raises:
            GltfError: a reference or an index is out of range, or a limit is exceeded.
        """
        attributes = primitive.attributes
        if attributes is None:
            return self._any(primitive, f"meshes[{index}].primitives[{number}]")
        # Equal words about the same accessors mean the same mesh.
        words = (primitive.mode, primitive.indices, *attributes.items())
        mesh = self._described.get(words)
        if mesh is not None:
            return mesh
        mesh = self._described_before.get(words)
        if mesh is not None and self._takes(mesh):
            self.with_positions = True
        else:
            mesh = self._plain(primitive)
            if mesh is None:
                return self._any(primitive, f"meshes[{index}].primitives[{number}]")
        self._described[words] = mesh
        return mesh

    def _plain(self, primitive: Primitive) -> Mesh | None:
        """The mesh of a primitive as nearly all are: indexed triangles, as they lie in the buffers, without a fault and
        within the limits. None, and nothing done, for any other: the other way finds out what it is."""
        attributes, get = primitive.attributes, self._accessors.plain
        if attributes is None or primitive.indices is None or (primitive.mode is not None and primitive.mode != 4):
            return None
        found: dict[str, Accessor] = {}
        fewest = 1 << 62
        for name, at in attributes.items():
            kinds = _KINDS.get(name)
            if at is None or kinds is None:
                continue
            accessor = get(at)
            if accessor is None or accessor.kind not in kinds or accessor.offset & 3:
                return None
            found[name] = accessor
            if accessor.count < fewest:
                fewest = accessor.count
        position, indices = found.get("POSITION"), get(primitive.indices)
        if position is None or indices is None or indices.kind not in INDICES:
            return None
        n, m = position.count, indices.count // 3
        if n == 0 or m == 0 or 3 * m != indices.count or fewest < n:
            return None
        self.with_positions = True
        key = _key(4, indices, found)
        mesh = self._made.get(key)
        if mesh is not None:
            return mesh
        mesh = self._before.get(key) or self._cache.mesh(key)
        if mesh is None:
            if not self._fits(n, m):
                return None
            mesh = _read(position, indices, found)
            if mesh is None:
                return None
            buffers = {accessor.buffer for accessor in found.values()}
            buffers.add(indices.buffer)
            own = 12 * (("NORMAL" not in found) * n + (indices.kind is not ALIGNED_INDICES) * m)
            if not _PLAIN.issuperset(found):
                own = mesh_bytes(mesh, buffers)
            mesh = self._cache.add_mesh(key, mesh, buffers, own)
        if not self._takes(mesh):
            return None
        self._made[key] = mesh
        return mesh

    def _fits(self, vertices: int, elements: int) -> bool:
        limits, nbytes = self._limits, _VERTEX_BYTES * vertices + 12 * elements
        return (
            self._vertices + vertices <= limits.max_vertices
            and self._elements + elements <= limits.max_elements
            and self.nbytes + nbytes <= limits.max_mesh_bytes
        )

    def _takes(self, mesh: Mesh) -> bool:
        """Counts a mesh once against the limits; False, and nothing done: it would be beyond."""
        if id(mesh) in self._counted:
            return True
        vertices, elements = len(mesh.positions), len(mesh.elements)
        if not self._fits(vertices, elements):
            return False
        self._counted.add(id(mesh))
        self._vertices += vertices
        self._elements += elements
        self.nbytes += _VERTEX_BYTES * vertices + 12 * elements
        return True

    def _any(self, primitive: Primitive, name: str) -> Mesh | None:
        source = self._check(primitive, name)
        if source is None:
            return None
        key = _key(source.mode, source.indices, source.attributes)
        if key in self._made:
            return self._made[key]
        mesh = self._before.get(key) or self._cache.mesh(key)
        if mesh is not None:
            if not self._takes(mesh):
                self._charge(len(mesh.positions), len(mesh.elements), name)
        else:
            mesh = self._build(source)
            if mesh is not None:
                accessors = [*source.attributes.values(), *([source.indices] if source.indices is not None else [])]
                buffers = {buffer for accessor in accessors for buffer in accessor.buffers}
                mesh = self._cache.add_mesh(key, mesh, buffers, mesh_bytes(mesh, buffers))
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
        if position.buffer is ZEROS and position.sparse is None and _COMPRESSION in (primitive.extensions or {}):
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
        self.nbytes += _VERTEX_BYTES * vertices + 12 * elements
        limits = self._limits
        if self._vertices > limits.max_vertices:
            raise GltfError(f"{name}: the meshes have more vertices than max_vertices = {limits.max_vertices}")
        if self._elements > limits.max_elements:
            raise GltfError(f"{name}: the meshes have more elements than max_elements = {limits.max_elements}")
        if self.nbytes > limits.max_mesh_bytes:
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


def _read(position: Accessor, indices: Accessor, attributes: dict[str, Accessor]) -> Mesh | None:
    """The mesh of plain accessors: views of their buffers where that is possible; None: there is a fault."""
    n, m = position.count, indices.count // 3
    positions = _view(position, n, 3)
    limit = n
    if indices.kind is ALIGNED_INDICES and not indices.offset & 3:
        elements: NDArray[np.uint32] = np.ndarray((m, 3), _U32, indices.buffer.data, indices.offset)
    else:
        size = indices.kind.nbytes
        elements = np.ndarray((m, 3), indices.kind.dtype, indices.buffer.data, indices.offset).astype(_U32)
        elements.setflags(write=False)
        limit = min(n, (1 << 8 * size) - 1)  # the largest one of its type is forbidden
    uv, normal = attributes.get("TEXCOORD_0"), attributes.get("NORMAL")
    uvs = NO_UV if uv is None else _view(uv, n, 2)
    if normal is None:
        normals: Floats = np.empty((n, 3), _F32)
        sound = sum_normals(positions, elements, uvs, limit, normals)
        normals.setflags(write=False)
    else:
        normals = _view(normal, n, 3)
        sound = is_sound(positions, elements, uvs, limit, normals)
    if not sound:
        return None
    if len(attributes) == 1 + (uv is not None) + (normal is not None):
        return Mesh(positions, elements, normals, None if uv is None else uvs)
    others = (
        _frozen(repair(accessor.floats(0, n))) if (accessor := attributes.get(name)) is not None else None
        for name, repair in (("TEXCOORD_1", _finite), ("COLOR_0", _rgba), ("TANGENT", _tangents))
    )
    return Mesh(positions, elements, normals, None if uv is None else uvs, *others)


def _view(accessor: Accessor, count: int, components: int) -> Floats:
    """(count, components) float32 of a plain accessor; read-only, since buffers are ``bytes``."""
    return np.ndarray((count, components), _F32, accessor.buffer.data, accessor.offset)


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
