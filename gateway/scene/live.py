"""The one live tree that all interfaces share, with revisions and a feed of changes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from types import TracebackType

from gateway.scene.tree import Node, TreeEdit


@dataclass(frozen=True, slots=True)
class Snapshot:
    """A consistent state of the tree."""

    root: Node
    revision: int
    """Grows by one with every edit that changed something; 0 is the empty tree at start."""


class LiveTree:
    """Writers edit under a lock that readers never take: a snapshot is one attribute read."""

    def __init__(self) -> None:
        self._snapshot = Snapshot(Node(), 0)
        self._lock = threading.Lock()
        self._listeners: list[Callable[[Snapshot], None]] = []

    @property
    def snapshot(self) -> Snapshot:
        """The newest committed state."""
        return self._snapshot

    def edit(self) -> AbstractContextManager[TreeEdit]:
        """A batch of edits, published as one revision when the block ends without an exception.

        Listeners are called before the lock is handed on, in order of revision.
        """
        return _Editing(self)

    def _publish(self, edit: TreeEdit) -> None:
        changed = edit.changed
        root = edit.commit()
        if changed:
            self._snapshot = snapshot = Snapshot(root, self._snapshot.revision + 1)
            for listener in tuple(self._listeners):
                listener(snapshot)

    def listen(self, listener: Callable[[Snapshot], None]) -> Callable[[], None]:
        """Calls ``listener`` with every new snapshot, in the writer's thread: it must return at once and not edit.

        A listener that keeps the last snapshot it handled finds what changed with ``tree.changes``, however many
        revisions lie between. Returns a function that ends the subscription.
        """
        self._listeners.append(listener)

        def stop() -> None:
            if listener in self._listeners:
                self._listeners.remove(listener)

        return stop


class _Editing(AbstractContextManager[TreeEdit]):
    """``LiveTree.edit``; a class, since entering a generator would be a tenth of a single transform's time."""

    __slots__ = ("_edit", "_live")

    def __init__(self, live: LiveTree) -> None:
        self._live = live

    def __enter__(self) -> TreeEdit:
        self._live._lock.acquire()
        self._edit = TreeEdit(self._live._snapshot.root)
        return self._edit

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._live._publish(self._edit)
        finally:
            self._live._lock.release()
