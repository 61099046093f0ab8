"""The recent states of the live tree, as a ``Timeline``."""

import threading
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Final, NamedTuple
from weakref import WeakValueDictionary

from gateway.replay.packed_changes import PackedChange, PathIds, pack, unpack
from gateway.scene.tree.live import LiveTree, Snapshot
from gateway.scene.tree.timeline import Timeline

STATES_PER_SECOND: Final = 90
"""Maximum number of recorded states: as many as a page gets. A tree that changes more often is recorded in between."""
KEYFRAME_NS: Final = 1_000_000_000
"""Time between keyframes. Each takes ``tree.NODE_BYTES`` for every node that moved since the one before."""
MAX_SEGMENT_SHARE: Final = 0.1
"""Maximum share of ``max_bytes`` after which there is another keyframe, so that a part of the history can go."""
REBUILT_STATES: Final = 4
"""Number of states that were rebuilt last and are kept: playing rebuilds each from the one before."""

MAX_PINNED: Final = 8
"""Maximum number of older states that paused pages pin. Each may need a scene's memory."""


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
    ids: PathIds = field(default_factory=dict)
    nbytes: int = 0
    """Estimate of the memory that only this segment needs."""


class _HeldHistory(Timeline):
    """The states of a history at some time."""

    def __init__(self, span: tuple[int, int], state_at: Callable[[int], Awaitable[Snapshot]]) -> None:
        self._span, self._state_at = span, state_at

    @property
    def span(self) -> tuple[int, int]:
        """See ``Timeline``."""
        return self._span

    async def snapshot_at(self, timestamp: int) -> Snapshot:
        """See ``Timeline``."""
        return await self._state_at(timestamp)


class TreeHistory(Timeline):
    """The recent states of a live tree. Thread-safe.

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
        """Create a history of the last seconds, from now on. Beyond ``max_bytes``, estimated, the oldest states go.

        ``to_thread`` is as ``asyncio.to_thread``; ``clock`` returns nanoseconds since the epoch.
        """
        self._tree = tree
        self._kept_nanoseconds = round(seconds * 1e9)
        self._max_bytes = max_bytes
        self._to_thread = to_thread
        self._clock = clock
        self._pinned: WeakValueDictionary[int, Snapshot] = WeakValueDictionary()
        """States that pages show after the span has passed them, by their time."""
        self._lock = threading.Lock()
        self._restart(tree.snapshot)
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
            recorded_since = max(self._segments[0].keyframe.timestamp, self._recording_start)
        first = max(recorded_since, now - self._kept_nanoseconds)
        return min(first, now), now  # a clock that was set back is before what was recorded

    @property
    def nbytes(self) -> int:
        """Estimate of the memory."""
        with self._lock:
            return sum(segment.nbytes for segment in self._segments)

    async def snapshot_at(self, timestamp: int) -> Snapshot:
        """Return the state that was valid at a time; times outside the span are clamped."""
        return await self._state_at(timestamp, self._tree.snapshot, self._segments)

    def pin(self, time: int, snapshot: Snapshot) -> bool:
        """See ``Timeline``."""
        if time in self._pinned or len(self._pinned) < MAX_PINNED:
            self._pinned[time] = snapshot
        return time in self._pinned

    def pinned_at(self, time: int) -> Snapshot | None:
        """See ``Timeline``. Seconds as float64 are exact to 240 nanoseconds."""
        return next((each for held, each in list(self._pinned.items()) if abs(held - time) < 1000), None)

    def held(self) -> Timeline:
        """Return the states of the present span, which stay as long as the result is used."""
        span, newest = self.span, self._tree.snapshot
        with self._lock:
            segments = self._segments.copy()
        return _HeldHistory(span, partial(self._state_at, newest=newest, segments=segments))

    async def _state_at(self, timestamp: int, newest: Snapshot, segments: deque[_Segment]) -> Snapshot:
        """Return the state of a time among those of segments (recorded or held), or ``newest``, which is after them."""
        if timestamp >= newest.timestamp:
            return newest
        with self._lock:
            number = bisect_right(segments, timestamp, key=lambda each: each.keyframe.timestamp)
            segment = segments[max(0, number - 1)]  # the first one also for earlier times
            change_count = bisect_right(segment.changes, timestamp, key=lambda each: each.timestamp)
            if not change_count:
                return segment.keyframe
            # A revision is one state, also in a held history. Several states may have the same timestamp.
            if segment.changes[change_count - 1].revision == self._last_recorded.revision:
                return self._last_recorded
        return await self._to_thread(lambda: self._rebuild(segment, change_count))

    def record(self) -> None:
        """Record the newest state, and drop old ones."""
        # Only the recording thread changes the last segment, and it packs without the lock.
        snapshot, last, segment = self._tree.snapshot, self._last_recorded, self._segments[-1]
        clock_was_set_back = snapshot.timestamp < last.timestamp
        change = None if clock_was_set_back or snapshot is last else pack(last.root, snapshot.root, segment.ids)
        with self._lock:
            if clock_was_set_back:
                self._restart(snapshot)
            elif change is not None:
                self._append(segment, snapshot, change)
            self._drop_old()

    def _run(self) -> None:
        """Record changes until ``close``, in the history's thread."""
        while not self._closing.is_set():
            self._changed.wait(1.0)  # old states go even if there are no new ones
            self._changed.clear()
            self.record()
            self._closing.wait(1.0 / STATES_PER_SECOND)

    def _restart(self, snapshot: Snapshot) -> None:
        """Forget all states but this one."""
        self._segments = deque([_Segment(snapshot)])
        """Oldest first; at least one."""
        self._rebuilt: deque[Snapshot] = deque(maxlen=REBUILT_STATES)
        """States that were rebuilt last, also from segments of held histories."""
        self._last_recorded = snapshot
        self._recording_start = self._clock()
        """Start of the span: the state of the first keyframe may be older."""

    def _append(self, segment: _Segment, snapshot: Snapshot, change: PackedChange) -> None:
        """Append a state to the last segment, or make it the keyframe of another one."""
        self._last_recorded = snapshot
        segment.nbytes += change.nbytes  # what only the states before need, also if a keyframe follows
        is_long = snapshot.timestamp - segment.keyframe.timestamp >= KEYFRAME_NS
        if is_long or segment.nbytes > MAX_SEGMENT_SHARE * self._max_bytes:
            self._segments.append(_Segment(snapshot))
        else:
            segment.changes.append(_Recorded(snapshot.timestamp, snapshot.revision, change))

    def _drop_old(self) -> None:
        """Drop segments that ended too long ago, and the oldest ones if all need too much memory."""
        oldest = self._clock() - self._kept_nanoseconds
        segments = self._segments
        if segments[-1].changes and self._last_recorded.timestamp <= oldest:
            segments.append(_Segment(self._last_recorded))  # so that the one before, which has older states, can go
        nbytes = sum([segment.nbytes for segment in segments])
        while len(segments) > 1 and (nbytes > self._max_bytes or segments[1].keyframe.timestamp <= oldest):
            nbytes -= segments[0].nbytes
            segments.popleft()
        for state in tuple(self._rebuilt):
            if state.timestamp < segments[0].keyframe.timestamp:
                self._rebuilt.remove(state)

    def _rebuild(self, segment: _Segment, change_count: int) -> Snapshot:
        """Return the state after a number of changes of a segment, from the nearest state before it that is known."""
        with self._lock:
            known = {state.revision: state for state in self._rebuilt}
        base, base_count = segment.keyframe, 0
        for count, recorded in enumerate(segment.changes[:change_count], 1):
            if recorded.revision in known:
                base, base_count = known[recorded.revision], count
        if base_count == change_count:
            return base
        changes = segment.changes[base_count:change_count]
        root = unpack(base.root, (each.change for each in changes), segment.ids)
        snapshot = Snapshot(root, changes[-1].revision, changes[-1].timestamp)
        with self._lock:
            self._rebuilt.append(snapshot)
        return snapshot
