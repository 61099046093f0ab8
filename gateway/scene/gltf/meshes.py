"""Primitives as meshes: attributes, elements and what is missing; equal primitives are one ``Mesh``."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.gltf.accessors import INDICES, KINDS, POINTS, TEXTURE_COORDINATES, ZEROS, Accessor, Accessors
from gateway.scene.gltf.attributes import Floats, finite, frozen, rgba, tangents, without_bad_vertices
from gateway.scene.gltf.batch import OTHERS, Layout, own_bytes, read_together
from gateway.scene.gltf.cache import Buffer, MeshCache, MeshKey, mesh_bytes
from gateway.scene.gltf.document import Primitive
from gateway.scene.gltf.elements import MODES, element_count, elements_of
from gateway.scene.gltf.errors import GltfError
from gateway.scene.gltf.limits import GltfLimits
from gateway.scene.gltf.normals import unit_rows, vertex_normals
from renderers.drawlist import Mesh

_OPTIONAL: Final = {"NORMAL": (3,), "TANGENT": (4,), "TEXCOORD_0": (2,), "TEXCOORD_1": (2,), "COLOR_0": (3, 4)}
"""Attributes in use besides POSITION, with their numbers of components."""
_KINDS: Final = {
    "POSITION": {POINTS},
    "NORMAL": {POINTS},
    "TEXCOORD_0": {TEXTURE_COORDINATES},
    **{name: {kind for kind in KINDS if kind.components in _OPTIONAL[name]} for name in OTHERS},
}
"""Attributes of plain meshes."""
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
    return (*usual, *[(name, attributes[name].key) for name in OTHERS if name in attributes])


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
        self._repaired: dict[MeshKey, Mesh | None] = {}
        """Those that there was a warning about, which no other document would hear if it got the mesh."""
        self._before: dict[MeshKey, Mesh | None] = {} if known is None else known._made
        self._prepared: dict[int, Mesh] = {}
        """By identity of the primitive, for as long as the document is read."""
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
        mesh = self._prepared.get(id(primitive))
        return self._any(primitive, f"meshes[{index}].primitives[{number}]") if mesh is None else mesh

    def finish(self) -> None:
        """Nothing is made any more: lets go of the cache, which may keep this."""
        self._prepared.clear()
        del self._cache

    def prepare(self, primitives: Iterable[Primitive | None]) -> None:
        """Makes the meshes of those that are as nearly all are, together: indexed triangles as they lie in the buffers,
        without a fault and within the limits. ``mesh`` finds out what the others are.

        Args:
            primitives: of the document, which holds them; in order.
        """
        described, before = self._described, self._described_before
        found: list[tuple[int, tuple[object, ...], MeshKey]] = []
        waiting: dict[MeshKey, Layout] = {}
        try:
            for primitive in primitives:
                if primitive is None or primitive.attributes is None:
                    continue
                # Equal words about the same accessors mean the same mesh.
                words: tuple[object, ...] = (primitive.mode, primitive.indices, *primitive.attributes.items())
                mesh = described.get(words)
                if mesh is None and before and (mesh := before.get(words)) is not None:
                    if not self._takes(mesh):
                        break
                    described[words] = mesh
                if mesh is not None:
                    self._prepared[id(primitive)] = mesh
                elif (layout := self._layout(primitive)) is not None:
                    key = _key(4, *layout)
                    found.append((id(primitive), words, key))
                    waiting[key] = layout
        except GltfError:
            pass  # a buffer that cannot be read: who asks for the mesh is told
        if waiting:
            made = self._together(waiting)
            for primitive_id, words, key in found:
                mesh = made.get(key)
                if mesh is not None:
                    self._prepared[primitive_id] = described[words] = mesh
        self.with_positions |= bool(self._prepared)

    def _layout(self, primitive: Primitive) -> Layout | None:
        """None: it is none of those that are read together."""
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
        n, m = position.count, indices.count
        if n == 0 or m == 0 or m % 3 or fewest < n or indices.offset % indices.kind.nbytes:
            return None
        return indices, found

    def _together(self, waiting: dict[MeshKey, Layout]) -> dict[MeshKey, Mesh]:
        """The meshes of these layouts, but for those that have a fault or are beyond the limits."""
        made: dict[MeshKey, Mesh] = {}
        new: dict[MeshKey, Layout] = {}
        known = self._cache.meshes(waiting)
        vertices = triangles = 0
        for key, layout in waiting.items():
            mesh = self._made.get(key) or self._before.get(key) or known.get(key)
            if mesh is not None:
                if self._takes(mesh):
                    made[key] = mesh
                continue
            vertices, triangles = vertices + layout[1]["POSITION"].count, triangles + layout[0].count // 3
            if not self._fits(vertices, triangles):
                break
            new[key] = layout
        if new:
            sound: list[tuple[MeshKey, Mesh, tuple[Buffer, ...], int]] = []
            for (key, layout), mesh in zip(new.items(), read_together([*new.values()]), strict=True):
                if mesh is not None:
                    indices, attributes = layout
                    buffers = (indices.buffer, *[accessor.buffer for accessor in attributes.values()])
                    plain = OTHERS.keys().isdisjoint(attributes)
                    own = own_bytes(*layout) if plain else mesh_bytes(mesh, buffers)
                    sound.append((key, mesh, buffers, own))
            for (key, *_), mesh in zip(sound, self._cache.add_meshes(sound), strict=True):
                if self._takes(mesh):
                    made[key] = mesh
        self._made.update(made)
        return made

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
        if key in self._repaired:
            return self._repaired[key]
        mesh = self._before.get(key) or self._cache.meshes((key,)).get(key)
        if mesh is not None:
            if not self._takes(mesh):
                self._charge(len(mesh.positions), len(mesh.elements), name)
        else:
            warnings = len(self._warnings)
            mesh = self._build(source)
            if len(self._warnings) > warnings:
                self._repaired[key] = mesh
                return mesh
            if mesh is not None:
                accessors = [*source.attributes.values(), *([source.indices] if source.indices is not None else [])]
                buffers = (*{buffer for accessor in accessors for buffer in accessor.buffers},)
                (mesh,) = self._cache.add_meshes([(key, mesh, buffers, mesh_bytes(mesh, buffers))])
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
        def read(name: str, repair: Callable[[Floats], Floats] = finite) -> Floats | None:
            accessor = source.attributes.get(name)
            return None if accessor is None else repair(accessor.floats(first, stop))

        positions = source.attributes["POSITION"].floats(first, stop)
        if not np.isfinite(positions).all():
            positions, elements, dropped = without_bad_vertices(positions, elements)
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
            read("COLOR_0", rgba),
            read("TANGENT", tangents),
        )
        return Mesh(*map(frozen, arrays))  # type: ignore[arg-type]  # in the order of its fields
