"""The scene's nodes as a tree, without recursion."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from struct import pack
from typing import Final, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gateway.gltf import document as gltf
from gateway.gltf.compare import address_of_bytes, address_of_new
from gateway.gltf.document import Document, vector
from gateway.gltf.errors import GltfError, element
from gateway.gltf.lights import place_lights
from gateway.gltf.limits import GltfLimits
from gateway.gltf.reader_kernels import AFFINE_TOLERANCE, arrange
from gateway.gltf.scene import GltfCamera
from gateway.scene import tree
from gateway.scene.geometry import Part
from gateway.scene.transforms import IDENTITY, Matrix, from_column_major, from_trs
from renderers.drawlist import Light
from renderers.stop import check_stop

_IDENTITY_NUMBERS: Final = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_NOT_TURNED: Final = _IDENTITY_NUMBERS[:12]
_NOT_MOVED: Final = [0.0, 0.0, 0.0]
_UPRIGHT: Final = [0.0, 0.0, 0.0, 1.0]
_NOT_SCALED: Final = [1.0, 1.0, 1.0]
_FILL: Final = (0.0,) * 6

Matrices: TypeAlias = NDArray[np.float64]
"""(N, 4, 4)."""


@dataclass(frozen=True, slots=True, eq=False)
class Visits:
    """The nodes of the scene in the order parents first, each below all that lie before it among its siblings."""

    indices: list[int]
    """In the document."""
    sources: list[gltf.Node]
    parents: list[int]
    """Positions among the visits; -1: a root."""
    meshes: list[int | None]
    seeing: list[int]
    """Positions of nodes with a camera."""

    def names(self) -> list[str]:
        """Of each visit, unique among its siblings."""
        names = [source.name or f"node{index}" for index, source in zip(self.indices, self.sources, strict=True)]
        if len(set(zip(self.parents, names, strict=True))) == len(names):
            return names
        taken: dict[int, dict[str, int]] = {}
        return [_unique(name, taken.setdefault(parent, {})) for name, parent in zip(names, self.parents, strict=True)]

    def path(self, position: int) -> tree.Path:
        """Of a visit, from the root on."""
        names, parents = self.names(), self.parents
        path: list[tree.PathElement] = []
        while position >= 0:
            path.append(names[position])
            position = parents[position]
        return tuple(reversed(path))


class NodeTree:
    """What the nodes of a scene become: parts with their places, at once; a tree, when it is asked for."""

    def __init__(
        self,
        visits: Visits,
        parts: list[tuple[Part, ...] | None],
        locals_: Matrices,
        moves: bytearray,
        worlds: Matrices,
    ) -> None:
        """``moves``: which of the matrices differ from the identity, an odd number."""
        self._visits = visits
        self._locals = locals_
        self._moves = moves
        self.parts = parts
        """What each node draws, parents first; None: it has no mesh."""
        self.parents = visits.parents
        """Of each node, its parent's place in these lists; -1: a root of the scene."""
        self.X_world_node = worlds
        self._root: tree.Node | None = None
        self.cameras: tuple[GltfCamera, ...] = ()
        self.lights: tuple[Light, ...] = ()

    @property
    def root(self) -> tree.Node:
        """The tree; its children are the scene's nodes. Made once; two threads may both make it."""
        if self._root is None:
            self._root = self._tree()
        return self._root

    def _tree(self) -> tree.Node:
        names, parents = self._visits.names(), self._visits.parents
        locals_ = [X if moves & 1 else IDENTITY for X, moves in zip(self._locals, self._moves, strict=True)]
        children: list[dict[tree.PathElement, tree.Node]] = [{} for _ in range(len(parents) + 1)]  # the last: roots
        for position in range(len(parents) - 1, -1, -1):
            # Children were added last first.
            own = dict(reversed(children[position].items()))
            children[parents[position]][names[position]] = tree.Node(self.parts[position], locals_[position], own)
        return tree.Node(None, IDENTITY, dict(reversed(children[-1].items())))


class PartsOf(Protocol):
    """What the nodes' meshes draw."""

    def __call__(self, nodes: list[int], meshes: list[int | None]) -> list[tuple[Part, ...] | None]:
        """Of each node; None: it has no mesh.

        Args:
            nodes: their indices in the document.
            meshes: theirs.
        """


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
    locals_, moves, worlds = _places(visits)
    lenses = [_lens(document, visits, position) for position in visits.seeing]
    nodes = NodeTree(visits, parts_of(visits.indices, visits.meshes), locals_, moves, worlds)
    if lenses:
        nodes.cameras = tuple(
            [
                _camera(source, visits, position, worlds[position])
                for source, position in zip(lenses, visits.seeing, strict=True)
            ]
        )
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


def _visits(document: Document, limits: GltfLimits) -> Visits:
    nodes = document.nodes or []
    roots, of_roots = _roots(document)
    visits = Visits([], [], [], [], [])
    indices, sources, parents, meshes = visits.indices, visits.sources, visits.parents, visits.meshes
    count, most = len(nodes), limits.max_nodes
    seen: set[int] = set()
    open_: list[tuple[Iterator[int | None], int]] = [(iter(roots), -1)]  # children not seen yet, and whose
    while open_:
        check_stop()
        children, parent = open_[-1]
        deep = len(open_) > limits.max_node_depth
        for index in children:
            if index is None:
                continue
            source = nodes[index] if 0 <= index < count else None
            if source is None or index in seen:
                where = of_roots if parent < 0 else f"nodes[{indices[parent]}].children"
                element(document.nodes, index, "nodes", where)
                raise GltfError(f"{where}: nodes[{index}] has several parents or is part of a cycle")
            seen.add(index)
            indices.append(index)
            if len(indices) > most:
                raise GltfError(f"the scene has more nodes than max_nodes = {most}")
            if deep:
                raise GltfError(f"nodes[{index}] lies deeper than max_node_depth = {limits.max_node_depth}")
            sources.append(source)
            parents.append(parent)
            meshes.append(source.mesh)
            if source.camera is not None:
                visits.seeing.append(len(parents) - 1)
            if source.children:
                open_.append((iter(source.children), len(parents) - 1))
                break
        else:
            open_.pop()
    return visits


def _unique(name: str, taken: dict[str, int]) -> str:
    """``name``, else ``name#2``, ``name#3`` ..., whichever is free among its siblings.

    Args:
        taken: the siblings' names, and the last number that was tried for each: of 100,000 equal ones, each would try
            all numbers before its own.
    """
    candidate, number = name, taken.get(name, 1)
    while candidate in taken:
        number += 1
        candidate = f"{name}#{number}"
    taken[name] = number
    taken.setdefault(candidate, 1)
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


def _places(visits: Visits) -> tuple[Matrices, bytearray, Matrices]:
    """X_parent_node of every visit, whether it differs from the identity, and X_world_node (the first itself where all
    nodes are roots). All at once: a call of numpy for every node would cost ten times as much."""
    sources, parents = visits.sources, visits.parents
    count = len(sources)
    matrices, moves = np.empty((count, 4, 4)), bytearray(count)
    if count == 0:
        return matrices, moves, matrices
    given = _numbers(sources, moves)
    numbers = None if given is None else pack(f"{len(given)}d", *given)  # nobody else has them: the kernel may write
    above = pack(f"{count}q", *parents)
    worlds = np.empty((count, 4, 4)) if max(parents) >= 0 else matrices
    to_worlds = 0 if worlds is matrices else address_of_new(worlds)
    places = (address_of_bytes(above), address_of_new(matrices), to_worlds, address_of_new(moves))
    if numbers is None or not arrange(count, address_of_bytes(numbers), *places):
        for position, (index, source) in enumerate(zip(visits.indices, sources, strict=True)):
            matrix = _matrix(source, f"nodes[{index}]")
            matrices[position], moves[position] = matrix, matrix is not IDENTITY
        arrange(count, 0, *places)
    return matrices, moves, worlds


def _numbers(sources: list[gltf.Node], composed: bytearray) -> list[float] | None:
    """What ``arrange`` takes; None: a node has too few numbers, or too many.

    Args:
        composed: of each node, written: 1 where they are a translation, a rotation and a scale.
    """
    numbers: list[float] = []
    for position, source in enumerate(sources):
        matrix, move = source.matrix, source.translation
        if matrix is not None:
            if len(matrix) != 16:
                return None
            numbers += matrix
            continue
        turn, scale = source.rotation, source.scale
        if move is None:
            if turn is None and scale is None:
                numbers += _IDENTITY_NUMBERS
                continue
            move = _NOT_MOVED
        elif len(move) != 3:
            return None
        if turn is None and scale is None:
            numbers += _NOT_TURNED
            numbers += move
            numbers.append(1.0)
            continue
        turn, scale = _UPRIGHT if turn is None else turn, _NOT_SCALED if scale is None else scale
        if len(turn) != 4 or len(scale) != 3:
            return None
        numbers += move
        numbers += turn
        numbers += scale
        numbers += _FILL
        composed[position] = 1
    return numbers


def _lens(document: Document, visits: Visits, position: int) -> gltf.Camera:
    """The camera of a node."""
    index, cameras = visits.sources[position].camera, document.cameras
    source = cameras[index] if cameras is not None and index is not None and 0 <= index < len(cameras) else None
    return source or element(cameras, index, "cameras", f"nodes[{visits.indices[position]}].camera")


def _camera(source: gltf.Camera, visits: Visits, position: int, X_world_node: Matrix) -> GltfCamera:
    node = visits.sources[position]
    index, perspective = node.camera, source.perspective
    assert index is not None
    lens = perspective or source.orthographic
    return GltfCamera(
        index,
        source.name or node.name or "",
        _optical(X_world_node),
        None if perspective is None else perspective.yfov,
        0.0 if lens is None or lens.znear is None else lens.znear,
        None if lens is None else lens.zfar,
        None if perspective is None else perspective.aspect_ratio,
        visits,
        position,
    )


def _optical(X: Matrix) -> Matrix:
    """The pose of the optical frame in glTF's camera frame, which looks along -Z with +Y up; without the scales of the
    node and its parents, which cameras ignore (glTF 2.0, 3.10.2). In plain numbers: numpy takes twice as long."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z), _ = X.tolist()
    p, q, r = math.sqrt(a * a + d * d + g * g), math.sqrt(b * b + e * e + h * h), math.sqrt(c * c + f * f + i * i)
    scaled = abs(p - 1.0) > 1e-12 or abs(q - 1.0) > 1e-12 or abs(r - 1.0) > 1e-12
    if scaled and 0.0 < p < math.inf and 0.0 < q < math.inf and 0.0 < r < math.inf:
        a, b, c, d, e, f, g, h, i = a / p, b / q, c / r, d / p, e / q, f / r, g / p, h / q, i / r
    # Zeros are added, so that none is negative.
    numbers = (
        *(a + 0.0, 0.0 - b, 0.0 - c, x + 0.0),
        *(d + 0.0, 0.0 - e, 0.0 - f, y + 0.0),
        *(g + 0.0, 0.0 - h, 0.0 - i, z + 0.0),
        *(0.0, 0.0, 0.0, 1.0),
    )
    return np.ndarray((4, 4), np.float64, bytearray(pack("16d", *numbers)))
