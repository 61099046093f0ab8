"""A draw list as tables that kernels read."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from renderers.drawlist import AlphaMode, Instance, Material, Mesh, Topology
from renderers.port import LookName
from renderers.shading.materials import MaterialRows, as_tables, material_rows
from renderers.shading.memory import address_of
from renderers.shading.tangents import vertex_tangents
from renderers.shading.textures import Texels, TextureTable, texels_of

# Columns of the instance table.
II_TOPOLOGY: Final = 0
II_MATERIAL: Final = 1
II_ELEMENTS: Final = 2
II_POSITIONS: Final = 3
II_NORMALS: Final = 4
II_UV0: Final = 5
II_UV1: Final = 6
II_COLORS: Final = 7
II_TANGENTS: Final = 8
II_COLUMNS: Final = 9
"""From ``II_ELEMENTS`` on: addresses, 0 where the mesh has no such array."""


@dataclass(frozen=True, slots=True, eq=False)
class ShadingScene:
    """What the kernels read of a draw list under one look; independent of the camera, shared between threads."""

    look: LookName
    instances: NDArray[np.int64]
    """(n, II_COLUMNS)."""
    material_integers: NDArray[np.int64]
    """(m, MI_COLUMNS)."""
    material_floats: NDArray[np.float32]
    """(m, MF_COLUMNS)."""
    texture_integers: NDArray[np.int64]
    """(t, TI_COLUMNS)."""
    texture_floats: NDArray[np.float32]
    """(t, TF_COLUMNS)."""
    cull_back: NDArray[np.bool_]
    """(n,): whose back faces colour does not show."""
    layered: NDArray[np.bool_]
    """(n,): who may let something behind it be seen: blended or cut out, and not opaque everywhere."""
    keep: tuple[Any, ...]
    """What the addresses in the tables point into."""

    @property
    def nbytes(self) -> int:
        """Bytes of what the addresses point into, textures above all."""
        arrays = (each.rgba if isinstance(each, Texels) else each for each in self.keep)
        return sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))

    @property
    def translucent(self) -> bool:
        """Whether a picture may need more than one layer."""
        return bool(self.layered.any())


_tangents: WeakKeyDictionary[Mesh, dict[int, NDArray[np.float32]]] = WeakKeyDictionary()
"""By mesh, then by the set of coordinates they follow."""
_addresses: WeakKeyDictionary[Mesh, tuple[int, ...]] = WeakKeyDictionary()
_lock = threading.Lock()


def _tangents_of(mesh: Mesh, uv_set: int) -> NDArray[np.float32] | None:
    """The mesh's own tangents, else computed ones (once per mesh), else None: the mesh has no coordinates."""
    if mesh.tangents is not None:
        return mesh.tangents
    uv = mesh.uv1 if uv_set == 1 else mesh.uv0
    if uv is None or mesh.elements.shape[1] != 3:
        return None
    with _lock:
        known = _tangents.get(mesh, {}).get(uv_set)
    if known is not None:
        return known
    fresh = vertex_tangents(mesh.positions, uv, mesh.elements)
    with _lock:
        return _tangents.setdefault(mesh, {}).setdefault(uv_set, fresh)


def _addresses_of(mesh: Mesh) -> tuple[int, ...]:
    """The columns from ``II_ELEMENTS`` on, without tangents; valid while the mesh is alive.

    Raises:
        ValueError: an attribute has another shape than ``Mesh`` says: kernels would read beyond it.
    """
    with _lock:
        known = _addresses.get(mesh)
    if known is not None:
        return known
    vertices = len(mesh.positions)
    for name, array, width in (
        ("positions", mesh.positions, 3),
        ("normals", mesh.normals, 3),
        ("uv0", mesh.uv0, 2),
        ("uv1", mesh.uv1, 2),
        ("colors", mesh.colors, 4),
        ("tangents", mesh.tangents, 4),
    ):
        if array is not None and array.shape != (vertices, width):
            raise ValueError(f"mesh with {vertices} vertices: {name} has shape {array.shape}, not {(vertices, width)}")
    fresh = (
        address_of(mesh.elements, np.uint32),
        address_of(mesh.positions, np.float32),
        address_of(mesh.normals, np.float32),
        address_of(mesh.uv0, np.float32),
        address_of(mesh.uv1, np.float32),
        address_of(mesh.colors, np.float32),
        0,
    )
    with _lock:
        _addresses[mesh] = fresh
    return fresh


def _lets_through(instance: Instance) -> bool:
    """Whether something behind may be seen through the instance; knows textures without transparent texels."""
    material = instance.material
    if material.alpha_mode is AlphaMode.OPAQUE:
        return False
    texture = material.base_color_texture
    opaque = instance.mesh.colors is None and (texture is None or texels_of(texture.image).opaque)
    least = material.alpha_cutoff if material.alpha_mode is AlphaMode.MASK else 1.0
    return not (opaque and material.base_color[3] >= least)


def prepare(instances: Sequence[Instance], look: LookName) -> ShadingScene:
    """Tables of a draw list's instances, in their order; decodes the images that the look needs.

    Raises:
        ImageError: an image cannot be decoded.
        ValueError, TypeError: a mesh's arrays are not what ``Mesh`` says.
    """
    textures = TextureTable()
    known: dict[tuple[int, bool], int] = {}
    materials: list[Material] = []
    rows: list[MaterialRows] = []
    geometry: dict[tuple[int, int], tuple[int, ...]] = {}
    keep: list[Any] = []
    table = np.zeros((max(len(instances), 1), II_COLUMNS), dtype=np.int64)
    for i, instance in enumerate(instances):
        mesh, material = instance.mesh, instance.material
        topology = mesh.elements.shape[1]
        lit = topology == Topology.TRIANGLES
        material_row = known.get((id(material), lit))
        if material_row is None:
            material_row = known[id(material), lit] = len(rows)
            rows.append(material_rows(material, look, lit, textures))
            materials.append(material)
        # The set of coordinates that tangents must follow, -1 where there is no normal map.
        texture = material.normal_texture
        tangent_set = texture.uv_set if texture is not None and rows[material_row].needs_tangents else -1
        columns = geometry.get((id(mesh), tangent_set))
        if columns is None:
            keep.append(mesh)
            columns = _addresses_of(mesh)
            if tangent_set >= 0:
                tangents = _tangents_of(mesh, tangent_set)
                keep.append(tangents)
                columns = (*columns[:-1], address_of(tangents, np.float32))
            geometry[id(mesh), tangent_set] = columns
        table[i] = (topology, material_row, *columns)
    integers, floats = as_tables(rows)
    texture_integers, texture_floats = textures.as_tables()
    return ShadingScene(
        look=look,
        instances=table,
        material_integers=integers,
        material_floats=floats,
        texture_integers=texture_integers,
        texture_floats=texture_floats,
        cull_back=np.array([not instance.material.double_sided for instance in instances], dtype=np.bool_),
        layered=np.array([_lets_through(instance) for instance in instances], dtype=np.bool_),
        keep=(*keep, *materials, *textures.keep),
    )


def normal_matrices(X_camera_mesh: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3, 3) float64: maps of normals, the inverse transpose up to a positive factor; defined for flat scales, too.

    Args:
        X_camera_mesh: (n, 4, 4) float64.
    """
    a = X_camera_mesh[:, :3, :3]
    with np.errstate(all="ignore"):  # instances that are not finite draw nothing
        cofactors = np.stack(
            (np.cross(a[:, 1], a[:, 2]), np.cross(a[:, 2], a[:, 0]), np.cross(a[:, 0], a[:, 1])),
            axis=1,
        )
        # cofactor(A) = det(A) A^-T: undo the determinant's sign (mirrored instances) and its size.
        size = np.abs(cofactors).max(axis=(1, 2), keepdims=True)
        sign = np.where(np.linalg.det(a) < 0.0, -1.0, 1.0)[:, None, None]
        result: NDArray[np.float64] = np.ascontiguousarray(cofactors * sign / np.where(size > 0.0, size, 1.0))
    return result
