"""The live tree that all interfaces share. It counts revisions, keeps recent states, and notifies listeners."""

import threading
import time
from bisect import bisect_right
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

from gateway.scene.tree.nodes import Node, TreeEdit

KEPT_NANOSECONDS: Final = 1_000_000_000
"""Time for which a snapshot is kept after the next one: longer than a camera or the event loop is late."""
MAX_KEPT_BYTES: Final = 64 << 20
"""Maximum memory of all kept snapshots besides the latest. 1,000 nodes that move at 60 Hz need 27 MB."""
MAX_KEPT: Final = 500
"""Maximum number of kept snapshots."""
_NO_NODE: Final = Node()
"""Stands for a node that does not exist."""


@dataclass(frozen=True, slots=True, weakref_slot=True)
class Snapshot:
    """A consistent state of the tree."""

    root: Node
    revision: int
    """Number of edits so far that changed the tree; 0 for the empty tree at start."""
    timestamp: int = 0
    """Time from which it was valid, nanoseconds since the epoch."""
    replaced_bytes: int = 0
    """Estimate of the bytes that only snapshots before it need, since the tree began."""


class LiveTree:
    """A tree that is edited under a lock. Reading a snapshot takes no lock."""

    def __init__(self, clock: Callable[[], int] = time.time_ns, first: Snapshot | None = None) -> None:
        """``clock`` returns the time of edits that name none, nanoseconds since the epoch. ``first``: None: empty."""
        self._clock = clock
        self.snapshot = first or Snapshot(Node(), 0)
        """The latest committed state."""
        self.unapplied_arrivals: dict[Hashable, int] = {}
        """Arrivals of messages that wait to be applied, nanoseconds since the epoch. Receivers add and remove them, on
        the event loop, each with keys of its own."""
        self._recent: tuple[Snapshot, ...] = (self.snapshot,)
        """Kept snapshots, oldest first. Replaced, never changed, so that readers need no lock."""
        self._keepers: set[object] = set()
        """Keys of ``keep_recent``."""
        self._lock = threading.Lock()
        self._listeners: list[Callable[[], object]] = []

    def keep_recent(self, key: object, *, active: bool) -> None:
        """Keep replaced states for a while, until a call with the same key and ``active=False``."""
        if active != (key in self._keepers):
            with self._lock:
                self._keepers ^= {key}
                if not self._keepers:
                    self._recent = self._recent[-1:]

    def snapshot_at(self, timestamp: int) -> Snapshot:
        """Return the state that was valid at a time, nanoseconds since the epoch; the oldest kept one if it is earlier.

        States are kept for ``KEPT_NANOSECONDS`` after they were replaced, while ``keep_recent`` is active.
        """
        recent = self._recent
        snapshot = recent[max(0, bisect_right(recent, timestamp, key=lambda each: each.timestamp) - 1)]
        if len(recent) > 1 and recent[1].timestamp < timestamp - KEPT_NANOSECONDS:
            with self._lock:
                self._recent = _kept(self._recent, timestamp - KEPT_NANOSECONDS)
        return snapshot

    def has_unapplied_before(self, timestamp: int) -> bool:
        """Return True if a message that arrived before a time, nanoseconds since the epoch, is not applied yet."""
        return any(arrival <= timestamp for arrival in self.unapplied_arrivals.values())

    @contextmanager
    def edit(self, timestamp: int | None = None) -> Iterator[TreeEdit]:
        """Edit the tree in a ``with`` block. Its edits become one revision, unless the block raises an exception.

        It is valid from ``timestamp``, nanoseconds since the epoch; None: now. Listeners are called before the lock is
        released, in the order of the revisions.
        """
        with self._lock:
            edit = TreeEdit(self.snapshot.root)
            yield edit
            self._commit(edit, timestamp)

    def publish(self, edit: TreeEdit, timestamp: int | None = None) -> None:
        """Make an edit, which began with an earlier state of this tree, visible as one revision.

        What others have changed since then stays, except where this edit changed the same property of a node.
        ``timestamp`` is that of ``edit``.
        """
        with self._lock:
            self._commit(edit, timestamp)

    def replace(self, snapshot: Snapshot) -> None:
        """Make a state of another tree, with its revision, the latest one."""
        with self._lock:
            self._show((snapshot,))

    def _commit(self, edit: TreeEdit, timestamp: int | None) -> None:
        """Make the result of an edit the latest state, and forget old ones."""
        base, root = edit.base, edit.commit()
        if not edit.changed:
            return
        last, now = self.snapshot, self._clock() if timestamp is None else timestamp
        if last.root is not base:
            root = merged(base, root, last.root)
        is_set_back = now < last.timestamp - KEPT_NANOSECONDS
        now = now if is_set_back else max(now, last.timestamp)
        snapshot = Snapshot(root, last.revision + 1, now, last.replaced_bytes + edit.replaced_bytes)
        if is_set_back or not self._keepers:
            self._show((snapshot,))
        else:
            self._show(_kept((*self._recent, snapshot), now - KEPT_NANOSECONDS))

    def _show(self, recent: tuple[Snapshot, ...]) -> None:
        """Make the last one of the kept snapshots the latest state, and call the listeners."""
        self._recent, self.snapshot = recent, recent[-1]
        for listener in tuple(self._listeners):
            listener()

    def listen(self, listener: Callable[[], object]) -> Callable[[], None]:
        """Call ``listener`` after every new snapshot, in the thread that edits. It must not block, nor edit the tree.

        The differences between any two snapshots are ``tree.changes``. Returns a function that removes the listener.
        """
        self._listeners.append(listener)

        def stop() -> None:
            if listener in self._listeners:
                self._listeners.remove(listener)

        return stop


def _kept(recent: tuple[Snapshot, ...], oldest: int) -> tuple[Snapshot, ...]:
    """Return snapshots without those that were replaced before the time ``oldest`` or are too many."""
    first, last = 0, len(recent) - 1
    while first < last and (
        recent[first + 1].timestamp < oldest
        or last - first >= MAX_KEPT
        or recent[last].replaced_bytes - recent[first].replaced_bytes > MAX_KEPT_BYTES
    ):
        first += 1
    return recent[first:]


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
        before = base.children.get(name, _NO_NODE)
        if child is not before:
            node.children[name] = merged(before, child, theirs.children.get(name, _NO_NODE))
    node.nodes_with_parts = (node.parts is not None) + sum(each.nodes_with_parts for each in node.children.values())
    node.node_count = 1 + sum(each.node_count for each in node.children.values())
    return node
