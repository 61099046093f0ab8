"""The live tree that all interfaces share, with revisions and a feed of changes."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from gateway.scene.tree import Node, TreeEdit


@dataclass(frozen=True, slots=True)
class Snapshot:
    """A consistent state of the tree."""

    root: Node
    revision: int
    """Number of edits that changed something; 0 is the empty tree at start."""


class LiveTree:
    """A tree that is edited under a lock. Readers take no lock: a snapshot is one attribute read."""

    def __init__(self) -> None:
        self._snapshot = Snapshot(Node(), 0)
        self._lock = threading.Lock()
        self._listeners: list[Callable[[Snapshot], None]] = []

    @property
    def snapshot(self) -> Snapshot:
        """The latest committed state."""
        return self._snapshot

    @contextmanager
    def edit(self) -> Iterator[TreeEdit]:
        """Edit the tree in a ``with`` block, which is published as one revision unless it raises an exception.

        Listeners are called before the lock is released, in order of revision.
        """
        with self._lock:
            edit = TreeEdit(self._snapshot.root)
            yield edit
            changed = edit.changed
            root = edit.commit()
            if changed:
                self._snapshot = snapshot = Snapshot(root, self._snapshot.revision + 1)
                for listener in tuple(self._listeners):
                    listener(snapshot)

    def listen(self, listener: Callable[[Snapshot], None]) -> Callable[[], None]:
        """Call ``listener`` with every new snapshot, in the writer's thread. It must not block and not edit.

        A listener that keeps its last snapshot finds the differences with ``tree.changes``, however many revisions lie
        between. Returns a function that ends the subscription.
        """
        self._listeners.append(listener)

        def stop() -> None:
            if listener in self._listeners:
                self._listeners.remove(listener)

        return stop
