"""What the encoder knows of the tree: every node by number, and which of them each step has changed.

The usual step moves nodes and leaves the structure alone. It is found by walking the new tree beside the mirror of the
last one, and told by numbers alone: no path is made, nothing is hashed.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import islice
from typing import Final

from gateway.scene.live import Snapshot
from gateway.scene.tree import Node, Path, PathElement

KEPT_STEPS: Final = 32
"""Steps remembered for browsers that skip some; half a second at 60 Hz."""


_NOTHING: Final = Node()


class _Mirror:
    """A node as it was at the last step."""

    __slots__ = ("children", "node", "number")

    def __init__(self, number: int, node: Node) -> None:
        self.number = number
        self.node = node
        self.children: dict[PathElement, _Mirror] = {}


@dataclass(frozen=True, slots=True)
class Step:
    """From one revision to the next one that was looked at."""

    before: int
    """The revision that it starts from."""
    posed: list[int]
    """Numbers of nodes with another transform."""
    reshaped: list[int]
    """Numbers of nodes with other geometry."""
    shown: list[int]
    """Numbers of nodes with another visibility."""
    structural: bool = False
    """Whether nodes came or went; the numbers do not tell all then."""


class Mirror:
    """A path keeps its number after its node is gone: a browser that skipped steps may still have it."""

    def __init__(self, root: Node) -> None:
        self._ids: dict[Path, int] = {(): 0}
        self._paths: list[Path] = [()]
        self.nodes: list[Node] = [root]
        """By number: the node as it is; an empty one where none is any more."""
        self._root = _Mirror(0, root)
        self._steps: deque[Step] = deque(maxlen=KEPT_STEPS)
        self._grow(self._root)

    def __len__(self) -> int:
        return len(self._ids)

    def id_of(self, path: Path) -> int | None:
        """The number of a path, or None when no node was ever there."""
        return self._ids.get(path)

    def follow(self, before: int, snapshot: Snapshot) -> None:
        """Takes a newer state in; ``before`` is the revision of the one that it had."""
        nodes = self.nodes
        posed: list[int] = []
        reshaped: list[int] = []
        shown: list[int] = []
        unlike: list[_Mirror] = []
        stack = [(self._root, snapshot.root)]
        while stack:
            mirror, node = stack.pop()
            old = mirror.node
            if old is node:
                continue
            number = mirror.number
            mirror.node = nodes[number] = node
            if not node.same_transform(old):
                posed.append(number)
            if old.parts is not node.parts:
                reshaped.append(number)
            if old.visible != node.visible:
                shown.append(number)
            children, mirrored = node.children, mirror.children
            same = len(children) == len(mirrored)
            for name, child in children.items():
                known = mirrored.get(name)
                if known is None:
                    same = False
                elif known.node is not child:
                    stack.append((known, child))
            if not same:
                unlike.append(mirror)
        for mirror in unlike:
            self._prune(mirror)
        for mirror in unlike:
            self._grow(mirror)
        self._steps.append(Step(before, posed, reshaped, shown, bool(unlike)))

    def since(self, revision: int) -> Step | None:
        """What happened since a revision, all steps in one; None: nodes came or went, or it is too long ago."""
        wanted = [i for i, step in enumerate(self._steps) if step.before == revision]
        if not wanted:
            return None
        steps = list(islice(self._steps, wanted[0], None))
        if any(step.structural for step in steps):
            return None
        if len(steps) == 1:
            return steps[0]
        return Step(
            revision,
            list(dict.fromkeys(number for step in steps for number in step.posed)),
            list(dict.fromkeys(number for step in steps for number in step.reshaped)),
            list(dict.fromkeys(number for step in steps for number in step.shown)),
        )

    def _prune(self, mirror: _Mirror) -> None:
        """Lets go of children that are not there any more, so that nothing keeps their geometry."""
        gone = [name for name in mirror.children if name not in mirror.node.children]
        stack = [mirror.children.pop(name) for name in gone]
        while stack:
            lost = stack.pop()
            self.nodes[lost.number] = _NOTHING
            stack.extend(lost.children.values())

    def _grow(self, mirror: _Mirror) -> None:
        """Mirrors and numbers its new children, and all that is below those."""
        stack = [mirror]
        while stack:
            parent = stack.pop()
            at, mirrored = self._paths[parent.number], parent.children
            for name, node in parent.node.children.items():
                if name not in mirrored:
                    child = mirrored[name] = self._enter(node, (*at, name))
                    if node.children:
                        stack.append(child)

    def _enter(self, node: Node, path: Path) -> _Mirror:
        number = self._ids.setdefault(path, len(self._ids))
        if number == len(self.nodes):
            self.nodes.append(node)
            self._paths.append(path)
        else:
            self.nodes[number] = node
        return _Mirror(number, node)
