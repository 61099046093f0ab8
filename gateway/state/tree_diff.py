"""What turned one committed tree into another, as rows of the database."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

from gateway.scene.tree import Node, PathElement
from gateway.state.keys import element_key

_Pair = tuple[bytes, "Node | None", Node]


@dataclass(slots=True)
class Difference:
    """Rows to write, by key. As ``scene.tree.changes``, and with the order of siblings."""

    seq: int
    """The last number given to a node; higher ones are given here."""
    removed: list[bytes] = field(default_factory=list)
    """With all below; written first."""
    added: list[tuple[bytes, int, Node]] = field(default_factory=list)
    """With their ``seq``; those below follow as entries of their own."""
    moved: list[tuple[bytes, int]] = field(default_factory=list)
    """Siblings that come later than before, with their new ``seq``."""
    geometry: list[tuple[bytes, Node]] = field(default_factory=list)
    transforms: list[tuple[bytes, Node]] = field(default_factory=list)
    visible: list[tuple[bytes, Node]] = field(default_factory=list)

    def __bool__(self) -> bool:
        return bool(self.removed or self.added or self.moved or self.geometry or self.transforms or self.visible)


def compare(old: Node, new: Node, seq: int, without: Collection[PathElement] = ()) -> Difference:
    """Unchanged subtrees are skipped by identity, so that this costs what changed.

    Args:
        seq: the highest number that any node has.
        without: children of the root that do not count.
    """
    found = Difference(seq)
    stack: list[_Pair] = [(b"", old, new)] if old is not new else []
    while stack:
        key, before, after = stack.pop()
        if before is None:
            for name, child in after.children.items():
                _add(found, stack, key + element_key(name), child)
            continue
        if before.parts is not after.parts:
            found.geometry.append((key, after))
        if not before.same_transform(after):
            found.transforms.append((key, after))
        if before.visible != after.visible:
            found.visible.append((key, after))
        if after.children or before.children:
            _compare_children(found, stack, key, before, after, without if not key else ())
    return found


def _compare_children(
    found: Difference, stack: list[_Pair], key: bytes, before: Node, after: Node, without: Collection[PathElement]
) -> None:
    names, previous = list(after.children), list(before.children)
    if names == previous and not without:  # by far the most frequent: poses changed
        pairs = zip(names, before.children.values(), after.children.values(), strict=True)
        stack.extend([(key + element_key(name), old, new) for name, old, new in pairs if old is not new])
        return
    if without:
        names = [name for name in names if name not in without]
        previous = [name for name in previous if name not in without]
    found.removed.extend(key + element_key(name) for name in previous if name not in after.children)
    kept = [name for name in previous if name in after.children]
    in_place = 0
    while in_place < len(kept) and names[in_place] == kept[in_place]:
        in_place += 1
    for index, name in enumerate(names):
        child, known = after.children[name], before.children.get(name)
        below = key + element_key(name)
        if known is None:
            _add(found, stack, below, child)
            continue
        if index >= in_place:
            found.seq += 1
            found.moved.append((below, found.seq))
        if known is not child:
            stack.append((below, known, child))


def _add(found: Difference, stack: list[_Pair], key: bytes, node: Node) -> None:
    found.seq += 1
    found.added.append((key, found.seq, node))
    if node.children:
        stack.append((key, None, node))
