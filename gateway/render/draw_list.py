"""The draw list of a posted scene, made from its nodes directly.

In the requests of a moving robot only the poses differ. Everything else is the same ``SceneTopology`` object, by whose
identity the renderer keeps its own tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gateway.gltf import DEFAULT_MATERIAL, DRAKE_MERGER, DocumentContent, GltfScene, label_from_material
from gateway.scene.flatten import DRAWABLE, images_of
from gateway.scene.geometry import Surface
from renderers.cache import Cache
from renderers.drawlist import LABEL_NONE, DrawList, Image, InstanceSet, PosedInstances
from renderers.stop import check_stop

_INSTANCE_BYTES: Final = 1024
"""Approximate size of an instance's entries, the renderer's tables included."""

TopologyKey: TypeAlias = tuple[DocumentContent, tuple[int | None, ...], tuple[int, ...], bytes]
"""Content (by identity), mesh and parent of each node, and one bit per node: set if it is near enough to draw."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneTopology:
    """The part of a posted scene that does not change with its poses."""

    instances: InstanceSet
    nodes: NDArray[np.intp]
    """(I,): node of each instance."""
    images: tuple[Image, ...]

    @property
    def nbytes(self) -> int:
        """Approximate size, without meshes and images."""
        return _INSTANCE_BYTES * len(self.nodes)


def draw_list_of(scene: GltfScene, topologies: Cache[TopologyKey, SceneTopology]) -> DrawList:
    """Return the draw list of a posted scene, with labels from the colours of its materials.

    The same as ``flatten(scene.root, label_of=labels_of(scene.root))`` in a fraction of the time, and in
    ``_drawing_order``.
    """
    nodes = scene.nodes
    with np.errstate(all="ignore"):
        drawable = np.asarray((np.abs(nodes.X_world_node) < DRAWABLE).all(axis=(1, 2)))
    key = scene.content, tuple(nodes.meshes), tuple(nodes.parents), np.packbits(drawable).tobytes()
    topology = topologies.get(key)
    if topology is None:
        topology = _topology_of(scene, drawable)
        topologies.put(key, topology, topology.nbytes + scene.content.mesh_bytes)
    posed = PosedInstances(topology.instances, nodes.X_world_node[topology.nodes])
    return DrawList(posed, topology.images, scene.lights)


def _topology_of(scene: GltfScene, drawable: NDArray[np.bool_]) -> SceneTopology:
    meshes, materials, labels, nodes = [], [], [], []
    root_of_node: list[int] = []
    for node, parent in enumerate(scene.nodes.parents):
        root_of_node.append(node if parent < 0 else root_of_node[parent])
    label_of_root = _labels_of_roots(scene, root_of_node)
    for node in _drawing_order(scene):
        check_stop()
        if not drawable[node]:
            continue
        for part in scene.parts[node] or ():
            assert isinstance(part.shape, Surface)  # glTF has no other shapes
            if part.material is DEFAULT_MATERIAL:
                label = label_of_root.get(root_of_node[node], LABEL_NONE)
            else:
                label = label_from_material(part.material)
            meshes.append(part.shape.mesh)
            materials.append(part.material)
            labels.append(label)
            nodes.append(node)
    instances = InstanceSet(tuple(meshes), tuple(materials), tuple(labels))
    return SceneTopology(instances, np.array(nodes, np.intp), images_of(materials))


def _drawing_order(scene: GltfScene) -> Sequence[int]:
    """Return the nodes in the order in which RenderEngineVtk draws them, on which what it blends depends.

    It draws geometries in the reverse order of their registration, and the nodes of a glTF file last child first. VTK's
    exporter writes its nodes, below the first root, in the order of drawing; Drake's merger appends files in the order
    of registration. How files and other geometries alternate is not in the document: files come first here.
    """
    parents = scene.nodes.parents
    if scene.generator != DRAKE_MERGER:
        return range(len(parents))
    roots = [node for node, parent in enumerate(parents) if parent < 0]
    children: list[list[int]] = [[] for _ in parents]
    for node, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(node)
    files: list[int] = []
    stack = roots[1:]
    while stack:
        node = stack.pop()
        files.append(node)
        stack += children[node]
    exported = set(range(len(parents))) - set(files)
    return [*files, *sorted(exported)]


def _labels_of_roots(scene: GltfScene, root_of_node: list[int]) -> dict[int, int]:
    """Return the label of primitives without a material, by the root of the scene above them.

    Drake's client hangs each glTF file below one node, and a whole file has one label. Roots with several labels or
    none are left out.
    """
    if all(part.material is not DEFAULT_MATERIAL for parts in scene.parts for part in parts or ()):
        return {}
    labels_of_root: dict[int, set[int]] = {}
    for root, parts in zip(root_of_node, scene.parts, strict=True):
        materials = [part.material for part in parts or () if part.material is not DEFAULT_MATERIAL]
        labels_of_root.setdefault(root, set()).update(map(label_from_material, materials))
    return {root: labels.pop() for root, labels in labels_of_root.items() if len(labels) == 1}
