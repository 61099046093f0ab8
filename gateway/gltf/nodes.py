"""Nodes of a document's scene: their order, their local and world matrices, and the scene tree made from them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Final, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.gltf import schema
from gateway.gltf.errors import GltfError, GltfLimitError, as_warning, checked_item
from gateway.gltf.limits import GltfLimits
from gateway.gltf.node_transforms import local_matrices, world_matrices
from gateway.gltf.parser import extension
from gateway.scene import tree
from gateway.scene.geometry import Part
from gateway.scene.transforms import IDENTITY, affine_product
from renderers.stop import check_stop

VISIBILITY: Final = "KHR_node_visibility"
_NODES_PER_STOP_CHECK: Final = 1 << 12
"""Nodes between two checks of the ``StopFlag``."""

NodeParts: TypeAlias = list[tuple[Part, ...] | None]
"""The primitives of each node; None for a node without a mesh."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneNodes:
    """The nodes of the scene, parents before children. Entry i of each list and array belongs to the same node."""

    indices: list[int]
    """Indices of the nodes in the document."""
    sources: list[schema.Node]
    """The nodes as parsed."""
    parents: list[int]
    """Positions of the parents in these lists; -1 for the roots of the scene."""
    meshes: list[int | None]
    """Indices of the nodes' meshes in the document; None for nodes without a mesh."""
    X_parent_node: NDArray[np.float64]
    """(N, 4, 4), poses in the frame of the parent."""
    X_world_node: NDArray[np.float64]
    """(N, 4, 4), poses in the document's world frame."""
    warnings: list[str]
    """Sentences about properties of nodes and scenes that were ignored or repaired."""

    def first_node_by_mesh(self) -> dict[int, int]:
        """Return the first node of each mesh in use: node indices by mesh index, in the order of the nodes."""
        node_of_mesh: dict[int, int] = {}
        for node, mesh in zip(self.indices, self.meshes, strict=True):
            if mesh is not None:
                node_of_mesh.setdefault(mesh, node)
        return node_of_mesh

    def mesh_names(self, meshes: list[schema.Mesh | None] | None) -> dict[int, str]:
        """Return a name for each mesh in use, by mesh index. Meshes without a name are called after their first node.

        Args:
            meshes: Meshes of the document.
        """
        names: dict[int, str] = {}
        used: dict[str, int] = {}
        for position, mesh in enumerate(self.meshes):
            if mesh is not None and mesh not in names:
                source = meshes[mesh] if meshes is not None and 0 <= mesh < len(meshes) else None
                name = (source.name if isinstance(source, schema.Mesh) else "") or self.sources[position].name
                names[mesh] = _unique(name or f"mesh{mesh}", used)
        return names

    def paths(self) -> list[tree.Path]:
        """Return the path of each node in ``tree``."""
        paths: list[tree.Path] = []
        for name, parent in zip(self._names(), self.parents, strict=True):
            paths.append((*(paths[parent] if parent >= 0 else ()), name))
        return paths

    def tree(self, parts: NodeParts) -> tree.Node:
        """Return a committed tree: a root without parts, whose children are the roots of the scene.

        Args:
            parts: Parts of each node.
        """
        names = self._names()
        not_identity = (self.X_parent_node != IDENTITY).any(axis=(1, 2)).tolist()
        matrices = [X if differs else IDENTITY for X, differs in zip(self.X_parent_node, not_identity, strict=True)]
        # children[p] has the children of the node at position p, last child first; children[-1] has the roots.
        children: list[dict[tree.PathElement, tree.Node]] = [{} for _ in range(len(names) + 1)]
        for position in range(len(names) - 1, -1, -1):
            ordered = dict(reversed(children[position].items()))
            children[self.parents[position]][names[position]] = tree.Node(parts[position], matrices[position], ordered)
        return tree.Node(None, IDENTITY, dict(reversed(children[-1].items())))

    def _names(self) -> list[str]:
        """Return the name of each node, unique among its siblings."""
        names = [source.name or f"node{index}" for index, source in zip(self.indices, self.sources, strict=True)]
        if len(set(zip(self.parents, names, strict=True))) == len(names):
            return names
        numbers: dict[int, dict[str, int]] = {}
        return [_unique(name, numbers.setdefault(parent, {})) for name, parent in zip(names, self.parents, strict=True)]


def read_nodes(document: schema.Document, limits: GltfLimits) -> SceneNodes:
    """Return the nodes of the document's default scene.

    A node that several nodes list as a child belongs to the first of them. Cycles therefore end.

    Raises:
        GltfLimitError: A limit is exceeded.
    """
    nodes = document.nodes or []
    warnings: list[str] = []
    indices: list[int] = []
    sources: list[schema.Node] = []
    parents: list[int] = []
    levels: list[list[int]] = []  # positions of the nodes of each depth
    visited: set[int] = set()
    roots, roots_path = _roots(document, visited, warnings)
    stack: list[tuple[Iterator[int | None], int]] = [(roots, -1)]  # remaining children, position of their parent
    while stack:
        check_stop()
        children, parent = stack[-1]
        if len(levels) < len(stack):
            levels.append([])
        for index in children:
            if index is None:
                continue
            if not 0 <= index < len(nodes) or type(source := nodes[index]) is not schema.Node or index in visited:
                path = roots_path if parent < 0 else f"nodes[{indices[parent]}].children"
                with as_warning(warnings, "it is left out"):
                    checked_item(document.nodes, index, "nodes", path)  # raises for an invalid node
                    raise GltfError(f"{path}: nodes[{index}] is already in the scene")
                continue
            position = len(indices)
            if position == limits.max_nodes:
                raise GltfLimitError(f"the scene has more nodes than max_nodes = {limits.max_nodes}")
            visited.add(index)
            indices.append(index)
            sources.append(source)
            parents.append(parent)
            levels[len(stack) - 1].append(position)
            if source.children:
                stack.append((iter(source.children), position))
                break
        else:
            stack.pop()
    X_parent_node = local_matrices(sources, indices, warnings)
    X_world_node = world_matrices(X_parent_node, parents, levels)
    if len(levels) > limits.max_node_depth:
        _flatten_deep_nodes(parents, X_parent_node, limits.max_node_depth)
    _hide_invisible(sources, parents, indices, warnings)
    meshes = [source.mesh for source in sources]
    return SceneNodes(indices, sources, parents, meshes, X_parent_node, X_world_node, warnings)


def _flatten_deep_nodes(parents: list[int], X_parent_node: NDArray[np.float64], max_depth: int) -> None:
    """Make nodes deeper than ``max_depth`` siblings of their ancestor at that depth. Their world matrices stay."""
    depths: list[int] = []
    with np.errstate(all="ignore"):
        for position, parent in enumerate(parents):
            if position % _NODES_PER_STOP_CHECK == 0:
                check_stop()
            if parent >= 0 and depths[parent] == max_depth:
                own, above = slice(position, position + 1), slice(parent, parent + 1)
                X_parent_node[own] = affine_product(X_parent_node[above], X_parent_node[own])
                parents[position] = parent = parents[parent]
            depths.append(depths[parent] + 1 if parent >= 0 else 1)


def _hide_invisible(sources: list[schema.Node], parents: list[int], indices: list[int], warnings: list[str]) -> None:
    """Remove the meshes and lights of the nodes that KHR_node_visibility hides, and of their descendants."""
    if not any(source.extensions for source in sources):
        return
    hidden: set[int] = set()
    for position, (source, parent) in enumerate(zip(sources, parents, strict=True)):
        if source.extensions and VISIBILITY in source.extensions:
            name = f"nodes[{indices[position]}]"
            found = extension(source.extensions, VISIBILITY, schema.NodeVisibility, name, warnings)
            if found is not None and found.visible is False:
                hidden.add(position)
        if parent in hidden:
            hidden.add(position)
        if position in hidden:
            sources[position] = msgspec.structs.replace(source, mesh=None, extensions=None)


def _roots(document: schema.Document, visited: set[int], warnings: list[str]) -> tuple[Iterator[int | None], str]:
    """Return the indices of the root nodes, and the name of the property that lists them, for messages.

    The roots are those of the default scene, or else of the first one. In a document without scenes, all nodes without
    a parent are roots, and then one node of each cycle.

    Args:
        visited: Indices of the nodes in the scene so far. The result reads it while the caller adds nodes.
    """
    if document.scenes:
        with as_warning(warnings, "all nodes without a parent are drawn"):
            index = document.scene or 0
            scene = checked_item(document.scenes, index, "scenes", "scene")
            return iter(scene.nodes or ()), f"scenes[{index}].nodes"
    nodes = document.nodes or []
    children = {child for node in nodes if isinstance(node, schema.Node) for child in node.children or ()}
    indices = [i for i, node in enumerate(nodes) if node is not None]
    return chain((i for i in indices if i not in children), (i for i in indices if i not in visited)), "nodes"


def _unique(name: str, last_numbers: dict[str, int]) -> str:
    """Return ``name``, or the first of ``name#2``, ``name#3`` ... that no sibling has.

    Args:
        last_numbers: The last number tried, by the names of the siblings; the result is added. With 100,000 equal
            names, trying all numbers for each name would take minutes.
    """
    candidate, number = name, last_numbers.get(name, 1)
    while candidate in last_numbers:
        number += 1
        candidate = f"{name}#{number}"
    last_numbers[name] = number
    last_numbers.setdefault(candidate, 1)
    return candidate
