"""The scene's nodes as a tree, without recursion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

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
_FEW: Final = 8
"""Nodes below which working on all of them together does not pay."""

Matrices: TypeAlias = NDArray[np.float64]
"""(N, 4, 4)."""


@dataclass(slots=True, eq=False)
class _Visits:
    """The nodes of the scene in the order parents first, each below all that lie before it among its siblings."""

    indices: list[int] = field(default_factory=list)
    """In the document."""
    sources: list[gltf.Node] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    """Positions among the visits; -1: a root."""
    depths: list[int] = field(default_factory=list)
    """1: a root."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedParts:
    """What one node draws."""

    parts: tuple[Part, ...]
    X_world_node: Matrix
    branch: int
    """Equal for nodes below the same root of the scene."""


class NodeTree:
    """What the nodes of a scene become: parts with their places, at once; a tree, when it is asked for."""

    def __init__(
        self, visits: _Visits, parts: list[tuple[Part, ...] | None], locals_: list[Matrix], worlds: Matrices
    ) -> None:
        self._visits = visits
        self._parts = parts
        self._locals = locals_
        self._worlds = worlds
        self._root: tree.Node | None = None
        self.cameras: tuple[GltfCamera, ...] = ()
        self.lights: tuple[Light, ...] = ()

    @property
    def root(self) -> tree.Node:
        """The tree; its children are the scene's nodes. Made once; two threads may both make it."""
        if self._root is None:
            self._root = self._tree()
        return self._root

    def placed(self) -> list[PlacedParts]:
        """Every node with parts, parents first."""
        branches: list[int] = []
        result: list[PlacedParts] = []
        for position, (parent, parts) in enumerate(zip(self._visits.parents, self._parts, strict=True)):
            branches.append(position if parent < 0 else branches[parent])
            if parts:
                result.append(PlacedParts(parts, self._worlds[position], branches[position]))
        return result

    def names(self) -> list[str]:
        """Of each visit, unique among its siblings."""
        taken: dict[int, set[str]] = {}
        visits = self._visits
        return [
            _unique(source.name or f"node{index}", taken.setdefault(parent, set()))
            for index, source, parent in zip(visits.indices, visits.sources, visits.parents, strict=True)
        ]

    def _tree(self) -> tree.Node:
        names, parents = self.names(), self._visits.parents
        children: list[dict[tree.PathElement, tree.Node]] = [{} for _ in range(len(parents) + 1)]  # the last: roots
        for position in range(len(parents) - 1, -1, -1):
            # Children were added last first.
            own = dict(reversed(children[position].items()))
            children[parents[position]][names[position]] = tree.Node(self._parts[position], self._locals[position], own)
        return tree.Node(None, IDENTITY, dict(reversed(children[-1].items())))


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
    locals_ = _matrices(visits)
    worlds = _worlds(visits, locals_)
    seeing = [position for position, source in enumerate(visits.sources) if source.camera is not None]
    for position in seeing:
        where = f"nodes[{visits.indices[position]}].camera"
        element(document.cameras, visits.sources[position].camera, "cameras", where)
    parts = [
        parts_of(source.mesh, f"nodes[{index}].mesh") if source.mesh is not None else None
        for index, source in zip(visits.indices, visits.sources, strict=True)
    ]
    nodes = NodeTree(visits, parts, locals_, worlds)
    if seeing:
        names = nodes.names()
        nodes.cameras = tuple(_camera(document, visits, names, worlds, position) for position in seeing)
    if lights:
        shining = (
            (f"nodes[{visits.indices[position]}]", source.extensions, worlds[position])
            for position, source in enumerate(visits.sources)
            if source.extensions
        )
        nodes.lights = place_lights(lights, shining, limits.max_lights, [] if warnings is None else warnings)
    return nodes


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


def _visits(document: Document, limits: GltfLimits) -> _Visits:
    nodes = document.nodes
    roots, where = _roots(document)
    visits = _Visits()
    depths = visits.depths
    seen: set[int] = set()
    # Last in, first out: what a node refers to comes directly after it, in order.
    stack: list[tuple[int | None, int, str]] = [(index, -1, where) for index in reversed(roots)]
    while stack:
        index, parent, where = stack.pop()
        if index is None:
            continue
        known = nodes[index] if type(index) is int and nodes is not None and 0 <= index < len(nodes) else None
        source = known if known is not None else element(nodes, index, "nodes", where)
        if index in seen:
            raise GltfError(f"{where}: nodes[{index}] has several parents or is part of a cycle")
        seen.add(index)
        if len(seen) > limits.max_nodes:
            raise GltfError(f"the scene has more nodes than max_nodes = {limits.max_nodes}")
        depth = depths[parent] + 1 if parent >= 0 else 1
        if depth > limits.max_node_depth:
            raise GltfError(f"nodes[{index}] lies deeper than max_node_depth = {limits.max_node_depth}")
        if source.children:
            position, where = len(depths), f"nodes[{index}].children"
            stack.extend([(child, position, where) for child in reversed(source.children)])
        visits.indices.append(index)
        visits.sources.append(source)
        visits.parents.append(parent)
        depths.append(depth)
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


def _matrices(visits: _Visits) -> list[Matrix]:
    """X_parent_node of every visit; ``IDENTITY`` itself where nothing moves."""
    matrices = _several(visits)
    return [
        _matrix(source, f"nodes[{index}]") if matrix is None else matrix
        for index, source, matrix in zip(visits.indices, visits.sources, matrices, strict=True)
    ]


def _several(visits: _Visits) -> list[Matrix | None]:
    """Those matrices that are as nearly all are, all at once: a call of numpy for every node would cost ten times as
    much. None: to be looked at alone."""
    result: list[Matrix | None] = [None] * len(visits.sources)
    given, moved = [], []
    for position, source in enumerate(visits.sources):
        if source.matrix is not None:
            given.append(position)
        elif source.rotation is None and source.scale is None:
            if source.translation is None:
                result[position] = IDENTITY
            else:
                moved.append(position)
    if len(given) >= _FEW:
        values = _numbers([visits.sources[position].matrix for position in given], 16)
        if values is not None:
            matrices = np.ascontiguousarray(values.reshape(-1, 4, 4).transpose(0, 2, 1))
            if (np.abs(matrices[:, 3] - IDENTITY[3]) <= _AFFINE_TOLERANCE).all():
                matrices[:, 3] = IDENTITY[3]
                differs = (matrices != IDENTITY).any(axis=(1, 2)).tolist()
                for position, matrix, moves in zip(given, matrices, differs, strict=True):
                    result[position] = matrix if moves else IDENTITY
    if len(moved) >= _FEW:
        values = _numbers([visits.sources[position].translation for position in moved], 3)
        if values is not None:
            matrices = np.tile(IDENTITY, (len(moved), 1, 1))
            matrices[:, :3, 3] = values
            for position, matrix in zip(moved, matrices, strict=True):
                result[position] = matrix
    return result


def _numbers(rows: list[list[float] | None], length: int) -> NDArray[np.float64] | None:
    """(N, length), or None if any row has another length or a value that is not finite."""
    try:
        values = np.array(rows, dtype=np.float64)
    except (ValueError, OverflowError):
        return None
    return values if values.shape == (len(rows), length) and np.isfinite(values).all() else None


def _worlds(visits: _Visits, locals_: list[Matrix]) -> Matrices:
    """(N, 4, 4) X_world_node, multiplied level by level."""
    worlds = np.array(locals_).reshape(-1, 4, 4)
    if len(worlds) < _FEW:
        for position, parent in enumerate(visits.parents):
            if parent >= 0:
                worlds[position] = worlds[parent] @ worlds[position]
    elif max(visits.depths) > 1:
        depths, parents = np.array(visits.depths), np.array(visits.parents)
        levels = np.split(np.argsort(depths, kind="stable"), np.cumsum(np.bincount(depths))[:-1])
        with np.errstate(all="ignore"):
            for level in levels[2:]:
                worlds[level] = np.matmul(worlds[parents[level]], worlds[level])
    return worlds


def _camera(document: Document, visits: _Visits, names: list[str], worlds: Matrices, position: int) -> GltfCamera:
    node = visits.sources[position]
    index = node.camera
    source = element(document.cameras, index, "cameras", f"nodes[{visits.indices[position]}].camera")
    assert index is not None
    path: list[tree.PathElement] = [names[position]]
    parent = visits.parents[position]
    while parent >= 0:
        path.append(names[parent])
        parent = visits.parents[parent]
    lens = source.perspective or source.orthographic
    return GltfCamera(
        index=index,
        name=source.name or node.name or "",
        X_world_camera=_without_scale(worlds[position]) @ _OPTICAL,
        yfov=source.perspective.yfov if source.perspective is not None else None,
        znear=(lens.znear if lens is not None else None) or 0.0,
        zfar=lens.zfar if lens is not None else None,
        aspect=source.perspective.aspect_ratio if source.perspective is not None else None,
        path=tuple(reversed(path)),
    )


def _without_scale(X: Matrix) -> Matrix:
    """The pose without the scales of the node and its parents, which cameras ignore (glTF 2.0, 3.10.2)."""
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(X[:3, :3], axis=0)
    if (np.abs(lengths - 1.0) <= 1e-12).all() or not (np.isfinite(lengths) & (lengths > 0.0)).all():
        return X
    result = X.copy()
    result[:3, :3] /= lengths
    return result
