"""The scene's nodes as a tree, without recursion."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gateway.scene import tree
from gateway.scene.geometry import Part
from gateway.scene.gltf import document as gltf
from gateway.scene.gltf.bytewise import address_of_new
from gateway.scene.gltf.document import Document, vector
from gateway.scene.gltf.errors import GltfError, element
from gateway.scene.gltf.kernels import AFFINE_TOLERANCE, arrange
from gateway.scene.gltf.lights import place_lights
from gateway.scene.gltf.limits import GltfLimits
from gateway.scene.gltf.scene import GltfCamera
from gateway.scene.transforms import IDENTITY, Matrix, from_column_major, from_trs, trs_numbers
from renderers.drawlist import Light

_IDENTITY_NUMBERS: Final = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_NOT_TURNED: Final = _IDENTITY_NUMBERS[:12]
_OPTICAL: Final = np.array((1.0, -1.0, -1.0, 1.0))
"""The columns of the optical frame in glTF's camera frame, which looks along -Z with +Y up."""
_ZEROS: Final = np.zeros(4)
_FEW: Final = 64
"""Nodes below which working on all of a level together does not pay."""

Matrices: TypeAlias = NDArray[np.float64]
"""(N, 4, 4)."""
Flags: TypeAlias = NDArray[np.bool_]
"""(N,)."""


@dataclass(slots=True, eq=False)
class _Visits:
    """The nodes of the scene in the order parents first, each below all that lie before it among its siblings."""

    indices: list[int]
    """In the document."""
    sources: list[gltf.Node]
    parents: list[int]
    """Positions among the visits; -1: a root."""
    depths: list[int]
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
        self, visits: _Visits, parts: list[tuple[Part, ...] | None], locals_: Matrices, moves: Flags, worlds: Matrices
    ) -> None:
        """``moves``: which of the matrices differ from the identity."""
        self._visits = visits
        self._parts = parts
        self._locals = locals_
        self._moves = moves
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
        visits = self._visits
        names = [source.name or f"node{index}" for index, source in zip(visits.indices, visits.sources, strict=True)]
        if len(set(zip(visits.parents, names, strict=True))) == len(names):
            return names
        taken: dict[int, set[str]] = {}
        return [
            _unique(name, taken.setdefault(parent, set())) for name, parent in zip(names, visits.parents, strict=True)
        ]

    def _tree(self) -> tree.Node:
        names, parents = self.names(), self._visits.parents
        locals_ = [X if moves else IDENTITY for X, moves in zip(self._locals, self._moves.tolist(), strict=True)]
        children: list[dict[tree.PathElement, tree.Node]] = [{} for _ in range(len(parents) + 1)]  # the last: roots
        for position in range(len(parents) - 1, -1, -1):
            # Children were added last first.
            own = dict(reversed(children[position].items()))
            children[parents[position]][names[position]] = tree.Node(self._parts[position], locals_[position], own)
        return tree.Node(None, IDENTITY, dict(reversed(children[-1].items())))


class PartsOf(Protocol):
    """What the nodes' meshes draw."""

    def prepare(self, indices: Iterable[int]) -> None:
        """``indices``: of the meshes that will be asked for, in order."""

    def __call__(self, index: int, node: int) -> tuple[Part, ...]:
        """The parts of ``meshes[index]``, which ``nodes[node]`` asks for."""


def build_tree(
    document: Document,
    parts_of: PartsOf,
    limits: GltfLimits,
    lights: tuple[gltf.Light | None, ...] = (),
    warnings: list[str] | None = None,
) -> NodeTree:
    """The tree of the document's default scene.

    Args:
        lights: of the document.
        warnings: gets what is wrong with lights.

    Raises:
        GltfError: cycles, several parents, references out of range, matrices that are not affine, limits.
    """
    visits = _visits(document, limits)
    locals_, moves = _matrices(visits)
    worlds = _worlds(visits, locals_, moves)
    seeing = [position for position, source in enumerate(visits.sources) if source.camera is not None]
    for position in seeing:
        where = f"nodes[{visits.indices[position]}].camera"
        element(document.cameras, visits.sources[position].camera, "cameras", where)
    parts_of.prepare(source.mesh for source in visits.sources if source.mesh is not None)
    parts = [
        parts_of(source.mesh, index) if source.mesh is not None else None
        for index, source in zip(visits.indices, visits.sources, strict=True)
    ]
    nodes = NodeTree(visits, parts, locals_, moves, worlds)
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
    visits = _Visits([], [], [], [])
    indices, sources, parents, depths = visits.indices, visits.sources, visits.parents, visits.depths
    count = len(nodes) if nodes is not None else 0
    seen: set[int] = set()
    # Who is being looked at: children not seen yet, position, depth of the children, and who refers to them.
    open_: list[tuple[Iterator[int | None], int, int, str]] = [(iter(roots), -1, 1, where)]
    while open_:
        children, parent, depth, where = open_[-1]
        for index in children:
            if index is None:
                continue
            source = nodes[index] if nodes is not None and type(index) is int and 0 <= index < count else None
            if source is None:
                source = element(nodes, index, "nodes", where)
            if index in seen:
                raise GltfError(f"{where}: nodes[{index}] has several parents or is part of a cycle")
            seen.add(index)
            if len(seen) > limits.max_nodes:
                raise GltfError(f"the scene has more nodes than max_nodes = {limits.max_nodes}")
            if depth > limits.max_node_depth:
                raise GltfError(f"nodes[{index}] lies deeper than max_node_depth = {limits.max_node_depth}")
            indices.append(index)
            sources.append(source)
            parents.append(parent)
            depths.append(depth)
            if source.children:
                open_.append((iter(source.children), len(depths) - 1, depth + 1, f"nodes[{index}].children"))
                break
        else:
            open_.pop()
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
        if np.abs(matrix[3] - IDENTITY[3]).max() > AFFINE_TOLERANCE:
            raise GltfError(f"{name}.matrix: not affine, its last row is {matrix[3].tolist()}")
        matrix[3] = IDENTITY[3]
        return matrix
    if node.translation is None and node.rotation is None and node.scale is None:
        return IDENTITY
    return from_trs(*_trs(node, name))


def _trs(node: gltf.Node, name: str) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    return (
        vector(node.translation, (0.0, 0.0, 0.0), f"{name}.translation"),
        vector(node.rotation, (0.0, 0.0, 0.0, 1.0), f"{name}.rotation"),
        vector(node.scale, (1.0, 1.0, 1.0), f"{name}.scale"),
    )


def _matrices(visits: _Visits) -> tuple[Matrices, Flags]:
    """X_parent_node of every visit, and whether it differs from the identity. All at once: a call of numpy for every
    node would cost ten times as much."""
    count = len(visits.sources)
    matrices, moves = np.empty((count, 4, 4)), np.zeros(count, np.bool_)
    if count == 0:
        return matrices, moves
    numbers: list[float] = []
    usual = True
    for index, source in zip(visits.indices, visits.sources, strict=True):
        if source.matrix is not None:
            numbers += source.matrix
            usual &= len(source.matrix) == 16
        elif source.rotation is not None or source.scale is not None:
            numbers += trs_numbers(*_trs(source, f"nodes[{index}]"))
        elif source.translation is None:
            numbers += _IDENTITY_NUMBERS
        else:
            numbers += _NOT_TURNED
            numbers += source.translation
            numbers.append(1.0)
            usual &= len(source.translation) == 3
    given = array("d", numbers)
    places = (given.buffer_info()[0], address_of_new(matrices), address_of_new(moves))
    if not usual or not arrange(count, *places):
        for position, (index, source) in enumerate(zip(visits.indices, visits.sources, strict=True)):
            matrix = _matrix(source, f"nodes[{index}]")
            matrices[position], moves[position] = matrix, matrix is not IDENTITY
    return matrices, moves


def _worlds(visits: _Visits, locals_: Matrices, moves: Flags) -> Matrices:
    """(N, 4, 4) X_world_node; ``locals_`` itself where all nodes are roots."""
    turned = {*visits.parents}
    turned.discard(-1)
    if not turned or not any(map(moves.item, turned)):
        return locals_
    worlds = locals_.copy()
    with np.errstate(all="ignore"):
        if len(worlds) < _FEW:
            moved = moves.tolist()  # by any of its parents, or itself
            for position, parent in enumerate(visits.parents):
                if parent >= 0 and moved[parent]:
                    worlds[position] = worlds[parent] @ worlds[position] if moved[position] else worlds[parent]
                    moved[position] = True
        else:
            depths, parents = np.array(visits.depths), np.array(visits.parents)
            levels = np.split(np.argsort(depths, kind="stable"), np.cumsum(np.bincount(depths))[:-1])
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
        X_world_camera=_without_scale(worlds[position]) * _OPTICAL + _ZEROS,  # none is negative
        yfov=source.perspective.yfov if source.perspective is not None else None,
        znear=(lens.znear if lens is not None else None) or 0.0,
        zfar=lens.zfar if lens is not None else None,
        aspect=source.perspective.aspect_ratio if source.perspective is not None else None,
        path=tuple(reversed(path)),
    )


def _without_scale(X: Matrix) -> Matrix:
    """The pose without the scales of the node and its parents, which cameras ignore (glTF 2.0, 3.10.2)."""
    (a, b, c, _), (d, e, f, _), (g, h, i, _), _ = X.tolist()
    x, y, z = math.sqrt(a * a + d * d + g * g), math.sqrt(b * b + e * e + h * h), math.sqrt(c * c + f * f + i * i)
    if abs(x - 1.0) <= 1e-12 and abs(y - 1.0) <= 1e-12 and abs(z - 1.0) <= 1e-12:
        return X
    lengths = (x, y, z)
    if not all(0.0 < length < math.inf for length in lengths):
        return X
    result = X.copy()
    result[:3, :3] /= lengths
    return result
