"""The tree as a draw list: hidden subtrees dropped, world matrices multiplied out, labels attached.

A tree changes little between two pictures. ``Flattener`` keeps, for every node that was drawn, what it made of it, and
works only where a node or a world matrix is another object than before. Matrices are multiplied per level of the tree
in one numpy call, since a call per node would cost more than all the arithmetic.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.geometry import Part
from gateway.scene.labels import LabelTable
from gateway.scene.live import Snapshot
from gateway.scene.meshing import meshes_of
from gateway.scene.transforms import IDENTITY, Matrix, from_poses
from gateway.scene.tree import Node, Path, PathElement
from renderers.drawlist import LABEL_NONE, DrawList, Image, Instance, Material, Mesh
from renderers.stop import check_stop

DRAWABLE: Final = 1e15
"""Metres. An instance with a larger (or non-finite) number in its world matrix is left out: float32 vertices would
overflow in the renderer, and nobody can see a thing of light-weeks."""
_REMEMBERED_DEPTH: Final = 8
"""Down to this depth the finished instances of whole subtrees are remembered; deeper, each node's own only. Otherwise
a chain of N nodes would keep N * N / 2 references."""

LabelOf = Callable[[Path, Part], int]


class _Entry:
    """What was made of one node."""

    __slots__ = (
        "children",
        "local",
        "meshes",
        "node",
        "own",
        "path",
        "stale",
        "start",
        "subtree",
        "world",
    )

    def __init__(self, path: Path) -> None:
        self.path = path
        self.node: Node | None = None
        self.world: Matrix = IDENTITY
        self.children: dict[PathElement, _Entry] = {}
        self.meshes: list[tuple[Mesh, Material, int]] = []
        """With the label."""
        self.local: NDArray[np.float64] | None = None
        """(len(meshes), 4, 4): X_node_mesh; None without meshes."""
        self.own: list[Instance] = []
        self.start = 0
        """Index of the first of ``own`` in the draw list."""
        self.subtree: list[Instance] | None = None
        """All instances of the subtree as last listed, or None."""
        self.stale = True
        """Whether something of this subtree is not in ``subtree`` yet."""


def flatten(root: Node, *, label_of: LabelOf | None = None) -> DrawList:
    """The draw list of a tree, once.

    Args:
        label_of: the label of a part at a path; None: nothing is labelled.
    """
    return _Flat(label_of or _unlabelled).flatten(root)


def _unlabelled(_path: Path, _part: Part) -> int:
    return LABEL_NONE


class Flattener:
    """Draw lists of a changing tree, with a label per path. Thread-safe.

    ``instances[i].instance_id`` is i, and its label leads to the path (``LabelTable.path_of``). What did not change
    since the last call is the very same ``Instance`` object as before; an unchanged root gives the same ``DrawList``.
    """

    def __init__(self, labels: LabelTable) -> None:
        self._flat = _Flat(lambda path, _part: labels.label_of(path))
        self._lock = threading.Lock()

    def flatten(self, snapshot: Snapshot) -> DrawList:
        """The draw list of a snapshot of the live tree."""
        with self._lock:
            return self._flat.flatten(snapshot.root)


class _Flat:
    def __init__(self, label_of: LabelOf) -> None:
        self._label_of = label_of
        self._tree: Node | None = None
        """What ``_drawn`` was made of."""
        self._root = _Entry(())
        self._drawn = DrawList()
        self._remeshed = False
        """Whether the set of materials may have changed in this call."""

    def flatten(self, root: Node) -> DrawList:
        if self._tree is root:
            return self._drawn
        self._tree = None
        self._remeshed = False
        try:
            moved = self._update_worlds(root if root.visible else Node())
            self._place(moved)
            instances = self._list()
        except BaseException:
            # Half-updated entries would be taken for finished ones by the next call.
            self._root = _Entry(())
            raise
        images = images_of(i.material for i in instances) if self._remeshed else self._drawn.images
        self._drawn = DrawList(tuple(instances), images)
        self._tree = root
        return self._drawn

    def _update_worlds(self, root: Node) -> list[_Entry]:
        """Brings entries up to date with the tree, level by level; returns those whose instances must be made anew."""
        moved_all: list[_Entry] = []
        # (entry, node, entry of the parent, whether the parent's world matrix is new)
        level: list[tuple[_Entry, Node, Matrix, bool]] = [(self._root, root, IDENTITY, False)]
        while level:
            moved: list[_Entry] = []
            parents: list[Matrix] = []
            current: list[tuple[_Entry, Node, bool]] = []
            for entry, node, parent_world, parent_moved in level:
                before = entry.node
                entry.stale = True
                entry.node = node
                remade = node.parts is not (None if before is None else before.parts)
                if remade:
                    self._remesh(entry, node.parts or ())
                is_moved = parent_moved or before is None or not before.same_transform(node)
                if is_moved:
                    moved.append(entry)
                    parents.append(parent_world)
                elif remade:
                    moved_all.append(entry)
                if node.children or entry.children:
                    current.append((entry, node, is_moved))
            if moved:
                matrices = _local_matrices([e.node for e in moved if e.node is not None])
                with np.errstate(all="ignore"):
                    worlds = np.matmul(np.array(parents), matrices)
                for entry, world in zip(moved, worlds, strict=True):
                    entry.world = world
                moved_all.extend(moved)
            level = []
            for entry, node, is_moved in current:
                self._descend(entry, node, is_moved, level)
        return moved_all

    def _remesh(self, entry: _Entry, parts: tuple[Part, ...]) -> None:
        """Makes the meshes of a node again."""
        self._remeshed = True
        entry.meshes = []
        locals_: list[Matrix] = []
        for part in parts:
            check_stop()
            label = self._label_of(entry.path, part)
            for mesh, material, X_part_mesh in meshes_of(part.shape, part.material):
                entry.meshes.append((mesh, material, label))
                locals_.append(X_part_mesh if part.X_node_part is IDENTITY else part.X_node_part @ X_part_mesh)
        entry.local = np.array(locals_) if locals_ else None

    def _descend(
        self, entry: _Entry, node: Node, is_moved: bool, level: list[tuple[_Entry, Node, Matrix, bool]]
    ) -> None:
        """Puts the children that need work on the next level and forgets those that are gone."""
        known = entry.children
        drawn = {name: child for name, child in node.children.items() if child.visible and child.geometry_count}
        if list(known) != list(drawn):
            self._remeshed = True
            known = {name: known.get(name) or _Entry((*entry.path, name)) for name in drawn}
            entry.children = known
        for child_entry, child in zip(known.values(), drawn.values(), strict=True):
            if is_moved or child_entry.node is not child:
                level.append((child_entry, child, entry.world, is_moved))

    def _place(self, entries: list[_Entry]) -> None:
        """Makes the instances of these entries from their world matrices."""
        for entry in entries:
            if entry.local is None:
                entry.own = []
        filled = [entry for entry in entries if entry.local is not None]
        if not filled:
            return
        locals_ = [entry.local for entry in filled if entry.local is not None]
        counts = [len(local) for local in locals_]
        worlds = np.repeat(np.array([entry.world for entry in filled]), counts, axis=0)
        with np.errstate(all="ignore"):
            placed = np.matmul(worlds, np.concatenate(locals_))
            drawable = (np.abs(placed) < DRAWABLE).all(axis=(1, 2))
        all_drawable = bool(drawable.all())
        index = 0
        for entry in filled:
            own: list[Instance] = []
            number = entry.start
            for mesh, material, label in entry.meshes:
                if all_drawable or drawable[index]:
                    own.append(Instance(mesh, material, placed[index], label, number))
                    number += 1
                index += 1
            if len(own) != len(entry.own):
                self._remeshed = True
            entry.own = own

    def _list(self) -> list[Instance]:
        """All instances in order of the tree, numbered; unchanged subtrees at an unchanged place are copied whole."""
        out: list[Instance] = []
        stack: list[tuple[_Entry, bool]] = [(self._root, False)]
        while stack:
            entry, done = stack.pop()
            if done:
                entry.subtree = out[entry.start :]
                continue
            start = len(out)
            if not entry.stale and entry.subtree is not None and entry.start == start:
                out.extend(entry.subtree)
                continue
            own = entry.own
            if own and own[0].instance_id != start:
                own = entry.own = [
                    Instance(i.mesh, i.material, i.X_world_mesh, i.label, start + k) for k, i in enumerate(own)
                ]
            entry.start, entry.stale, entry.subtree = start, False, None
            out.extend(own)
            if entry.children:
                if len(entry.path) < _REMEMBERED_DEPTH:
                    stack.append((entry, True))
                stack.extend((child, False) for child in reversed(entry.children.values()))
            else:
                entry.subtree = own
        return out


def _local_matrices(nodes: list[Node]) -> NDArray[np.float64]:
    """(N, 4, 4) X_parent_node. Poses whose matrix was never asked for are converted together, without keeping it."""
    posed = [index for index, node in enumerate(nodes) if node.pose is not None]
    if len(posed) < 8:
        return np.array([node.matrix for node in nodes])
    matrices = from_poses(np.array([nodes[index].pose for index in posed], dtype=np.float64))
    if len(posed) == len(nodes):
        return matrices
    both = np.empty((len(nodes), 4, 4))
    both[posed] = matrices
    rest = [index for index, node in enumerate(nodes) if node.pose is None]
    both[rest] = np.array([nodes[index].matrix for index in rest])
    return both


def images_of(materials: Iterable[Material]) -> tuple[Image, ...]:
    """The images of all materials, each once, in order of first use."""
    images: dict[Image, None] = {}
    seen: set[int] = set()
    for material in materials:
        if id(material) in seen:
            continue
        seen.add(id(material))
        for texture in (
            material.base_color_texture,
            material.metallic_roughness_texture,
            material.normal_texture,
            material.occlusion_texture,
            material.emissive_texture,
        ):
            if texture is not None:
                images[texture.image] = None
    return tuple(images)
