"""Merge two edits of the same tree."""

from __future__ import annotations

from typing import Final

from gateway.scene.tree import Node

_EMPTY: Final = Node()
"""Stands for a node that does not exist."""


def merged(base: Node, ours: Node, theirs: Node) -> Node:
    """Return the tree with the differences from ``base`` to ``theirs`` and those from ``base`` to ``ours``.

    Where both changed the same property of a node, ours is kept. All three trees are committed. The time depends on the
    number of nodes that both changed, and of their children.
    """
    if theirs is base:
        return ours
    if ours is base:
        return theirs
    node = theirs.copy(None)
    if ours.parts is not base.parts:
        node.parts = ours.parts
    if not ours.same_transform(base):
        if ours.pose is not None:
            node.set_pose(ours.pose)
        else:
            node.set_matrix(ours.matrix)
    if ours.visible != base.visible:
        node.visible = ours.visible
    if ours.opacity != base.opacity:
        node.opacity = ours.opacity
    for name in base.children.keys() - ours.children.keys():
        node.children.pop(name, None)
    for name, child in ours.children.items():
        before = base.children.get(name, _EMPTY)
        if child is not before:
            node.children[name] = merged(before, child, theirs.children.get(name, _EMPTY))
    node.nodes_with_parts = (node.parts is not None) + sum(each.nodes_with_parts for each in node.children.values())
    node.node_count = 1 + sum(each.node_count for each in node.children.values())
    return node
