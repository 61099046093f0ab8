"""Tables of a draw list for the kernels, independent of the camera, and the caches of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import WeakCache
from renderers.compiler.pointers import address_of
from renderers.drawlist import AlphaMode, DrawList, Instance, InstanceSet, Mesh, PosedInstances, Topology, used_vertices
from renderers.raster.convex_culling import cullable_mesh
from renderers.raster.layout import MAX_POINT_SIZE, RasterInstance
from renderers.stop import check_stop

MAX_PRIMITIVES: Final = 2**31 - 1
"""Primitive ids are int32."""
NOT_CONVEX: Final = (0.0, 0.0, 0.0, -1.0, -1.0, -1.0)
"""Bounding box of meshes that are not convex."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedMesh:
    """Addresses and counts of a mesh."""

    counts: tuple[int, int, int]
    """Number of vertices to transform, number of primitives, and vertices of each primitive."""
    addresses: tuple[int, int]
    """Addresses of the vertices to transform, and of the indices into them."""
    mesh_addresses: tuple[int, int, int]
    """Addresses of the mesh's own positions, indices and normals (0: none)."""
    box: tuple[float, float, float, float, float, float] = NOT_CONVEX
    """Centre and half extents."""
    keep: tuple[NDArray[Any], ...] = ()
    """Arrays that the addresses point to, apart from the mesh's own."""

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays that it keeps."""
        return sum(array.nbytes for array in self.keep) + 500


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Structure:
    """Tables that depend on meshes and materials only; shared by the draw lists of a scene in which poses change."""

    instances: NDArray[np.void]
    """(I + 1,) RasterInstance."""
    first_ids: NDArray[np.int64]
    """(I + 1,): first primitive id of every instance, and the number of primitives."""
    materials: tuple[Any, ...]
    """(I,) Material, from which the sizes were taken."""
    masked: NDArray[np.bool_]
    """(I,): True for instances of the alpha mode MASK."""
    blended: NDArray[np.bool_]
    """(I,): True for instances of the alpha mode BLEND."""
    keep: tuple[PreparedMesh, ...]


@dataclass(frozen=True, slots=True, eq=False)
class PreparedInstances:
    """Tables of I instances in any pose. They do not keep the meshes alive."""

    structure: Structure
    counts: tuple[int, int, int]
    """Numbers of instances, vertices and primitives."""
    tables: dict[str, int]
    """The fields of RasterFrame that are addresses of tables."""
    keep: tuple[NDArray[np.uint32], NDArray[np.int32]]
    """Labels and instance ids."""

    @property
    def first_ids(self) -> NDArray[np.int64]:
        """(I + 1,) int64 as in ``Visibility``."""
        return self.structure.first_ids


@dataclass(frozen=True, slots=True, eq=False)
class PreparedScene:
    """Tables of I instances and their poses."""

    instances: PreparedInstances
    X_world_mesh: NDArray[np.float64]
    """(I, 4, 4) float64."""
    X_world_mesh_at: int
    """Its address."""
    keep: Sequence[Instance]
    """The instances, whose meshes the addresses in the tables point to."""


_meshes: WeakCache[Mesh, PreparedMesh] = WeakCache("prepared_meshes")
_structures: WeakCache[tuple[Mesh, ...], Structure] = WeakCache("instances")
_sets: WeakCache[InstanceSet, PreparedInstances] = WeakCache("instances")
_scenes: WeakCache[DrawList, PreparedScene] = WeakCache("instances")


def _prepare_mesh(mesh: Mesh) -> PreparedMesh:
    """Check a mesh, since kernels read it without checks, and derive what setup needs.

    Raises:
        ValueError, TypeError: shapes, dtypes or indices are not as ``Mesh`` requires.
        Exception: the current ``StopFlag`` was set.
    """
    positions, elements, normals = mesh.positions, mesh.elements, mesh.normals
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise ValueError(f"mesh positions must be (N, 3), got {positions.shape}")
    if elements.ndim != 2 or elements.shape[1] not in (1, 2, 3):
        raise ValueError(f"mesh elements must be (M, 1 | 2 | 3), got {elements.shape}")
    if normals is not None and normals.shape != positions.shape:
        raise ValueError(f"mesh normals {normals.shape} must be as many as its positions {positions.shape}")
    count = len(positions)
    if len(elements) and int(elements.max()) >= count:
        raise ValueError(f"mesh element index {int(elements.max())} is out of range ({count} vertices)")
    topology = Topology(elements.shape[1])
    mesh_addresses = (
        address_of(positions, np.float32),
        address_of(elements, np.uint32),
        address_of(normals, np.float32),
    )
    drawn_positions, drawn_indices = positions, elements
    if count > max(64, elements.size):
        # Many glTF primitives share one long vertex array: transform only the vertices that this one uses.
        used, drawn_indices = used_vertices(elements, count)
        drawn_positions = np.ascontiguousarray(positions[used])
    box = NOT_CONVEX
    if topology == Topology.TRIANGLES:
        convex = cullable_mesh(drawn_positions, drawn_indices)
        if convex is not None:
            box, drawn_positions = convex
    drawn_addresses = address_of(drawn_positions, np.float32), address_of(drawn_indices, np.uint32)
    return PreparedMesh(
        (len(drawn_positions), len(elements), int(topology)),
        drawn_addresses,
        mesh_addresses,
        box,
        tuple([new for new in (drawn_positions, drawn_indices) if new is not positions and new is not elements]),
    )


def _prepared_mesh(mesh: Mesh) -> PreparedMesh:
    prepared = _meshes.get(mesh)
    if prepared is None:
        prepared = _prepare_mesh(mesh)
        _meshes.put(mesh, prepared, prepared.nbytes)
    return prepared


def prepare(scene: DrawList) -> PreparedScene:
    """Return the tables of a draw list.

    Raises:
        ValueError, TypeError: a mesh is not as ``Mesh`` requires, or there are more than MAX_PRIMITIVES primitives.
    """
    prepared = _scenes.get(scene)
    if prepared is not None:
        return prepared
    instances = scene.instances
    if isinstance(instances, PosedInstances):
        tables, X_world_mesh = _prepared_set(instances), instances.X_world_mesh
    else:
        tables = _prepare_instances(instances)
        X_world_mesh = np.array([i.X_world_mesh for i in instances], dtype=np.float64).reshape(len(instances), 4, 4)
    prepared = PreparedScene(tables, X_world_mesh, address_of(X_world_mesh, np.float64), instances)
    _scenes.put(scene, prepared, X_world_mesh.nbytes)
    return prepared


def _prepared_set(instances: PosedInstances) -> PreparedInstances:
    prepared = _sets.get(instances.set)
    if prepared is None:
        prepared = _prepare_instances(instances)
        _sets.put(instances.set, prepared, 8 * len(instances))
    return prepared


def _prepare_instances(instances: Sequence[Instance]) -> PreparedInstances:
    """Raises as ``prepare`` does."""
    structure = _structure_of(instances)
    labels = np.array([instance.label for instance in instances], dtype=np.uint32)
    instance_ids = np.array([instance.instance_id for instance in instances], dtype=np.int32)
    total = structure.instances[-1]
    return PreparedInstances(
        structure,
        (len(instances), int(total["first_vertex"]), int(total["first_id"])),
        tables={
            "instances": address_of(structure.instances, RasterInstance.dtype),
            "first_ids": address_of(structure.first_ids, np.int64),
            "labels": address_of(labels, np.uint32),
            "instance_ids": address_of(instance_ids, np.int32),
        },
        keep=(labels, instance_ids),
    )


def _structure_of(instances: Sequence[Instance]) -> Structure:
    """Return the tables for these meshes and materials, from the last draw list that had the same."""
    key = tuple([instance.mesh for instance in instances])
    structure = _structures.get(key) if key else None
    if structure is not None and all(
        old is instance.material or old == instance.material
        for old, instance in zip(structure.materials, instances, strict=True)
    ):
        return structure
    structure = _build_structure(instances)
    if key:
        _structures.put(key, structure, structure.instances.nbytes + structure.first_ids.nbytes)
    return structure


def _build_structure(instances: Sequence[Instance]) -> Structure:
    """Raises as ``prepare`` does."""
    count = len(instances)
    by_mesh: dict[int, PreparedMesh] = {}
    meshes: list[PreparedMesh] = []
    for instance in instances:
        check_stop()
        mesh = by_mesh.get(id(instance.mesh))
        if mesh is None:
            mesh = by_mesh[id(instance.mesh)] = _prepared_mesh(instance.mesh)
        meshes.append(mesh)
    table = np.zeros(count + 1, RasterInstance.dtype)
    numbers = np.array([(*m.counts, *m.addresses, *m.mesh_addresses) for m in meshes], np.int64).reshape(count, 8)
    np.cumsum(numbers[:, 0], out=table["first_vertex"][1:])
    np.cumsum(numbers[:, 1], out=table["first_id"][1:])
    columns = "vertices_per_primitive", "positions", "indices", "mesh_positions", "mesh_indices", "mesh_normals"
    for column, field in enumerate(columns):
        table[field][:-1] = numbers[:, 2 + column]
    first_ids = np.ascontiguousarray(table["first_id"])
    if first_ids[-1] > MAX_PRIMITIVES:
        raise ValueError(f"the scene has {first_ids[-1]} primitives, more than {MAX_PRIMITIVES} can be drawn")
    materials = tuple([instance.material for instance in instances])
    point_sizes, line_widths = [m.point_size for m in materials], [m.line_width for m in materials]
    sizes = np.where(numbers[:, 2] == Topology.LINES, line_widths, point_sizes)  # pixels
    table["point_or_line_size"][:-1] = np.where(np.isfinite(sizes), np.clip(sizes, 1.0, MAX_POINT_SIZE), 1.0)
    boxes = np.array([mesh.box for mesh in meshes], dtype=np.float64).reshape(count, 6)
    table["box_center"][:-1], table["box_half_extents"][:-1] = boxes[:, :3], boxes[:, 3:]
    modes = np.array([material.alpha_mode for material in materials], np.object_)
    return Structure(
        table,
        first_ids,
        materials,
        masked=np.asarray(modes == AlphaMode.MASK, np.bool_),
        blended=np.asarray(modes == AlphaMode.BLEND, np.bool_),
        keep=tuple(by_mesh.values()),
    )
