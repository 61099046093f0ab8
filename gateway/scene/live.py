"""The live tree that all interfaces share. It counts revisions and notifies listeners of changes."""

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
    """Number of edits so far that changed the tree; 0 for the empty tree at start."""


class LiveTree:
    """A tree that is edited under a lock. Reading a snapshot takes no lock."""

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
        """Edit the tree in a ``with`` block. Its edits become one revision, unless the block raises an exception.

        Listeners are called before the lock is released, in the order of the revisions.
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
        """Call ``listener`` with every new snapshot, in the thread that edits. It must not block, nor edit the tree.

        A listener that keeps a snapshot can get its differences from any later one with ``tree.changes``.

        Returns:
            Function that removes the listener.
        """
        self._listeners.append(listener)

        def stop() -> None:
            if listener in self._listeners:
                self._listeners.remove(listener)

        return stop
