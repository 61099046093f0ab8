"""The tree as a draw list: instances with world matrices and labels, without hidden subtrees.

A tree changes little between two images. ``Flattener`` keeps the instances of every node and updates those of nodes and
world matrices that are other objects than before. Matrices are multiplied per level of the tree in one NumPy call,
since a call per node would cost more than the arithmetic.
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
"""Metres. An instance with a larger (or non-finite) number in its world matrix is left out: its float32 vertices would
overflow in the renderer."""
_MAX_CACHED_DEPTH: Final = 8
"""Depth down to which the instances of whole subtrees are kept; deeper, only those of each node. Otherwise a chain of N
nodes would keep N * N / 2 references."""

LabelOf = Callable[[Path, Part], int]
"""Return the label of a part at a path."""


class _Entry:
    """The instances of one node."""

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
        """Meshes of the node's parts, with their labels."""
        self.local: NDArray[np.float64] | None = None
        """X_node_mesh, (len(meshes), 4, 4); None without meshes."""
        self.own: list[Instance] = []
        """Instances of the node itself."""
        self.start = 0
        """Index of the first of them in the draw list."""
        self.subtree: list[Instance] | None = None
        """All instances of the subtree in the last draw list; None where they are not kept."""
        self.stale = True
        """True if ``subtree`` is out of date."""


def flatten(root: Node, *, label_of: LabelOf | None = None) -> DrawList:
    """Return the draw list of a tree.

    Args:
        label_of: None: all labels are ``LABEL_NONE``.
    """
    return _TreeFlattener(label_of or _unlabelled).flatten(root)


def _unlabelled(_path: Path, _part: Part) -> int:
    return LABEL_NONE


class Flattener:
    """Draw lists of a changing tree, with a label per path. Thread-safe.

    ``instances[i].instance_id`` is i; ``LabelTable.path_of`` returns the path of its label. Instances that did not
    change since the last call are the same objects; an unchanged root returns the same ``DrawList``.
    """

    def __init__(self, labels: LabelTable) -> None:
        self._flattener = _TreeFlattener(lambda path, _part: labels.label_of(path))
        self._lock = threading.Lock()

    def flatten(self, snapshot: Snapshot) -> DrawList:
        """Return the draw list of a snapshot of the live tree."""
        with self._lock:
            return self._flattener.flatten(snapshot.root)


class _TreeFlattener:
    def __init__(self, label_of: LabelOf) -> None:
        self._label_of = label_of
        self._tree: Node | None = None
        """Root of ``_drawn``; None after an error."""
        self._root = _Entry(())
        self._drawn = DrawList()
        self._materials_changed = False
        """True if this call may have changed the set of materials."""

    def flatten(self, root: Node) -> DrawList:
        if self._tree is root:
            return self._drawn
        self._tree = None
        self._materials_changed = False
        try:
            moved = self._update_entries(root if root.visible else Node())
            self._make_instances(moved)
            instances = self._list()
        except BaseException:
            # The next call must not take half-updated entries for finished ones.
            self._root = _Entry(())
            raise
        images = images_of(i.material for i in instances) if self._materials_changed else self._drawn.images
        self._drawn = DrawList(tuple(instances), images)
        self._tree = root
        return self._drawn

    def _update_entries(self, root: Node) -> list[_Entry]:
        """Update entries and world matrices level by level; return the entries whose instances are out of date."""
        moved_all: list[_Entry] = []
        # (entry, node, the parent's world matrix, True if that has changed)
        level: list[tuple[_Entry, Node, Matrix, bool]] = [(self._root, root, IDENTITY, False)]
        while level:
            moved: list[_Entry] = []
            parents: list[Matrix] = []
            current: list[tuple[_Entry, Node, bool]] = []
            for entry, node, parent_world, parent_moved in level:
                before = entry.node
                entry.stale = True
                entry.node = node
                parts_changed = node.parts is not (None if before is None else before.parts)
                if parts_changed:
                    self._update_meshes(entry, node.parts or ())
                is_moved = parent_moved or before is None or not before.same_transform(node)
                if is_moved:
                    moved.append(entry)
                    parents.append(parent_world)
                elif parts_changed:
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

    def _update_meshes(self, entry: _Entry, parts: tuple[Part, ...]) -> None:
        """Update the meshes of a node."""
        self._materials_changed = True
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
        """Append the children to update to the next level, and drop the entries of removed ones."""
        known = entry.children
        drawn = {name: child for name, child in node.children.items() if child.visible and child.geometry_count}
        if list(known) != list(drawn):
            self._materials_changed = True
            known = {name: known.get(name) or _Entry((*entry.path, name)) for name in drawn}
            entry.children = known
        for child_entry, child in zip(known.values(), drawn.values(), strict=True):
            if is_moved or child_entry.node is not child:
                level.append((child_entry, child, entry.world, is_moved))

    def _make_instances(self, entries: list[_Entry]) -> None:
        """Create the instances of entries from their world matrices."""
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
                self._materials_changed = True
            entry.own = own

    def _list(self) -> list[Instance]:
        """Return all instances in the order of the tree, numbered. Unchanged subtrees at the same index are copied."""
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
                if len(entry.path) < _MAX_CACHED_DEPTH:
                    stack.append((entry, True))
                stack.extend((child, False) for child in reversed(entry.children.values()))
            else:
                entry.subtree = own
        return out


def _local_matrices(nodes: list[Node]) -> NDArray[np.float64]:
    """Return X_parent_node of each node, (N, 4, 4). Poses without a matrix are converted together."""
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
    """Return the images of all materials, each once, in the order of first use."""
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
