"""Reads primitives as ``Mesh`` objects; primitives of equal content and pose share one object."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.files.gltf.accessors import Accessor, Accessors
from gateway.files.gltf.deformation import REST, SKIN_ATTRIBUTES, Deformation, MeshPose, deformation_of
from gateway.files.gltf.document_cache import ContentKey, MeshKey
from gateway.files.gltf.draco import EXTENSION as DRACO
from gateway.files.gltf.draco import DracoMeshes
from gateway.files.gltf.gltf_errors import GltfError, GltfLimitError, GltfLimits, as_warning
from gateway.files.gltf.parser import extension
from gateway.files.gltf.schema import DracoCompression, GltfPrimitive
from gateway.files.gltf.topology import MODE_COUNT, TRIANGLES, element_count, restart_index, separate_elements
from gateway.files.gltf.vertex_attributes import (
    Floats,
    rgba_colors,
    unit_normals,
    unit_tangents,
    without_invalid_vertices,
)
from gateway.scene.draw.crease_normals import NO_CREASES, smooth_vertices
from renderers.cache import Cache
from renderers.drawlist import Image, Mesh
from renderers.stop import check_stop

_COMPONENT_COUNTS: Final = {
    "POSITION": (3,),
    "NORMAL": (3,),
    "TANGENT": (4,),
    "TEXCOORD_0": (2,),
    "TEXCOORD_1": (2,),
    "COLOR_0": (3, 4),
}
"""Attributes that are read, with their allowed numbers of components."""
_CONVERSIONS: Final[dict[str, tuple[str, Callable[[Floats], Floats] | None]]] = {
    "TEXCOORD_0": ("uv0", None),
    "TEXCOORD_1": ("uv1", None),
    "COLOR_0": ("colors", rgba_colors),
    "TANGENT": ("tangents", unit_tangents),
}
"""Field of ``Mesh`` and function that converts finite numbers to the form of that field, by attribute."""
_VERTEX_BYTES: Final = 4 * (3 + 3 + 4 + 2 + 2 + 4)
"""Bytes of a vertex with all attributes."""
_ELEMENT_BYTES: Final = 12
"""Bytes of the indices of a triangle."""


class _CheckedPrimitive(msgspec.Struct, frozen=True, gc=False, eq=False):
    """A primitive whose accessors exist and have allowed types."""

    name: str
    """For messages, such as ``meshes[2].primitives[0]``."""
    mode: int
    """``primitive.mode``, 0 .. 6."""
    indices: Accessor | None
    attributes: dict[str, Accessor]
    """Accessors by attribute name: POSITION, and those other attributes of ``_COMPONENT_COUNTS`` that can be used. In a
    pose with joints also JOINTS_n and WEIGHTS_n."""
    deformation: Deformation | None
    """None: the mesh is drawn as it is stored."""
    other_colors: Accessor | None
    """COLOR_1, which is not read."""
    smooth: bool
    """True: triangles without stored normals get smooth ones; False: they are flat."""

    @property
    def key(self) -> MeshKey:
        accessors = (self.indices, *map(self.attributes.get, _COMPONENT_COUNTS))
        key = bytes((self.mode, self.smooth)) + b"".join([b"\0" if a is None else a.key for a in accessors])
        return key if self.deformation is None else key + self.deformation.key


@dataclass(eq=False)
class Meshes:
    """Reads the primitives of one document."""

    _accessors: Accessors
    _draco_meshes: DracoMeshes
    _content: Cache[ContentKey, Mesh | Image]
    _limits: GltfLimits
    _warnings: list[str]
    _meshes: dict[MeshKey, Mesh | None] = field(default_factory=dict)
    _vertex_count: int = 0
    _element_count: int = 0
    _max_nbytes: int = 0
    """Upper limit of ``nbytes`` that is known before the meshes are read: all vertices have all attributes."""
    nbytes: int = 0
    """Bytes of all meshes, each counted once."""

    def read(self, primitive: GltfPrimitive, name: str, pose: MeshPose = REST, *, smooth: bool = False) -> Mesh | None:
        """Return the mesh of a primitive in a pose; None if it draws nothing.

        ``smooth``: compute smooth normals for triangles without stored ones, which are flat else. Raises GltfError.
        """
        check_stop()
        checked = self._check(primitive, name, pose, smooth)
        key = checked.key
        if key not in self._meshes:
            self._meshes[key] = self._cached_or_new(key, checked)
        return self._meshes[key]

    def _cached_or_new(self, key: MeshKey, checked: _CheckedPrimitive) -> Mesh | None:
        cached = self._content.get(key)
        if isinstance(cached, Mesh):
            self._count(len(cached.positions), len(cached.elements), checked.name)
            self.nbytes += cached.nbytes
            return cached
        warning_count = len(self._warnings)
        mesh = self._read_new(checked)
        if mesh is None:
            return None
        nbytes = mesh.nbytes
        self.nbytes += nbytes
        if len(self._warnings) == warning_count:  # otherwise the next document would not get the warning
            self._content.put(key, mesh, nbytes)
        return mesh

    def _check(self, primitive: GltfPrimitive, name: str, pose: MeshPose, smooth: bool) -> _CheckedPrimitive:
        """Check a primitive's references to accessors."""
        mode = TRIANGLES if primitive.mode is None else primitive.mode
        if not 0 <= mode < MODE_COUNT:
            raise GltfError(f"{name}.mode: {mode} is not between 0 and {MODE_COUNT - 1}")
        references = primitive.attributes or {}
        position_index = references.get("POSITION")
        if position_index is None:
            raise GltfError(f"{name}.attributes: there is no POSITION")
        position = self._accessors.get(position_index, f"{name}.attributes.POSITION")
        if position.components != 3:
            raise GltfError(f"{name}.attributes.POSITION: {position.name} has {position.components} components, not 3")
        attributes = {"POSITION": position}
        for attribute, index in references.items():
            allowed = _COMPONENT_COUNTS.get(attribute, ())
            if pose.joint_matrices is not None and attribute.startswith(SKIN_ATTRIBUTES):
                allowed = (4,)
            if index is None or not allowed or attribute == "POSITION":
                continue
            path = f"{name}.attributes.{attribute}"
            with as_warning(self._warnings, f"{path} is ignored"):
                accessor = self._accessors.get(index, path)
                if accessor.components not in allowed:
                    raise GltfError(f"{path}: {accessor.name} has {accessor.components} components")
                attributes[attribute] = accessor
        indices = None
        if primitive.indices is not None:
            indices = self._accessors.get(primitive.indices, f"{name}.indices")
            if indices.components != 1 or indices.dtype.kind == "f":
                raise GltfError(f"{name}.indices: {indices.name} is not an accessor of integers")
        if primitive.extensions and DRACO in primitive.extensions:
            attributes, indices, mode = self._decompressed(primitive, attributes, indices, mode, name)
        count = attributes["POSITION"].count
        for attribute, accessor in tuple(attributes.items()):
            # VTK writes a COLOR_0 with one value for each triangle.
            if accessor.count < count or (attribute == "COLOR_0" and accessor.count != count):
                del attributes[attribute]
                path, counts = f"{name}.attributes.{attribute}", f"{accessor.count} values for {count} vertices"
                self._warnings.append(f"{path}: {accessor.name} has {counts}; {path} is ignored")
        deformation = deformation_of(primitive, pose, attributes, self._accessors, name, self._warnings)
        if deformation is not None and deformation.joint_matrices is not None and not deformation.influences:
            self._warnings.append(f"{name}: no JOINTS_0 and WEIGHTS_0 to use, it follows the first joint of its skin")
        other_colors = None
        if (index := references.get("COLOR_1")) is not None:
            with as_warning(self._warnings, f"{name}.attributes.COLOR_1 is ignored"):
                other_colors = self._accessors.get(index, f"{name}.attributes.COLOR_1")
        return _CheckedPrimitive(name, mode, indices, attributes, deformation, other_colors, smooth)

    def _decompressed(
        self, primitive: GltfPrimitive, attributes: dict[str, Accessor], indices: Accessor | None, mode: int, name: str
    ) -> tuple[dict[str, Accessor], Accessor | None, int]:
        """Return the attributes, indices and mode of a primitive with Draco data.

        If the exporter has also stored an uncompressed copy, that copy is read: all of it, or what it has of a
        primitive whose data cannot be decompressed.
        """
        stored = {attribute: accessor for attribute, accessor in attributes.items() if accessor.is_stored}
        has_copy = "POSITION" in stored and (indices is None or indices.is_stored)
        if has_copy and len(stored) == len(attributes):
            return attributes, indices, mode
        draco = extension(primitive.extensions, DRACO, DracoCompression, name, self._warnings)
        if draco is None:
            return attributes, indices, mode
        try:
            return *self._draco_meshes.read(draco, attributes, indices, f"{name}.extensions.{DRACO}"), TRIANGLES
        except GltfError as error:
            if not has_copy or isinstance(error, GltfLimitError):
                raise
            missing = ", ".join(sorted(attributes.keys() - stored.keys()))
            self._warnings.append(f"{error}; the uncompressed copy is drawn, which has no {missing}")
            return stored, indices, mode

    def _count(self, new_vertices: int, new_elements: int, name: str) -> None:
        """Count vertices and elements towards the limits before they are allocated. Raises GltfLimitError."""
        limits = self._limits
        self._vertex_count += new_vertices
        self._element_count += new_elements
        self._max_nbytes += _VERTEX_BYTES * new_vertices + _ELEMENT_BYTES * new_elements
        if self._vertex_count > limits.max_vertices:
            raise GltfLimitError(f"{name}: the meshes have more vertices than max_vertices = {limits.max_vertices}")
        if self._element_count > limits.max_elements:
            raise GltfLimitError(f"{name}: the meshes have more elements than max_elements = {limits.max_elements}")
        if self._max_nbytes > limits.max_mesh_bytes:
            raise GltfLimitError(f"{name}: the meshes need more bytes than max_mesh_bytes = {limits.max_mesh_bytes}")

    def _read_new(self, checked: _CheckedPrimitive) -> Mesh | None:
        """Read a mesh from its accessors; return None if it has no complete element with finite positions."""
        begin, end = 0, checked.attributes["POSITION"].count
        count = element_count(checked.mode, end if checked.indices is None else checked.indices.count)
        if count == 0:
            return None
        if checked.indices is None:
            self._count(end, count, checked.name)
            elements = separate_elements(checked.mode, np.arange(end, dtype=np.uint32))
        else:
            self._count(0, count, checked.name)  # before the time for _index_range is spent
            indices = checked.indices.values()[:, 0]
            restart = restart_index(checked.mode, indices)
            used = indices if restart is None else indices[indices != restart]
            if not len(used):
                return None
            min_index, max_index = _index_range(checked, checked.indices, used)
            if 2 * (max_index + 1 - min_index) <= end:
                # Some exporters share one big vertex buffer among primitives: keep only the range in use.
                begin, end = min_index, max_index + 1
            self._count(end - begin, 0, checked.name)
            elements = separate_elements(checked.mode, indices, restart)
            if not len(elements):
                return None
            if begin:
                elements -= np.uint32(begin)
        return self._with_attributes(checked, elements, begin, end)

    def _with_attributes(
        self, checked: _CheckedPrimitive, elements: NDArray[np.uint32], begin: int, end: int
    ) -> Mesh | None:
        """Read the attributes of the vertices from ``begin`` to before ``end``. The mesh's arrays are read-only.

        ``elements``: (M, 1 | 2 | 3) vertex indices minus ``begin``.
        """
        attributes = {
            name: accessor.floats(begin, end)
            for name, accessor in checked.attributes.items()
            if name in _COMPONENT_COUNTS
        }
        if checked.deformation is not None:
            checked.deformation.apply(attributes, begin, checked.name, self._warnings)
        positions = attributes["POSITION"]
        if not np.isfinite(positions).all():
            positions, elements, dropped = without_invalid_vertices(positions, elements)
            self._warnings.append(f"{checked.name}: {dropped} elements with vertices that are not finite are left out")
            if len(elements) == 0:
                return None
        optional: dict[str, Floats] = {}
        stored = attributes.get("NORMAL")
        normals: Floats | None
        if stored is None and checked.smooth and elements.shape[1] == 3:
            vertices, elements, normals = smooth_vertices(positions, elements, NO_CREASES)
            positions = positions[vertices]
            attributes = {name: values[vertices] for name, values in attributes.items()}
        else:
            normals = None if stored is None else unit_normals(stored, positions, elements)
        if normals is None:  # triangles are flat, and their tangents are ignored (glTF 2.0, 3.7.2.1)
            attributes.pop("TANGENT", None)
        else:
            normals.setflags(write=False)
            optional["normals"] = normals
        positions.setflags(write=False)
        elements.setflags(write=False)
        for attribute, (name, convert) in _CONVERSIONS.items():
            if attribute in attributes:
                values = attributes[attribute]
                if not np.isfinite(values).all():
                    self._warnings.append(f"{checked.name}.{attribute}: numbers that are not finite are read as 0")
                    values = np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)
                values = optional[name] = convert(values) if convert else values
                values.setflags(write=False)
        other_colors = checked.other_colors
        if other_colors is not None and not (np.nan_to_num(other_colors.floats())[:, :3] >= 1.0).all():
            colors = optional.get("colors")
            if colors is None:
                self._warnings.append(f"{checked.name}: COLOR_1 has colours, which are not drawn without a COLOR_0")
            elif (colors == 1.0).all():
                self._warnings.append(f"{checked.name}: COLOR_0 is drawn, which is white; COLOR_1 has the colours")
        return Mesh(positions, elements, **optional)


def _index_range(checked: _CheckedPrimitive, accessor: Accessor, indices: NDArray[Any]) -> tuple[int, int]:
    """Return the smallest and the largest of the indices, (N,), N > 0. Raises GltfError if one is too large."""
    min_index, max_index = int(np.minimum.reduce(indices)), int(np.maximum.reduce(indices))
    position = checked.attributes["POSITION"]
    if min_index < 0 or max_index >= position.count:
        raise GltfError(
            f"{checked.name}.indices: {accessor.name} has the index {min_index if min_index < 0 else max_index}, "
            f"but {position.name} has {position.count} vertices"
        )
    return min_index, max_index
