"""The scene as a persistent tree: nodes are immutable once committed, edits copy only what they touch.

A committed root *is* a consistent snapshot: readers keep it as long as they like and never block a writer. Two roots
share every node that did not change, so comparing them by identity (``changes``) costs what changed, not what exists.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.scene.geometry import Part
from gateway.scene.transforms import IDENTITY, from_pose

PathElement = str | int
Path = tuple[PathElement, ...]
"""From the root down; () is the root. "a/b" is one element; 1 and "1" are different elements."""

Pose = tuple[float, float, float, float, float, float, float]
"""(x, y, z, qw, qx, qy, qz)."""


class Node:
    """A frame of the tree with its geometry and children. Read-only for everybody but the edit that owns it."""

    __slots__ = (
        "__weakref__",
        "_matrix",
        "_owner",
        "_pose",
        "children",
        "geometry_count",
        "node_count",
        "parts",
        "visible",
    )

    children: dict[PathElement, Node]
    """By path element, in order of creation."""
    parts: tuple[Part, ...] | None
    """Geometry; () is geometry that draws nothing but counts as present; None: none was ever set."""
    geometry_count: int
    """How many nodes of this subtree, itself included, have ``parts is not None``."""
    node_count: int
    """How many nodes this subtree has, itself included."""
    visible: bool
    """False hides the whole subtree in pictures."""

    def __init__(
        self,
        parts: tuple[Part, ...] | None = None,
        matrix: NDArray[np.float64] = IDENTITY,
        children: dict[PathElement, Node] | None = None,
    ) -> None:
        self.parts = parts
        self.children = {} if children is None else children
        self.visible = True
        self.geometry_count = (parts is not None) + sum(c.geometry_count for c in self.children.values())
        self.node_count = 1 + sum(c.node_count for c in self.children.values())
        self._matrix: NDArray[np.float64] | None = matrix
        self._pose: Pose | None = None
        self._owner: object | None = None

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(4, 4) float64: X_parent_node, affine. Made from the pose on first use; do not write to it."""
        if self._matrix is None:
            assert self._pose is not None
            self._matrix = from_pose(self._pose[:3], self._pose[3:])
        return self._matrix

    @property
    def pose(self) -> Pose | None:
        """The pose as the client sent it, or None when the transform was given as a matrix."""
        return self._pose

    def same_transform(self, other: Node) -> bool:
        """Whether both have the transform of one and the same edit (identity, not value)."""
        return self._matrix is other._matrix if self._pose is None else self._pose is other._pose

    def find(self, path: Path) -> Node | None:
        """The node below this one, or None."""
        node: Node | None = self
        for element in path:
            node = node.children.get(element) if node is not None else None
            if node is None:
                return None
        return node

    def walk(self, prefix: Path = ()) -> Iterator[tuple[Path, Node]]:
        """This node and all below, parents first, without recursion."""
        stack = [(prefix, self)]
        while stack:
            path, node = stack.pop()
            yield path, node
            stack.extend(((*path, name), child) for name, child in reversed(node.children.items()))

    def _copy(self, owner: object) -> Node:
        node = Node.__new__(Node)
        node.parts = self.parts
        node.children = self.children.copy()
        node.visible = self.visible
        node.geometry_count = self.geometry_count
        node.node_count = self.node_count
        node._matrix = self._matrix
        node._pose = self._pose
        node._owner = owner
        return node


class TreeEdit:
    """A batch of edits of one tree: each touched node is copied at most once. ``commit`` ends it."""

    __slots__ = ("_owner", "_root", "changed", "created")

    def __init__(self, root: Node) -> None:
        self._owner: object | None = object()
        self._root = root
        self.changed = False
        """Whether anything was edited."""
        self.created = 0
        """How many nodes the paths of this edit brought into being, for callers that bound the tree."""

    @property
    def root(self) -> Node:
        """The tree as edited so far."""
        return self._root

    def set_parts(self, path: Path, parts: tuple[Part, ...]) -> None:
        """Replaces the geometry at ``path``, creating nodes as needed; transform and children stay."""
        nodes = self._own(path)
        leaf = nodes[-1]
        if leaf.parts is None:
            for node in nodes:
                node.geometry_count += 1
        leaf.parts = parts

    def set_matrix(self, path: Path, matrix: NDArray[np.float64]) -> None:
        """Replaces the transform at ``path``, creating nodes as needed; ``matrix`` is kept, not copied."""
        leaf = self._own(path)[-1]
        leaf._matrix, leaf._pose = matrix, None

    def set_pose(self, path: Path, pose: Pose) -> Node:
        """Replaces the transform at ``path``, creating nodes as needed; the matrix is made when it is first read.

        Returns the node as edited so far, for a look at what it carries.
        """
        leaf = self._own(path)[-1]
        leaf._matrix, leaf._pose = None, pose
        return leaf

    def set_visible(self, path: Path, visible: bool) -> None:
        """Hides or shows the subtree at ``path``, creating nodes as needed."""
        self._own(path)[-1].visible = visible

    def set_subtree(self, path: Path, node: Node) -> None:
        """Puts a whole committed tree at ``path`` in place of what was there; its own transform is kept."""
        if not path:
            self._claim()
            self._root = node
            return
        parents = self._own(path[:-1])
        old = parents[-1].children.get(path[-1])
        geometries, nodes = (old.geometry_count, old.node_count) if old is not None else (0, 0)
        parents[-1].children[path[-1]] = node
        for parent in parents:
            parent.geometry_count += node.geometry_count - geometries
            parent.node_count += node.node_count - nodes

    def delete(self, path: Path) -> bool:
        """Removes the node at ``path`` with geometry, transforms and all below it; the root is emptied instead.

        Returns whether there was such a node.
        """
        if not path:
            existed = bool(self._root.children) or self._root.parts is not None
            owner = self._claim()
            self._root = Node()
            self._root._owner = owner
            return existed
        target = self._root.find(path)
        if target is None:
            return False
        parents = self._own(path[:-1])
        del parents[-1].children[path[-1]]
        for parent in parents:
            parent.geometry_count -= target.geometry_count
            parent.node_count -= target.node_count
        return True

    def commit(self) -> Node:
        """The edited tree, immutable from now on. The edit must not be used afterwards."""
        self._owner = None
        return self._root

    def _claim(self) -> object:
        """The mark of nodes that this edit may write to."""
        if self._owner is None:
            raise RuntimeError("this edit was committed")
        self.changed = True
        return self._owner

    def _own(self, path: Path) -> list[Node]:
        """The nodes from the root to ``path``, all private to this edit."""
        owner = self._claim()
        node = self._root
        if node._owner is not owner:
            node = self._root = node._copy(owner)
        nodes = [node]
        before = self.created
        for element in path:
            child = node.children.get(element)
            if child is None:
                child = Node()
                child._owner = owner
                node.children[element] = child
                self.created += 1
            elif child._owner is not owner:
                child = child._copy(owner)
                node.children[element] = child
            nodes.append(child)
            node = child
        if self.created != before:  # the last ones of the path
            created = self.created - before
            for above, owned in enumerate(reversed(nodes)):
                owned.node_count += min(above, created)
        return nodes


class Change(NamedTuple):
    """One difference between two trees."""

    kind: Literal["added", "removed", "reordered", "geometry", "transform", "visible"]
    """``added``: the node is new; its children follow as changes of their own. ``removed``: the node and its subtree
    are gone. ``reordered``: the node follows other siblings than before."""
    path: Path
    node: Node | None
    """The new state of the node; None if removed."""


def changes(old: Node, new: Node) -> Iterator[Change]:
    """Yield the differences from ``old`` to ``new``: parents before children, siblings in their order.

    Subtrees that both trees share are skipped, so the cost depends on the number of changes, not of nodes.
    """
    stack: list[tuple[Path, Node | None, Node, bool]] = [((), old, new, False)]
    while stack:
        path, before, after, reordered = stack.pop()
        if before is None:
            yield Change("added", path, after)
            stack += [((*path, name), None, child, False) for name, child in reversed(after.children.items())]
            continue
        if reordered:
            yield Change("reordered", path, after)
        if before is after:
            continue
        if before.parts is not after.parts:
            yield Change("geometry", path, after)
        if not before.same_transform(after):
            yield Change("transform", path, after)
        if before.visible != after.visible:
            yield Change("visible", path, after)
        previous = before.children
        if not previous and not after.children:
            continue
        for name in previous:
            if name not in after.children:
                yield Change("removed", (*path, name), None)
        moved = _reordered(previous, after.children)
        for name, child in reversed(after.children.items()):
            earlier = previous.get(name)
            if earlier is not child or name in moved:
                stack.append(((*path, name), earlier, child, name in moved))


def _reordered(before: Mapping[PathElement, Node], after: Mapping[PathElement, Node]) -> frozenset[PathElement]:
    """Return the names in both mappings whose position after their siblings changed; new names come last as a rule."""
    names, kept = list(after), [name for name in before if name in after]
    if names[: len(kept)] == kept:
        return frozenset()
    same = 0
    while same < len(kept) and names[same] == kept[same]:
        same += 1
    return frozenset(name for name in names[same:] if name in before)
