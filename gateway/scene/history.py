"""The states of the live tree in the last minute, as a ``Timeline``."""

from __future__ import annotations

import threading
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Final, NamedTuple

from gateway.scene.live import LiveTree, Snapshot
from gateway.scene.packed_changes import PackedChange, PathIds, pack, unpack
from gateway.scene.timeline import Timeline
from gateway.scene.tree import CHILD_BYTES, NODE_BYTES

STATES_PER_SECOND: Final = 90
"""Maximum number of recorded states: as many as a page gets. A tree that changes more often is recorded in between."""
KEYFRAME_NS: Final = 1_000_000_000
"""Time between keyframes. Each takes ``NODE_BYTES`` for every node that moved since the one before."""
MAX_SEGMENT_SHARE: Final = 0.1
"""Maximum share of ``max_bytes`` after which there is another keyframe, so that a part of the history can go."""
REBUILT_STATES: Final = 4
"""Number of states that were rebuilt last and are kept: playing rebuilds each from the one before."""


class _Recorded(NamedTuple):
    timestamp: int
    """Time from which the state was valid, nanoseconds since the epoch."""
    revision: int
    change: PackedChange
    """Difference from the state before."""


@dataclass(slots=True, eq=False)
class _Segment:
    """A keyframe and the changes up to the next segment's keyframe."""

    keyframe: Snapshot
    changes: list[_Recorded] = field(default_factory=list)
    ids: PathIds = field(default_factory=PathIds)
    change_bytes: int = 0

    @property
    def nbytes(self) -> int:
        """Estimate of the memory that only this segment needs."""
        return self.change_bytes + self.ids.nbytes + (NODE_BYTES + CHILD_BYTES) * len(self.ids.paths)

    def count_at(self, timestamp: int) -> int:
        """Return the number of changes up to a time."""
        return bisect_right(self.changes, timestamp, key=lambda each: each.timestamp)


class _Rebuilt(NamedTuple):
    segment: _Segment
    length: int
    """Number of the segment's changes that it contains."""
    snapshot: Snapshot


@dataclass(frozen=True, slots=True)
class _HeldHistory:
    """The states of a history at some time: a ``Timeline``."""

    span: tuple[int, int]
    state_at: Callable[[int], Awaitable[Snapshot]]

    async def snapshot_at(self, timestamp: int) -> Snapshot:
        """Return the state that was valid at a time; times outside the span are clamped."""
        return await self.state_at(timestamp)

    def simulation_seconds_at(self, time: int) -> None:
        """Return None: the live tree has no time of a simulation."""

    def held(self) -> Timeline:
        """Return this timeline."""
        return self


class TreeHistory:
    """States of a live tree over the last seconds: a ``Timeline``. Thread-safe.

    A thread records them while ``start`` … ``close``: edits wait for nothing, and the event loop has nothing to do.
    ``LiveTree.keep_recent`` is another thing: it has every state for an exposure, as trees, for a second.
    """

    def __init__(
        self,
        tree: LiveTree,
        seconds: float,
        max_bytes: int,
        to_thread: Callable[[Callable[[], Snapshot]], Awaitable[Snapshot]],
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        """Create a history that begins now.

        Args:
            seconds: Time for which states are kept.
            max_bytes: Maximum memory, estimated. The oldest states are dropped first.
            to_thread: Calls a function in another thread, as ``asyncio.to_thread``.
            clock: Returns nanoseconds since the epoch.
        """
        self._tree = tree
        self._kept_nanoseconds = round(seconds * 1e9)
        self._max_bytes = max_bytes
        self._to_thread = to_thread
        self._clock = clock
        self._lock = threading.Lock()
        self._begin(tree.snapshot)
        self._changed = threading.Event()
        self._closing = threading.Event()
        self._stop_listening: Callable[[], None] = lambda: None
        self._thread = threading.Thread(target=self._run, name="history", daemon=True)

    def start(self) -> None:
        """Start to record."""
        self._stop_listening = self._tree.listen(self._changed.set)
        self._changed.set()
        self._thread.start()

    def close(self) -> None:
        """Stop recording."""
        self._stop_listening()
        self._closing.set()
        self._changed.set()
        self._thread.join()

    @property
    def span(self) -> tuple[int, int]:
        """First and last time that have a state. The last one is now."""
        now = max(self._clock(), self._tree.snapshot.timestamp)
        with self._lock:
            first = max(self._segments[0].keyframe.timestamp, self._began)
        return min(max(first, now - self._kept_nanoseconds), now), now

    @property
    def nbytes(self) -> int:
        """Estimate of the memory."""
        with self._lock:
            return sum(segment.nbytes for segment in self._segments)

    async def snapshot_at(self, timestamp: int) -> Snapshot:
        """Return the state that was valid at a time; times outside the span are clamped."""
        return await self._state_at(timestamp, self._tree.snapshot, self._segments, self._rebuilt)

    def simulation_seconds_at(self, time: int) -> None:
        """Return None: the live tree has no time of a simulation."""

    def held(self) -> Timeline:
        """Return the states of the present span, which stay as long as the result is used."""
        span, live = self.span, self._tree.snapshot
        with self._lock:
            segments, rebuilt = deque(self._segments), deque[_Rebuilt](maxlen=REBUILT_STATES)
        return _HeldHistory(span, partial(self._state_at, live=live, segments=segments, rebuilt=rebuilt))

    async def _state_at(
        self, time: int, live: Snapshot, segments: deque[_Segment], rebuilt: deque[_Rebuilt]
    ) -> Snapshot:
        """Return the state that was valid at a time.

        Args:
            live: State after those of the segments.
            segments: Segments in the order of time.
            rebuilt: States of these segments that were rebuilt last.
        """
        if time >= live.timestamp:
            return live
        with self._lock:
            index = bisect_right(segments, time, key=lambda each: each.keyframe.timestamp)
            segment = segments[max(0, index - 1)]
            count = segment.count_at(time)
            if count and segment.changes[count - 1].revision == self._last.revision:
                return self._last
        if not count:
            return segment.keyframe
        return await self._to_thread(lambda: self._rebuild(segment, count, segments, rebuilt))

    def record(self) -> None:
        """Record the newest state, and drop old ones."""
        snapshot = self._tree.snapshot
        with self._lock:
            last, segment = self._last, self._segments[-1]
        if snapshot.timestamp < last.timestamp:  # the clock was set back
            with self._lock:
                self._begin(snapshot)
        elif snapshot is not last:
            change = pack(last.root, snapshot.root, segment.ids)
            with self._lock:
                self._append(segment, snapshot, change)
        with self._lock:
            self._drop_old()

    def _run(self) -> None:
        while not self._closing.is_set():
            self._changed.wait(1.0)  # old states go even if there are no new ones
            self._changed.clear()
            self.record()
            self._closing.wait(1.0 / STATES_PER_SECOND)

    def _begin(self, snapshot: Snapshot) -> None:
        """Start anew with a state."""
        self._segments: deque[_Segment] = deque([_Segment(snapshot)])
        """Oldest first."""
        self._last = snapshot
        """The state that was recorded last."""
        self._rebuilt: deque[_Rebuilt] = deque(maxlen=REBUILT_STATES)
        self._began = self._clock()

    def _append(self, segment: _Segment, snapshot: Snapshot, change: PackedChange) -> None:
        """Append a state to the last segment, or make it the keyframe of another one."""
        self._last = snapshot
        segment.change_bytes += change.nbytes
        is_long = snapshot.timestamp - segment.keyframe.timestamp >= KEYFRAME_NS
        if is_long or segment.nbytes > MAX_SEGMENT_SHARE * self._max_bytes:
            self._segments.append(_Segment(snapshot))
        else:
            segment.changes.append(_Recorded(snapshot.timestamp, snapshot.revision, change))

    def _drop_old(self) -> None:
        """Drop segments that ended too long ago, and the oldest ones if all need too much memory."""
        oldest = self._clock() - self._kept_nanoseconds
        if self._segments[-1].changes and self._last.timestamp <= oldest:
            self._segments.append(_Segment(self._last))
        nbytes = sum(segment.nbytes for segment in self._segments)
        while len(self._segments) > 1 and (nbytes > self._max_bytes or self._segments[1].keyframe.timestamp <= oldest):
            dropped = self._segments.popleft()
            nbytes -= dropped.nbytes
            self._rebuilt = deque((each for each in self._rebuilt if each.segment is not dropped), REBUILT_STATES)

    def _rebuild(self, segment: _Segment, length: int, segments: deque[_Segment], rebuilt: deque[_Rebuilt]) -> Snapshot:
        """Return the state after a number of changes of a segment. Further arguments as for ``_state_at``."""
        base = _Rebuilt(segment, 0, segment.keyframe)
        with self._lock:
            for each in rebuilt:
                if each.segment is segment and base.length < each.length <= length:
                    base = each
        if base.length == length:
            return base.snapshot
        changes = segment.changes[base.length : length]
        root = unpack(base.snapshot.root, (each.change for each in changes), segment.ids)
        snapshot = Snapshot(root, changes[-1].revision, changes[-1].timestamp)
        with self._lock:
            if segment in segments:
                rebuilt.append(_Rebuilt(segment, length, snapshot))
        return snapshot
