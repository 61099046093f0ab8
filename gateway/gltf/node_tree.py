"""Names of a document's nodes and meshes, and the scene tree made from its nodes."""

from __future__ import annotations

from gateway.gltf import schema
from gateway.gltf.nodes import NodeParts, SceneNodes
from gateway.scene import tree
from gateway.scene.transforms import IDENTITY


def mesh_names(nodes: SceneNodes, meshes: list[schema.Mesh | None] | None) -> dict[int, str]:
    """Return a name for each mesh in use, by mesh index. Meshes without a name are called after their first node.

    Args:
        meshes: Meshes of the document.
    """
    names: dict[int, str] = {}
    used: dict[str, int] = {}
    for position, mesh in enumerate(nodes.meshes):
        if mesh is not None and mesh not in names:
            source = meshes[mesh] if meshes is not None and 0 <= mesh < len(meshes) else None
            name = (source.name if isinstance(source, schema.Mesh) else "") or nodes.sources[position].name
            names[mesh] = _unique(name or f"mesh{mesh}", used)
    return names


def paths_of(nodes: SceneNodes) -> list[tree.Path]:
    """Return the path of each node in ``tree_of``."""
    paths: list[tree.Path] = []
    for name, parent in zip(_names(nodes), nodes.parents, strict=True):
        paths.append((*(paths[parent] if parent >= 0 else ()), name))
    return paths


def tree_of(nodes: SceneNodes, parts: NodeParts) -> tree.Node:
    """Return a committed tree: a root without parts, whose children are the roots of the scene.

    Args:
        parts: Parts of each node.
    """
    names = _names(nodes)
    not_identity = (nodes.X_parent_node != IDENTITY).any(axis=(1, 2)).tolist()
    matrices = [X if differs else IDENTITY for X, differs in zip(nodes.X_parent_node, not_identity, strict=True)]
    # children[p] has the children of the node at position p, last child first; children[-1] has the roots.
    children: list[dict[tree.PathElement, tree.Node]] = [{} for _ in range(len(names) + 1)]
    for position in range(len(names) - 1, -1, -1):
        ordered = dict(reversed(children[position].items()))
        children[nodes.parents[position]][names[position]] = tree.Node(parts[position], matrices[position], ordered)
    return tree.Node(None, IDENTITY, dict(reversed(children[-1].items())))


def _names(nodes: SceneNodes) -> list[str]:
    """Return the name of each node, unique among its siblings."""
    names = [source.name or f"node{index}" for index, source in zip(nodes.indices, nodes.sources, strict=True)]
    if len(set(zip(nodes.parents, names, strict=True))) == len(names):
        return names
    numbers: dict[int, dict[str, int]] = {}
    return [_unique(name, numbers.setdefault(parent, {})) for name, parent in zip(names, nodes.parents, strict=True)]


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
