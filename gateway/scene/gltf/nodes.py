"""The scene's nodes as a tree, without recursion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gateway.scene import tree
from gateway.scene.geometry import Part
from gateway.scene.gltf import document as gltf
from gateway.scene.gltf.document import Document, vector
from gateway.scene.gltf.errors import GltfError, element
from gateway.scene.gltf.lights import place_lights
from gateway.scene.gltf.limits import GltfLimits
from gateway.scene.gltf.scene import GltfCamera
from gateway.scene.transforms import IDENTITY, Matrix, from_column_major, from_trs
from renderers.drawlist import Light

_IDENTITY_NUMBERS: Final = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_OPTICAL: Final = np.diag((1.0, -1.0, -1.0, 1.0))
"""The optical frame in glTF's camera frame, which looks along -Z with +Y up."""
_AFFINE_TOLERANCE: Final = 1e-6


@dataclass(slots=True, eq=False)
class _Visit:
    """A node of the scene, in the order parents first."""

    index: int
    source: gltf.Node
    parent: int
    """Position of the parent among the visits; -1: a root."""
    element: str
    depth: int
    matrix: Matrix
    children: dict[tree.PathElement, tree.Node] = field(default_factory=dict)
    names: set[str] = field(default_factory=set)


@dataclass(frozen=True, slots=True, eq=False)
class NodeTree:
    """What the nodes of a scene become."""

    root: tree.Node
    cameras: tuple[GltfCamera, ...]
    lights: tuple[Light, ...]


def build_tree(
    document: Document,
    parts_of: Callable[[int, str], tuple[Part, ...]],
    limits: GltfLimits,
    lights: tuple[gltf.Light | None, ...] = (),
    warnings: list[str] | None = None,
) -> NodeTree:
    """The tree of the document's default scene.

    Args:
        parts_of: gives the parts of ``meshes[index]``; the second argument says who asks.
        lights: of the document.
        warnings: gets what is wrong with lights.

    Raises:
        GltfError: cycles, several parents, references out of range, matrices that are not affine, limits.
    """
    visits = _visits(document, limits)
    root_children: dict[tree.PathElement, tree.Node] = {}
    cameras = tuple(
        _camera(document, visits, position) for position, v in enumerate(visits) if v.source.camera is not None
    )
    parts = [parts_of(v.source.mesh, f"nodes[{v.index}].mesh") if v.source.mesh is not None else None for v in visits]
    for position in range(len(visits) - 1, -1, -1):
        visit = visits[position]
        # Children were added last first.
        children = dict(reversed(visit.children.items()))
        siblings = root_children if visit.parent < 0 else visits[visit.parent].children
        siblings[visit.element] = tree.Node(parts[position], visit.matrix, children)
    shining = (
        (f"nodes[{visit.index}]", visit.source.extensions, _world(visits, position))
        for position, visit in enumerate(visits)
        if visit.source.extensions
    )
    placed = place_lights(lights, shining if lights else (), limits.max_lights, [] if warnings is None else warnings)
    return NodeTree(tree.Node(None, IDENTITY, dict(reversed(root_children.items()))), cameras, placed)


def _roots(document: Document) -> tuple[list[int | None], str]:
    """The scene's nodes: of the default scene, else the first one, else every node that is nobody's child."""
    scenes = document.scenes or []
    if scenes:
        index = document.scene or 0
        scene = element(document.scenes, index, "scenes", "scene")
        return scene.nodes or [], f"scenes[{index}].nodes"
    nodes = document.nodes or []
    children = {child for node in nodes if node is not None for child in node.children or ()}
    roots: list[int | None] = [i for i, node in enumerate(nodes) if node is not None and i not in children]
    if nodes and not roots:
        raise GltfError("nodes: every node is another one's child, so they form a cycle")
    return roots, "nodes"


def _visits(document: Document, limits: GltfLimits) -> list[_Visit]:
    nodes = document.nodes
    roots, where = _roots(document)
    visits: list[_Visit] = []
    seen: set[int] = set()
    names: set[str] = set()
    # Last in, first out: what a node refers to comes directly after it, in order.
    stack: list[tuple[int | None, int, str]] = [(index, -1, where) for index in reversed(roots)]
    while stack:
        index, parent, where = stack.pop()
        if index is None:
            continue
        source = element(nodes, index, "nodes", where)
        if index in seen:
            raise GltfError(f"{where}: nodes[{index}] has several parents or is part of a cycle")
        seen.add(index)
        if len(seen) > limits.max_nodes:
            raise GltfError(f"the scene has more nodes than max_nodes = {limits.max_nodes}")
        depth = visits[parent].depth + 1 if parent >= 0 else 1
        if depth > limits.max_node_depth:
            raise GltfError(f"nodes[{index}] lies deeper than max_node_depth = {limits.max_node_depth}")
        taken = visits[parent].names if parent >= 0 else names
        name = _unique(source.name or f"node{index}", taken)
        if source.children:
            stack.extend((child, len(visits), f"nodes[{index}].children") for child in reversed(source.children))
        visits.append(_Visit(index, source, parent, name, depth, _matrix(source, f"nodes[{index}]")))
    return visits


def _unique(name: str, taken: set[str]) -> str:
    """``name``, else ``name#2``, ``name#3`` ..., whichever is free among its siblings."""
    candidate, number = name, 1
    while candidate in taken:
        number += 1
        candidate = f"{name}#{number}"
    taken.add(candidate)
    return candidate


def _matrix(node: gltf.Node, name: str) -> Matrix:
    if node.matrix is not None:
        values = vector(node.matrix, _IDENTITY_NUMBERS, f"{name}.matrix")
        if values == _IDENTITY_NUMBERS:
            return IDENTITY
        matrix = from_column_major(values)
        if np.abs(matrix[3] - IDENTITY[3]).max() > _AFFINE_TOLERANCE:
            raise GltfError(f"{name}.matrix: not affine, its last row is {matrix[3].tolist()}")
        matrix[3] = IDENTITY[3]
        return matrix
    if node.translation is None and node.rotation is None and node.scale is None:
        return IDENTITY
    return from_trs(
        vector(node.translation, (0.0, 0.0, 0.0), f"{name}.translation"),
        vector(node.rotation, (0.0, 0.0, 0.0, 1.0), f"{name}.rotation"),
        vector(node.scale, (1.0, 1.0, 1.0), f"{name}.scale"),
    )


def _world(visits: list[_Visit], position: int) -> Matrix:
    """X_world_node."""
    X_world_node = visits[position].matrix
    parent = visits[position].parent
    while parent >= 0:
        X_world_node = visits[parent].matrix @ X_world_node
        parent = visits[parent].parent
    return X_world_node


def _camera(document: Document, visits: list[_Visit], position: int) -> GltfCamera:
    visit = visits[position]
    index = visit.source.camera
    source = element(document.cameras, index, "cameras", f"nodes[{visit.index}].camera")
    assert index is not None
    X_world_node = _world(visits, position)
    path: list[tree.PathElement] = [visit.element]
    parent = visit.parent
    while parent >= 0:
        path.append(visits[parent].element)
        parent = visits[parent].parent
    lens = source.perspective or source.orthographic
    return GltfCamera(
        index=index,
        name=source.name or visit.source.name or "",
        X_world_camera=_without_scale(X_world_node) @ _OPTICAL,
        yfov=source.perspective.yfov if source.perspective is not None else None,
        znear=(lens.znear if lens is not None else None) or 0.0,
        zfar=lens.zfar if lens is not None else None,
        aspect=source.perspective.aspect_ratio if source.perspective is not None else None,
        path=tuple(reversed(path)),
    )


def _without_scale(X: Matrix) -> Matrix:
    """The pose without the scales of the node and its parents, which cameras ignore (glTF 2.0, 3.10.2)."""
    lengths = np.linalg.norm(X[:3, :3], axis=0)
    if (np.abs(lengths - 1.0) <= 1e-12).all() or not (lengths > 0.0).all():
        return X
    result = X.copy()
    result[:3, :3] /= lengths
    return result
