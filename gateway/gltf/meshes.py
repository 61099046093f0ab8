"""Primitives as meshes: attributes, elements and what is missing; equal primitives are one ``Mesh``."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from struct import Struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.gltf.accessors import (
    INDICES,
    KEY,
    KINDS,
    NOTHING,
    POINTS,
    TEXTURE_COORDINATES,
    ZEROS,
    Accessor,
    Accessors,
    one_after_the_other,
)
from gateway.gltf.attributes import Floats, finite, frozen, rgba, tangents, without_bad_vertices
from gateway.gltf.batch import OTHERS, Layout, read_together
from gateway.gltf.content_cache import MeshCache, MeshKey, mesh_bytes
from gateway.gltf.document import Primitive
from gateway.gltf.errors import GltfError
from gateway.gltf.limits import GltfLimits
from gateway.gltf.normals import unit_rows, vertex_normals
from gateway.gltf.topology import MODES, element_count, elements_of
from renderers.drawlist import Mesh
from renderers.stop import check_stop

_OPTIONAL: Final = {"NORMAL": (3,), "TANGENT": (4,), "TEXCOORD_0": (2,), "TEXCOORD_1": (2,), "COLOR_0": (3, 4)}
"""Attributes in use besides POSITION, with their numbers of components."""
_NUMBERS: Final = {kind for kind in KINDS if kind.dtype.itemsize <= 4}
_KINDS_OF: Final = {
    "POSITION": {kind for kind in _NUMBERS if kind.components == 3},
    **{name: {kind for kind in _NUMBERS if kind.components in count} for name, count in _OPTIONAL.items()},
}
"""Attributes of meshes that are read together, and what their values are."""
_USUAL: Final = {"POSITION": POINTS, "NORMAL": POINTS, "TEXCOORD_0": TEXTURE_COORDINATES}
"""What needs no copy, if it is tight."""
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


_pack_keys: Final = Struct("=20qB").pack


def _plain_key(layout: Layout) -> MeshKey:
    """What ``_key`` gives."""
    i, p, normal, uv, others, _ = layout
    n, t = NOTHING if normal is None else normal, NOTHING if uv is None else uv
    usual = _pack_keys(
        i.buffer.uid, i.offset, i.stride, i.count, i.kind.code,
        p.buffer.uid, p.offset, p.stride, p.count, p.kind.code,
        n.buffer.uid, n.offset, n.stride, n.count, n.kind.code,
        t.buffer.uid, t.offset, t.stride, t.count, t.kind.code,
        4,
    )  # fmt: skip
    return usual if others is None else (usual, *[(name, others[name].key) for name in OTHERS if name in others])


def _key(mode: int, indices: Accessor | None, attributes: dict[str, Accessor]) -> MeshKey:
    """Equal keys are equal meshes."""
    of = attributes.get
    position = attributes["POSITION"]
    usual = [indices or one_after_the_other(position.count), position, of("NORMAL", NOTHING), of("TEXCOORD_0", NOTHING)]
    keys = [accessor.key for accessor in usual]
    others = [(name, attributes[name].key) for name in OTHERS if name in attributes]
    if any(len(key) != KEY for key in keys):
        return (mode, *keys, *others)  # with sparse parts, it could be taken apart in several ways
    joined = b"".join((*keys, bytes((mode,))))
    return (joined, *others) if others else joined


class Meshes:
    """Makes the meshes of one document."""

    def __init__(
        self,
        accessors: Accessors,
        cache: MeshCache,
        limits: GltfLimits,
        warnings: list[str],
    ) -> None:
        self._accessors = accessors
        self._cache = cache
        self._limits = limits
        self._warnings = warnings
        self._made: dict[MeshKey, Mesh | None] = {}
        self._repaired: dict[MeshKey, Mesh | None] = {}
        """Those that there was a warning about, which no other document would hear if it got the mesh."""
        self.prepared: dict[int, Mesh] = {}
        """By identity of the primitive, for as long as the document is read."""
        self._counted: set[int] = set()
        """Identities of meshes that were counted against the limits; they are held by the tables above."""
        self.without_positions = ""
        """The first primitive that has none ..."""
        self.with_positions = False
        """... and whether any has."""
        self._vertices = self._elements = self.nbytes = 0

    def mesh(self, primitive: Primitive, index: int, number: int) -> Mesh | None:
        """The mesh of ``meshes[index].primitives[number]``, which is not among ``prepared``; None when it has nothing
        to draw.

        Raises:
            GltfError: a reference or an index is out of range, or a limit is exceeded.
        """
        check_stop()
        return self._any(primitive, f"meshes[{index}].primitives[{number}]")

    def prepare(self, primitives: Iterable[Primitive | None]) -> None:
        """Makes the meshes of those that are as nearly all are, together: triangles as they lie in the buffers, without
        a fault and within the limits. They are ``prepared`` then; ``mesh`` finds out what the others are.

        Args:
            primitives: of the document, which holds them; in order.
        """
        prepared, accessors = self.prepared, self._accessors
        new: list[Primitive] = []
        wanted: dict[int | None, None] = {}
        for primitive in primitives:
            if primitive is None or primitive.attributes is None:
                continue
            if primitive.mode is None or primitive.mode == 4:
                new.append(primitive)
                for name, at in primitive.attributes.items():
                    if name in _KINDS_OF:
                        wanted[at] = None
                wanted[primitive.indices] = None
        wanted.pop(None, None)
        if wanted:
            accessors.prepare(wanted)  # type: ignore[arg-type]  # without None
        waiting: dict[MeshKey, Layout] = {}
        asked: list[tuple[Primitive, MeshKey]] = []
        vertices = triangles = 0
        for primitive in new:
            layout = self._layout(primitive)
            if layout is not None:
                key = _plain_key(layout)
                asked.append((primitive, key))
                if key not in waiting:
                    waiting[key] = layout
                    vertices += layout[1].count
                    triangles += layout[0].count // 3
        if waiting:
            self._together(waiting, vertices, triangles)
            made = self._made.get
            for primitive, key in asked:
                if (mesh := made(key)) is not None:
                    prepared[id(primitive)] = mesh
        self.with_positions |= bool(prepared)

    def _layout(self, primitive: Primitive) -> Layout | None:
        """Of triangles whose accessors were prepared; None: it is none of those that are read together."""
        known = self._accessors.known.get
        indices = known(primitive.indices)  # type: ignore[arg-type]  # there is none for None
        if indices is None:
            if primitive.indices is not None:
                return None
        elif indices.kind not in INDICES:
            return None
        assert primitive.attributes is not None
        position = normal = uv = others = None
        as_it_lies = True
        fewest = 1 << 62
        for name, at in primitive.attributes.items():
            accessor = known(at)  # type: ignore[arg-type]  # there is none for None
            if accessor is None:
                if at is None or name not in _KINDS_OF:
                    continue
                return None
            kind = accessor.kind
            if kind is not _USUAL.get(name) or accessor.stride != kind.nbytes or accessor.offset & 3:
                kinds, size = _KINDS_OF.get(name), kind.dtype.itemsize
                if kinds is None:
                    continue
                if kind not in kinds or accessor.offset % size or accessor.stride % size:
                    return None
                as_it_lies = False
            if accessor.count < fewest:
                fewest = accessor.count
            if name == "POSITION":
                position = accessor
            elif name == "NORMAL":
                normal = accessor
            elif name == "TEXCOORD_0":
                uv = accessor
            else:
                others = {} if others is None else others
                others[name] = accessor
        if position is None:
            return None
        if indices is None:
            indices = one_after_the_other(position.count)
        n, m, size = position.count, indices.count, indices.kind.nbytes
        if n == 0 or m == 0 or m % 3 or fewest < n or indices.offset % size or indices.stride != size:
            return None
        return indices, position, normal, uv, others, as_it_lies

    def _together(self, waiting: dict[MeshKey, Layout], vertices: int, triangles: int) -> None:
        """Makes these meshes, of so many vertices and triangles, but for those that have a fault or are beyond the
        limits."""
        new, made = waiting, self._made
        known = self._cache.meshes(waiting)
        if known or made or not self._fits(vertices, triangles):
            vertices = triangles = 0
            new = {}
            for key, layout in waiting.items():
                mesh = made.get(key) or known.get(key)
                if mesh is not None:
                    if self._takes(mesh, vertices, triangles):
                        made[key] = mesh
                    continue
                vertices, triangles = vertices + layout[1].count, triangles + layout[0].count // 3
                if not self._fits(vertices, triangles):
                    break
                new[key] = layout
            if not new:
                return
        read = read_together(new)
        meshes = self._cache.add_meshes(read)
        if len(read) == len(waiting):
            self._counted.update(map(id, meshes.values()))
            self._add(vertices, triangles)
        else:
            for mesh in meshes.values():
                self._count(mesh, len(mesh.positions), len(mesh.elements))
        made.update(meshes)

    def _fits(self, vertices: int, elements: int) -> bool:
        limits, nbytes = self._limits, _VERTEX_BYTES * vertices + 12 * elements
        return (
            self._vertices + vertices <= limits.max_vertices
            and self._elements + elements <= limits.max_elements
            and self.nbytes + nbytes <= limits.max_mesh_bytes
        )

    def _takes(self, mesh: Mesh, others_vertices: int = 0, others_elements: int = 0) -> bool:
        """Counts a mesh once against the limits; False, and nothing done: it would be beyond, with others that are to
        be counted yet."""
        if id(mesh) in self._counted:
            return True
        vertices, elements = len(mesh.positions), len(mesh.elements)
        if not self._fits(others_vertices + vertices, others_elements + elements):
            return False
        self._count(mesh, vertices, elements)
        return True

    def _count(self, mesh: Mesh, vertices: int, elements: int) -> None:
        identity = id(mesh)
        if identity not in self._counted:
            self._counted.add(identity)
            self._add(vertices, elements)

    def _add(self, vertices: int, elements: int) -> None:
        self._vertices += vertices
        self._elements += elements
        self.nbytes += _VERTEX_BYTES * vertices + 12 * elements

    def _any(self, primitive: Primitive, name: str) -> Mesh | None:
        source = self._check(primitive, name)
        if source is None:
            return None
        key = _key(source.mode, source.indices, source.attributes)
        if key in self._made:
            return self._made[key]
        if key in self._repaired:
            return self._repaired[key]
        mesh = self._cache.meshes((key,)).get(key)
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
                mesh = self._cache.add_meshes([(key, mesh, buffers, mesh_bytes(mesh, buffers))])[key]
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
        self._add(vertices, elements)
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
            check_stop()
            low, high = int(indices.min()), int(indices.max())
            check_stop()
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
            check_stop()
            accessor = source.attributes.get(name)
            return None if accessor is None else repair(accessor.floats(first, stop))

        check_stop()
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
