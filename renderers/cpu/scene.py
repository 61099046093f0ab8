"""A draw list as tables of addresses and numbers; independent of the camera."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from renderers.cpu.layout import A_COLUMNS, MAX_POINT
from renderers.drawlist import DrawList, Mesh, Topology
from renderers.pointers import address_of

MAX_RECORDS: Final = 2**31 - 1
"""Records are numbered in int32."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedMesh:
    """Addresses and counts of a mesh; ``keep`` holds what they point to that is not the mesh's own."""

    row: tuple[int, int, int, int, int]
    """Vertices, elements, topology, address of positions, address of elements: what is transformed and set up."""
    attributes: tuple[int, int, int, int]
    """As A_TOPOLOGY and on: the mesh's own arrays."""
    keep: tuple[NDArray[Any], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class PreparedScene:
    """I instances."""

    rows: NDArray[np.int64]
    """(I, 5) int64, ``PreparedMesh.row``."""
    attributes: NDArray[np.int64]
    """(I, A_COLUMNS) int64."""
    first_record: NDArray[np.int64]
    """(I + 1,) int64."""
    labels: NDArray[np.uint32]
    """(I,) uint32."""
    instance_ids: NDArray[np.int32]
    """(I,) int32."""
    sizes: NDArray[np.float64]
    """(I,) float64: point size or line width, pixels."""
    X_world_mesh: NDArray[np.float64]
    """(I, 4, 4) float64."""
    keep: tuple[Any, ...]
    """What the addresses point into."""


_meshes: WeakKeyDictionary[Mesh, PreparedMesh] = WeakKeyDictionary()
_scenes: WeakKeyDictionary[DrawList, PreparedScene] = WeakKeyDictionary()
_lock = threading.Lock()


def _prepare_mesh(mesh: Mesh) -> PreparedMesh:
    """Check a mesh, since kernels read it without any check, and take its addresses.

    Raises:
        ValueError, TypeError: shapes, dtypes or indices break the promises of ``Mesh``.
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
    attributes = (
        int(topology),
        address_of(positions, np.float32),
        address_of(elements, np.uint32),
        address_of(normals, np.float32),
    )
    if count <= max(64, elements.size):
        row = (count, len(elements), int(topology), attributes[1], attributes[2])
        return PreparedMesh(row, attributes)
    # Many glTF primitives share one long vertex array: transform only what this one uses.
    used, compact = np.unique(elements, return_inverse=True)
    own_positions = np.ascontiguousarray(positions[used])
    own_elements = np.ascontiguousarray(compact.reshape(elements.shape), dtype=np.uint32)
    row = (
        len(used),
        len(elements),
        int(topology),
        address_of(own_positions, np.float32),
        address_of(own_elements, np.uint32),
    )
    return PreparedMesh(row, attributes, (own_positions, own_elements))


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
    count = len(instances)
    by_mesh: dict[int, PreparedMesh] = {}
    meshes: list[PreparedMesh] = []
    for instance in instances:
        mesh = by_mesh.get(id(instance.mesh))
        if mesh is None:
            mesh = by_mesh[id(instance.mesh)] = _prepared_mesh(instance.mesh)
        meshes.append(mesh)
    rows = np.array([mesh.row for mesh in meshes], dtype=np.int64).reshape(count, 5)
    first_record = np.zeros(count + 1, dtype=np.int64)
    np.cumsum(rows[:, 1], out=first_record[1:])
    if first_record[-1] > MAX_RECORDS:
        raise ValueError(f"the scene has {first_record[-1]} elements, more than {MAX_RECORDS} can be drawn")
    sizes = [(i.material.line_width if i.mesh.elements.shape[1] == 2 else i.material.point_size) for i in instances]
    prepared = PreparedScene(
        rows=rows,
        attributes=np.array([mesh.attributes for mesh in meshes], dtype=np.int64).reshape(count, A_COLUMNS),
        first_record=first_record,
        labels=np.array([instance.label for instance in instances], dtype=np.uint32),
        instance_ids=np.array([instance.instance_id for instance in instances], dtype=np.int32),
        sizes=np.array([min(max(s, 1.0), MAX_POINT) if math.isfinite(s) else 1.0 for s in sizes], dtype=np.float64),
        X_world_mesh=np.array([i.X_world_mesh for i in instances], dtype=np.float64).reshape(count, 4, 4),
        keep=(instances, tuple(by_mesh.values())),
    )
    with _lock:
        return _scenes.setdefault(scene, prepared)
