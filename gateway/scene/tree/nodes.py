"""The scene as a persistent tree. Committed nodes are immutable; an edit copies only the nodes on edited paths.

A committed root is a consistent snapshot, which readers may keep without blocking writers. Two snapshots share every
subtree that did not change, so the time to compare them (``changes``) depends only on the number of changes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.scene.tree.geometry import Part
from gateway.scene.tree.transforms import IDENTITY, from_pose
from scenegate.messages.changes import Path as Path

NODE_BYTES: Final = 400
"""Memory of a node without its children."""
CHILD_BYTES: Final = 40
"""Memory of a reference to a child."""
MAX_COUNTED_NODES: Final = 100
"""Maximum number of nodes of a removed subtree whose arrays are counted."""
UNKNOWN_BYTES: Final = 1 << 40
"""``TreeEdit.replaced_bytes`` of a larger subtree."""
_MAX_INT: Final = (1 << 63) - 1
"""Maximum absolute value of an integer that is written as a number."""

PathElement = str | int
"""Name of a node below its parent. "a/b" is one name; 1 and "1" are different names."""
Pose = tuple[float, float, float, float, float, float, float]
"""(x, y, z, qw, qx, qy, qz): translation in metres, and a quaternion of any length."""


class Node:
    """A frame of the tree with its geometry and children. Only the ``TreeEdit`` that owns a node may change it."""

    __slots__ = (
        "__weakref__",
        "_matrix",
        "children",
        "node_count",
        "nodes_with_parts",
        "opacity",
        "owner",
        "parts",
        "pose",
        "visible",
    )

    children: dict[PathElement, Node]
    """Children by path element, in order of creation."""
    parts: tuple[Part, ...] | None
    """The geometry; None if it was never set. An empty tuple draws nothing, but counts as geometry."""
    nodes_with_parts: int
    """Number of nodes with ``parts is not None`` in this subtree, this node included."""
    node_count: int
    """Number of nodes of this subtree, this node included."""
    visible: bool
    """False hides the whole subtree in images."""
    opacity: float
    """Factor, 0 to 1, of the alpha of the whole subtree."""
    pose: Pose | None
    """The pose as the client sent it; None if the transform was given as a matrix. ``set_pose`` replaces it."""
    owner: object | None
    """Token of the ``TreeEdit`` that created or copied the node; any other edit must copy the node first."""

    def __init__(
        self,
        parts: tuple[Part, ...] | None = None,
        matrix: NDArray[np.float64] = IDENTITY,
        children: dict[PathElement, Node] | None = None,
    ) -> None:
        self.parts = parts
        self.children = {} if children is None else children
        self.visible = True
        self.opacity = 1.0
        self.nodes_with_parts = (parts is not None) + sum(c.nodes_with_parts for c in self.children.values())
        self.node_count = 1 + sum(c.node_count for c in self.children.values())
        self._matrix: NDArray[np.float64] | None = matrix
        self.pose = None
        self.owner = None

    @property
    def matrix(self) -> NDArray[np.float64]:
        """X_parent_node, (4, 4) float64, affine: from this node's frame to its parent's. It must not be written to.

        It is computed from the pose at first use.
        """
        if self._matrix is None:
            assert self.pose is not None
            self._matrix = from_pose(self.pose[:3], self.pose[3:])
        return self._matrix

    def set_matrix(self, matrix: NDArray[np.float64]) -> None:
        """Replace the transform. Only the owner may call this."""
        self._matrix, self.pose = matrix, None

    def set_pose(self, pose: Pose) -> None:
        """Replace the transform. Only the owner may call this."""
        self._matrix, self.pose = None, pose

    def same_transform(self, other: Node) -> bool:
        """Return True if both nodes share one transform object. Equal transforms of two edits count as different."""
        return self._matrix is other._matrix if self.pose is None else self.pose is other.pose

    def find(self, path: Path) -> Node | None:
        """Return the node at a path relative to this node; None if there is none."""
        node: Node | None = self
        for element in path:
            node = node.children.get(element) if node is not None else None
            if node is None:
                return None
        return node

    def world_matrix(self, path: Path) -> NDArray[np.float64] | None:
        """Return the product of the transforms from this node to the node at ``path``, both included.

        This is X_world_node, (4, 4), if this node is the root, else relative to its parent; None without such a node.
        """
        node = self
        with np.errstate(all="ignore"):
            matrix = node.matrix
            for element in path:
                child = node.children.get(element)
                if child is None:
                    return None
                node = child
                matrix = matrix @ node.matrix
        return matrix

    def walk(self, prefix: Path = ()) -> Iterator[tuple[Path, Node]]:
        """Iterate over this node and its descendants with their paths, parents first. ``prefix``: path of this node."""
        stack = [(prefix, self)]
        while stack:
            path, node = stack.pop()
            yield path, node
            stack.extend(((*path, name), child) for name, child in reversed(node.children.items()))

    def copy(self, owner: object) -> Node:
        """Return a shallow copy that ``owner`` may change."""
        node = Node.__new__(Node)
        node.parts = self.parts
        node.children = self.children.copy() if self.children else {}
        node.visible = self.visible
        node.opacity = self.opacity
        node.nodes_with_parts = self.nodes_with_parts
        node.node_count = self.node_count
        node._matrix, node.pose = self._matrix, self.pose  # noqa: SLF001 - of its own class
        node.owner = owner
        return node


class TreeEdit:
    """A batch of edits of one tree. Each node on an edited path is copied at most once. ``commit`` ends the batch."""

    __slots__ = ("_owner", "base", "changed", "replaced_bytes", "root")

    def __init__(self, root: Node) -> None:
        self._owner: object | None = object()
        self.root = root
        """The tree in its current state."""
        self.base = root
        """The tree before the first edit; the result after ``commit``."""
        self.changed = False
        """True after the first edit."""
        self.replaced_bytes = 0
        """Estimate of the bytes that only the tree before this edit needs."""

    def set_parts(self, path: Path, parts: tuple[Part, ...]) -> None:
        """Replace the geometry of the node at ``path``, creating nodes as needed."""
        nodes = self._own(path)
        leaf = nodes[-1]
        if leaf.parts is None:
            for node in nodes:
                node.nodes_with_parts += 1
        else:
            self.replaced_bytes += sum(part.array_bytes for part in leaf.parts)
        leaf.parts = parts

    def set_matrix(self, path: Path, matrix: NDArray[np.float64]) -> None:
        """Replace the transform at ``path``, creating nodes as needed. ``matrix`` is not copied."""
        self._own(path)[-1].set_matrix(matrix)

    def set_pose(self, path: Path, pose: Pose) -> Node:
        """Replace the transform at ``path``, creating nodes; return the node. Its matrix is made at first use."""
        leaf = self._own(path)[-1]
        leaf.set_pose(pose)
        return leaf

    def set_poses(self, paths: Sequence[Path], poses: Iterable[Pose]) -> list[Node]:
        """Replace many transforms, but not the root's, creating nodes as needed, and return the nodes.

        Siblings in sequence take two thirds of the time of ``set_pose``.
        """
        nodes: list[Node] = []
        owner, parent_path, siblings = self._owner, None, {}
        for path, pose in zip(paths, poses, strict=True):
            name = path[-1]
            if path[:-1] != parent_path:
                parent_path = path[:-1]
                siblings = self._own(parent_path)[-1].children
            node = siblings.get(name)
            if node is None:
                node = self._own(path)[-1]
            elif node.owner is not owner:
                node = siblings[name] = self._copy(node)
            node.set_pose(pose)
            nodes.append(node)
        return nodes

    def set_visible(self, path: Path, visible: bool) -> None:
        """Hide or show the subtree at ``path``, creating nodes as needed."""
        self._own(path)[-1].visible = visible

    def set_opacity(self, path: Path, opacity: float) -> None:
        """Set the factor, 0 to 1, of the alpha of the subtree at ``path``, creating nodes as needed."""
        self._own(path)[-1].opacity = opacity

    def delete(self, path: Path) -> bool:
        """Remove the node at ``path`` and its descendants. The root is replaced by an empty node.

        Returns True if there was such a node (for the root: if it had parts or children).
        """
        target = self.root.find(path)
        if target is None:
            return False
        self.set_subtree(path, None)
        return bool(path) or bool(target.children) or target.parts is not None

    def set_subtree(self, path: Path, node: Node | None) -> None:
        """Replace the subtree at ``path`` by a committed tree with its own transform; None: remove it."""
        parents = self._own(path[:-1])
        if not path:
            self._count_replaced(self.root)
            self.root = node or Node()
            return
        name = path[-1]
        children = parents[-1].children
        old = children.get(name)
        self._count_replaced(old)
        if node is None:
            del children[name]
        else:
            children[name] = node
        more_nodes, more_with_parts = 0, 0
        for subtree, sign in ((old, -1), (node, 1)):
            if subtree is not None:
                more_nodes += sign * subtree.node_count
                more_with_parts += sign * subtree.nodes_with_parts
        for parent in parents:
            parent.node_count += more_nodes
            parent.nodes_with_parts += more_with_parts

    def commit(self) -> Node:
        """Return the root of the edited tree, which is immutable from now on. Further edits raise RuntimeError."""
        self._owner, self.base = None, self.root  # an edit keeps no old tree alive
        return self.root

    def _count_replaced(self, subtree: Node | None) -> None:
        if subtree is None:
            return
        if subtree.node_count > MAX_COUNTED_NODES:
            self.replaced_bytes += UNKNOWN_BYTES
            return
        for _, node in subtree.walk():
            self.replaced_bytes += NODE_BYTES + sum(part.array_bytes for part in node.parts or ())

    def _copy(self, node: Node) -> Node:
        """Return a copy of a node that this edit may change."""
        self.replaced_bytes += NODE_BYTES + CHILD_BYTES * len(node.children)
        return node.copy(self._owner)

    def _own(self, path: Path) -> list[Node]:
        """Return the nodes from the root to ``path``, copied or created as needed, so that this edit owns them."""
        owner = self._owner
        if owner is None:
            raise RuntimeError("this edit was committed")
        self.changed = True
        node = self.root
        if node.owner is not owner:
            node = self.root = self._copy(node)
        nodes = [node]
        created = 0
        for element in path:
            child = node.children.get(element)
            if child is None:
                child = Node()
                child.owner = owner
                node.children[element] = child
                created += 1
            elif child.owner is not owner:
                child = self._copy(child)
                node.children[element] = child
            nodes.append(child)
            node = child
        if created:  # the created nodes are the last ones of the path
            for descendant_count, owned in enumerate(reversed(nodes)):
                owned.node_count += min(descendant_count, created)
        return nodes


class Change(NamedTuple):
    """One difference between two trees."""

    kind: Literal["added", "removed", "reordered", "geometry", "transform", "visible", "opacity"]
    """``added``: the node is new; further changes add its children. ``removed``: the node and its descendants were
    removed. ``reordered``: the node's position among its siblings changed. Otherwise, the property that changed."""
    path: Path
    node: Node | None
    """The new state of the node; None if it was removed."""


def changes(old: Node, new: Node) -> Iterator[Change]:
    """Yield the differences from ``old`` to ``new``: parents before children, siblings in their order.

    Subtrees that both trees share are skipped, so the time depends on the number of changes, not of nodes.
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
        if before.opacity != after.opacity:
            yield Change("opacity", path, after)
        previous = before.children
        if not previous and not after.children:
            continue
        for name in previous:
            if name not in after.children:
                yield Change("removed", (*path, name), None)
        reordered_names = _reordered_names(previous, after.children)
        for name, child in reversed(after.children.items()):
            earlier = previous.get(name)
            if earlier is not child or name in reordered_names:
                stack.append(((*path, name), earlier, child, name in reordered_names))


def _reordered_names(before: Mapping[PathElement, Node], after: Mapping[PathElement, Node]) -> frozenset[PathElement]:
    """Return the names of children that both nodes have, starting at the first one whose order differs."""
    new_order = list(after)
    old_order = [name for name in before if name in after]
    if new_order[: len(old_order)] == old_order:
        return frozenset()
    first_change = 0
    while new_order[first_change] == old_order[first_change]:
        first_change += 1
    return frozenset(name for name in new_order[first_change:] if name in before)


def json_element(element: PathElement) -> PathElement:
    """Return a path element that JSON can express: unpaired surrogates escaped, huge integers as hexadecimal text."""
    if isinstance(element, int):
        return element if -_MAX_INT <= element <= _MAX_INT else hex(element)
    if element.isascii():
        return element
    return element.encode("utf-8", "backslashreplace").decode("utf-8")
