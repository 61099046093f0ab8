"""A draw list as tables of addresses and numbers; independent of the camera."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from renderers.alike import Alike
from renderers.compiler.pointers import address_of
from renderers.drawlist import Cast, DrawList, Instance, Mesh, Placed, Topology, used_vertices
from renderers.raster.cluster_culling import WORTH, bound_clusters, cluster_values
from renderers.raster.convex_culling import solid
from renderers.raster.layout import (
    A_COLUMNS,
    B_COLUMNS,
    MAX_POINT,
    T_CLUSTERS,
    T_COLUMNS,
    T_ELEMENT,
    T_ELEMENTS,
    T_POSITIONS,
    T_RECORD,
    T_TOPOLOGY,
    T_VERTEX,
)
from renderers.stop import check_stop, current_stop

MAX_RECORDS: Final = 2**31 - 1
"""Records are numbered in int32."""
MAX_STRUCTURE_BYTES: Final = 64 << 20
"""Tables of scenes whose meshes are alive: half a million instances."""
NOT_SOLID: Final = (0.0, 0.0, 0.0, -1.0, -1.0, -1.0)
"""In place of a solid mesh's box."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedMesh:
    """Addresses and counts of a mesh; ``keep`` holds what they point to that is not the mesh's own."""

    row: tuple[int, int, int, int, int, int]
    """Vertices, elements, topology, addresses of positions, elements and clusters: what is transformed and set up."""
    attributes: tuple[int, int, int, int]
    """As A_TOPOLOGY and on: the mesh's own arrays."""
    bounds: tuple[float, float, float, float, float, float] = NOT_SOLID
    """As B_MIDDLE and on."""
    keep: tuple[NDArray[Any], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """What does not depend on poses and names."""

    table: NDArray[np.int64]
    """(I + 1, T_COLUMNS) int64: the table of a frame in which all instances are drawn from both sides."""
    attributes: NDArray[np.int64]
    """(I, A_COLUMNS) int64."""
    first_record: NDArray[np.int64]
    """(I + 1,) int64."""
    sizes: NDArray[np.float64]
    """(I,) float64: point size or line width, pixels."""
    bounds: NDArray[np.float64]
    """(I, B_COLUMNS) float64."""
    keep: tuple[PreparedMesh, ...]
    """What the addresses point into, apart from the meshes themselves."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedCast:
    """I instances, wherever they are. It keeps no mesh."""

    structure: Structure
    labels: NDArray[np.uint32]
    """(I,) uint32."""
    instance_ids: NDArray[np.int32]
    """(I,) int32."""
    first_record_at: int
    """Address of ``Structure.first_record``."""
    counts: tuple[int, int, int]
    """Instances, vertices, elements."""
    asked: tuple[int, ...]
    """A_COUNT to A_MESHES, see ``begin``: the number of instances; addresses of ``Structure``'s ``table``, ``sizes``,
    ``bounds`` and ``first_record``, of ``labels`` and ``instance_ids``, and of ``Structure.attributes``."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedScene:
    """I instances at their places."""

    cast: PreparedCast
    X_world_mesh: NDArray[np.float64]
    """(I, 4, 4) float64."""
    points: int
    """Its address."""
    keep: Sequence[Instance]
    """What the addresses in the tables point into: the meshes."""


_meshes: WeakKeyDictionary[Mesh, PreparedMesh] = WeakKeyDictionary()
_structures: Alike[Structure] = Alike(MAX_STRUCTURE_BYTES)
_casts: WeakKeyDictionary[Cast, PreparedCast] = WeakKeyDictionary()
_scenes: WeakKeyDictionary[DrawList, PreparedScene] = WeakKeyDictionary()
_lock = threading.Lock()


def _prepare_mesh(mesh: Mesh) -> PreparedMesh:
    """Check a mesh, since kernels read it without any check, and take its addresses.

    Raises:
        ValueError, TypeError: shapes, dtypes or indices break the promises of ``Mesh``.
        Exception: the current ``StopFlag`` was set.
    """
    check_stop()
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
    attributes = (
        int(topology),
        address_of(positions, np.float32),
        address_of(elements, np.uint32),
        address_of(normals, np.float32),
    )
    own_positions, own_elements = positions, elements
    if count > max(64, elements.size):
        # Many glTF primitives share one long vertex array: transform only what this one uses.
        used, own_elements = used_vertices(elements, count)
        own_positions = np.ascontiguousarray(positions[used])
    bounds = NOT_SOLID
    if topology == Topology.TRIANGLES:
        known = solid(own_positions, own_elements)
        if known is not None:
            bounds, own_positions = known
    places = address_of(own_positions, np.float32), address_of(own_elements, np.uint32)
    clusters = None
    if topology == Topology.TRIANGLES and len(elements) >= WORTH:
        clusters = np.zeros(cluster_values(len(elements)), np.float32)
        stop = current_stop()
        bound_clusters(*places, len(elements), address_of(clusters, np.float32), stop.address)
        stop.check()
    row = len(own_positions), len(elements), int(topology), *places, address_of(clusters, np.float32)
    keep = tuple(each for each in (own_positions, own_elements, clusters) if each is not None)
    return PreparedMesh(row, attributes, bounds, keep)


def _prepared_mesh(mesh: Mesh) -> PreparedMesh:
    with _lock:
        known = _meshes.get(mesh)
    if known is None:
        fresh = _prepare_mesh(mesh)
        with _lock:
            known = _meshes.setdefault(mesh, fresh)
    return known


def prepare(scene: DrawList) -> PreparedScene:
    """The tables of a draw list, made once while it is alive.

    Raises:
        ValueError, TypeError: a mesh breaks its promises, or there are more than MAX_RECORDS elements.
    """
    with _lock:
        known = _scenes.get(scene)
    if known is not None:
        return known
    instances = scene.instances
    if isinstance(instances, Placed):
        cast, X_world_mesh = _known_cast(instances), instances.X_world_mesh
    else:
        cast = _prepared_cast(instances)
        X_world_mesh = np.array([i.X_world_mesh for i in instances], dtype=np.float64).reshape(len(instances), 4, 4)
    prepared = PreparedScene(cast, X_world_mesh, address_of(X_world_mesh, np.float64), instances)
    with _lock:
        return _scenes.setdefault(scene, prepared)


def _known_cast(instances: Placed) -> PreparedCast:
    """Made once while the cast is alive."""
    with _lock:
        known = _casts.get(instances.cast)
    if known is None:
        fresh = _prepared_cast(instances)
        with _lock:
            known = _casts.setdefault(instances.cast, fresh)
    return known


def _prepared_cast(instances: Sequence[Instance]) -> PreparedCast:
    """Raises as ``prepare`` does."""
    structure = _structures.get(instances)
    if structure is None:
        structure = _structure(instances)
        _structures.put(instances, structure, structure.table.nbytes + structure.attributes.nbytes)
    check_stop()
    labels = np.array([instance.label for instance in instances], dtype=np.uint32)
    check_stop()
    instance_ids = np.array([instance.instance_id for instance in instances], dtype=np.int32)
    first_record_at = address_of(structure.first_record, np.int64)
    return PreparedCast(
        structure,
        labels,
        instance_ids,
        first_record_at,
        counts=(len(instances), *structure.table[-1, [T_VERTEX, T_ELEMENT]].tolist()),
        asked=(
            len(instances),
            address_of(structure.table, np.int64),
            address_of(structure.sizes, np.float64),
            address_of(structure.bounds, np.float64),
            first_record_at,
            address_of(labels, np.uint32),
            address_of(instance_ids, np.int32),
            address_of(structure.attributes, np.int64),
        ),
    )


def _structure(instances: Sequence[Instance]) -> Structure:
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
    rows = np.array([mesh.row for mesh in meshes], dtype=np.int64).reshape(count, 6)
    table = np.zeros((count + 1, T_COLUMNS), dtype=np.int64)
    np.cumsum(rows[:, 0], out=table[1:, T_VERTEX])
    np.cumsum(rows[:, 1], out=table[1:, T_ELEMENT])
    table[:-1, T_TOPOLOGY] = rows[:, 2]
    table[:-1, T_POSITIONS] = rows[:, 3]
    table[:-1, T_ELEMENTS] = rows[:, 4]
    table[:-1, T_CLUSTERS] = rows[:, 5]
    first_record = np.ascontiguousarray(table[:, T_ELEMENT])
    check_stop()
    if first_record[-1] > MAX_RECORDS:
        raise ValueError(f"the scene has {first_record[-1]} elements, more than {MAX_RECORDS} can be drawn")
    table[:, T_RECORD] = first_record
    sizes = [(i.material.line_width if i.mesh.elements.shape[1] == 2 else i.material.point_size) for i in instances]
    return Structure(
        table=table,
        attributes=np.array([mesh.attributes for mesh in meshes], dtype=np.int64).reshape(count, A_COLUMNS),
        first_record=first_record,
        sizes=np.array([min(max(s, 1.0), MAX_POINT) if math.isfinite(s) else 1.0 for s in sizes], dtype=np.float64),
        bounds=np.array([mesh.bounds for mesh in meshes], dtype=np.float64).reshape(count, B_COLUMNS),
        keep=tuple(by_mesh.values()),
    )
