"""A log as a timeline: ``open_log``, which begins with one pass over its headers."""

from __future__ import annotations

import asyncio
import time
from array import array
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from gateway.files.assets.mesh_files import MeshFiles
from gateway.replay.log_replay import IncompleteMessages, LogClock, LogReplay, ReplayState, cost_of, is_shown
from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.nodes import CHILD_BYTES, NODE_BYTES, Node
from gateway.scene.tree.timeline import Timeline
from scenegate.closing import Closing
from scenegate.lcm.event_log import EventLogError, read_events
from scenegate.regular_files import open_regular

Result = TypeVar("Result")

SLICE_SECONDS: Final = 0.02
"""Time of the index between two seeks: longer slices would delay a playing page."""
MAX_REPLAYS: Final = 3
"""Number of positions at which replays wait to go on. Each keeps a state of the tree in memory."""
MIN_LABEL_INTERVAL_NS: Final = 10_000_000
"""Minimum time between two entries of the table of simulation times."""
MAX_BYTES: Final = 512 << 20
"""Default limit of the memory that checkpoints need besides the newest state."""
MAX_COUNT: Final = 4096
"""Limit of the number of checkpoints."""
MIN_INTERVAL: Final = 500.0
"""Default cost of the events between two checkpoints (``cost_of``): a seek replays them in about 50 ms."""
LINK_BYTES: Final = 100
"""Memory of the state of one of Drake's links, frames or bodies."""


def open_log(
    path: Path, files: MeshFiles | None = None, on_progress: Callable[[int], None] = lambda position: None
) -> LogTimeline:
    """Return the states of the tree over the time of a log: requests of the tree viewer's clients, or Drake's messages.

    It reads the headers of the log, which takes a second for 600,000 messages. ``snapshot_at`` works at once: it
    extends the index to the time, so a seek far beyond the index takes as long as to decode what lies between. Each
    message is decoded once for the index, and once more when a seek replays it. ``build_index`` decodes the log in the
    background; afterwards each seek is quick::

        with open_log(Path("run.lcmlog")) as timeline:
            begin, end = timeline.span
            for time_ns in range(begin, end, 40_000_000):
                snapshot = await timeline.snapshot_at(time_ns)

    ``files`` are mesh files that the messages may name. ``on_progress`` is called now and then with the bytes that were
    read. Raises LogError if it is not an LCM log, or none of its messages can be shown; OSError.
    """
    return LogTimeline(path, files or MeshFiles(()), scan_log(path, on_progress))


class LogTimeline(Closing, Timeline):
    """States of the tree over the time of a log.

    Used in one event loop, except ``incomplete`` and ``progress``. The index and the replays change only in the
    timeline's own thread; the event loop reads them meanwhile.
    """

    def __init__(
        self, path: Path, files: MeshFiles, summary: LogSummary, checkpoints: Checkpoints | None = None
    ) -> None:
        """``checkpoints``: empty container of those of the index; None: with the default limits. Raises OSError."""
        self.summary = summary
        self.path, self._files = path, files
        self._checkpoints = checkpoints or Checkpoints()
        self._indexer = LogReplay(path, files)
        """Decodes the log once, and adds checkpoints."""
        self._cost_since_checkpoint = 0.0
        self._replays: list[LogReplay] = []
        """Replays at recent positions, the last used one at the end."""
        self._simulation_times, self._simulation_seconds = array("q"), array("d")
        """Table of simulation times: time of the log in nanoseconds, and that of the simulation in seconds."""
        self._thread = ThreadPoolExecutor(1, "log")
        """The thread that replays. Seeks and slices of the index take turns in it."""

    @property
    def span(self) -> tuple[int, int]:
        """First and last time of the log."""
        return self.summary.span

    @property
    def incomplete(self) -> IncompleteMessages:
        """Messages that could not be shown completely, of the part that was indexed."""
        return self._indexer.incomplete

    @property
    def progress(self) -> float:
        """Fraction of the log that is indexed, 0 to 1."""
        return 1.0 if self.is_fully_indexed else self._indexer.position / max(1, self.summary.file_bytes)

    @property
    def is_fully_indexed(self) -> bool:
        """True if seeks to all times are quick."""
        return self._indexer.next_event is None

    @property
    def newest(self) -> Snapshot:
        """The last state of the part that is indexed."""
        return self._indexer.snapshot

    async def snapshot_at(self, time_ns: int) -> Snapshot:
        """Return the state that was valid at a time, nanoseconds since the epoch; times outside are clamped.

        States of the same messages have the same revision. A time beyond the index waits until the index is there.
        Raises OSError.
        """
        begin, end = self.span
        time_ns = min(max(time_ns, begin), end)
        while (next_ns := self._indexer.next_time_ns) is not None and next_ns <= time_ns:
            await self._in_thread(self._index_slice)
        return await self._in_thread(lambda: self._seek(time_ns))

    async def build_index(self, on_progress: Callable[[float], None] = lambda progress: None) -> None:
        """Decode the log to its end, in slices between which seeks are served; report ``progress`` after each slice."""
        while not self.is_fully_indexed:
            await self._in_thread(self._index_slice)
            on_progress(self.progress)

    def simulation_seconds_at(self, time_ns: int) -> float | None:
        """Return the time of Drake's simulation, seconds, at a time of the log; None if none is known."""
        index = bisect_right(self._simulation_times, time_ns) - 1
        return self._simulation_seconds[index] if index >= 0 else None

    def replay(self) -> LogReplay:
        """Return a replay from the beginning of the log, which the caller closes. Raises OSError."""
        return LogReplay(self.path, self._files)

    def close(self) -> None:
        """End the thread, and close the log's files."""
        self._thread.shutdown(cancel_futures=True)
        for replay in (self._indexer, *self._replays):
            replay.close()

    async def _in_thread(self, work: Callable[[], Result]) -> Result:
        """Call a function in the timeline's thread, after those of earlier calls."""
        return await asyncio.get_running_loop().run_in_executor(self._thread, work)

    def _index_slice(self) -> None:
        """Decode the next part of the log, for ``SLICE_SECONDS``."""
        indexer = self._indexer
        deadline = time.perf_counter() + SLICE_SECONDS
        while (event := indexer.next_event) is not None:
            indexer.step()
            self._note_simulation_time()
            self._cost_since_checkpoint += cost_of(event)
            if self._cost_since_checkpoint >= self._checkpoints.interval:
                self._checkpoints.add(indexer.renew())  # its state; the limits then count from there
                self._cost_since_checkpoint = 0.0
            if time.perf_counter() >= deadline:
                break

    def _note_simulation_time(self) -> None:
        seconds, times = self._indexer.simulation_seconds, self._simulation_times
        if seconds is None or (times and self._simulation_seconds[-1] == seconds):
            return
        time_ns = self._indexer.clock.time_ns
        if not times or time_ns - times[-1] >= MIN_LABEL_INTERVAL_NS or seconds < self._simulation_seconds[-1]:
            self._simulation_seconds.append(seconds)  # first: the event loop looks up a time, then its seconds
            times.append(time_ns)

    def _seek(self, time_ns: int) -> Snapshot:
        """Return the state at a time that is indexed."""
        checkpoint = self._checkpoints.before(time_ns)
        # A replay before the checkpoint would decode more events than one that begins there.
        usable = (
            each for each in self._replays if each.clock.time_ns <= time_ns and each.position >= checkpoint.position
        )
        replay = max(usable, key=lambda each: each.position, default=None)
        if replay is None:
            replay = LogReplay(self.path, self._files, checkpoint)
        else:
            self._replays.remove(replay)
        self._replays.append(replay)
        if len(self._replays) > MAX_REPLAYS:
            self._replays.pop(0).close()
        replay.advance(time_ns)
        return replay.snapshot


class Checkpoints:
    """States of a replay in the order of the log, from which others can begin: no seek replays more than a part of it.

    If they need too much memory, every second one is dropped.
    """

    def __init__(self, max_bytes: int = MAX_BYTES, max_count: int = MAX_COUNT, interval: float = MIN_INTERVAL) -> None:
        self._max_bytes, self._max_count = max_bytes, max_count
        self._states = [ReplayState()]
        self._bytes = [0]
        """Bytes that each checkpoint needs besides the one before."""
        self.interval = interval
        """Cost of the events between two checkpoints."""

    def __len__(self) -> int:
        return len(self._states)

    @property
    def nbytes(self) -> int:
        """Estimate of the memory of all checkpoints."""
        return sum(self._bytes)

    def add(self, state: ReplayState) -> None:
        """Append a checkpoint."""
        self._bytes.append(bytes_besides(state, self._states[-1]))
        self._states.append(state)
        while len(self._states) > 1 and (self.nbytes > self._max_bytes or len(self._states) > self._max_count):
            self._states = self._states[::2]
            pairs = zip(self._states[1:], self._states, strict=False)
            self._bytes = [0, *(bytes_besides(state, earlier) for state, earlier in pairs)]
            self.interval *= 2.0

    def before(self, time_ns: int) -> ReplayState:
        """Return the last checkpoint with no event after a time, nanoseconds since the epoch."""
        return self._states[max(0, bisect_right(self._states, time_ns, key=lambda each: each.clock.time_ns) - 1)]


def bytes_besides(state: ReplayState, earlier: ReplayState) -> int:
    """Return an estimate of the memory that a state needs besides an earlier one."""
    size = LINK_BYTES * sum(state.drake.node_counts.values())
    for channel, load in state.drake.loads.items():
        earlier_load = earlier.drake.loads.get(channel)
        if earlier_load is None or earlier_load.data is not load.data:
            size += len(load.data)
    stack: list[tuple[Node, Node | None]] = [(state.snapshot.root, earlier.snapshot.root)]
    while stack:
        node, before = stack.pop()
        if node is before:
            continue
        size += NODE_BYTES + CHILD_BYTES * len(node.children)
        if before is None or node.parts is not before.parts:
            size += sum(NODE_BYTES + part.array_bytes for part in node.parts or ())
        children = before.children if before is not None else {}
        stack += [(child, children.get(name)) for name, child in node.children.items()]
    return size


REPORT_EVENTS: Final = 4096
"""Number of events between two calls of ``on_progress``."""
MAX_CHANNELS: Final = 4096
"""Maximum number of channels that are counted by name."""
MAX_NAMED: Final = 10
"""Maximum number of channels that an error names."""


class LogError(ValueError):
    """A log cannot be shown; the message is one sentence."""


@dataclass(frozen=True, slots=True)
class LogSummary:
    """Span, counts and damage of a log."""

    span: tuple[int, int]
    """Times of the first and last event on the time bar, nanoseconds since the epoch."""
    events: int
    """Number of events."""
    shown: int
    """Number of events of channels that change the tree, among the first ``MAX_CHANNELS`` channels."""
    file_bytes: int
    """Size of the file when it was read."""
    clock_sets: int
    """Number of times that the recorder's clock was set."""
    damaged_bytes: int = 0
    """Bytes that belong to no complete message: the recorder was killed, or the file is damaged."""


def scan_log(path: Path, on_progress: Callable[[int], None] = lambda position: None) -> LogSummary:
    """Read the headers of all events of a log. ``on_progress`` is called now and then with the bytes read so far.

    Raises LogError if it is not an LCM log, or none of its messages can be shown; or OSError.
    """
    clock = LogClock()
    first_ns = events = 0
    channels: Counter[str] = Counter()
    damages: list[int] = []
    with open_regular(path) as file:
        try:
            for event in read_events(file, lambda channel: False, damages.append):  # only their headers
                clock = clock.after(event.time_us)
                if not events:
                    first_ns = clock.time_ns
                events += 1
                if event.channel in channels or len(channels) < MAX_CHANNELS:
                    channels[event.channel] += 1
                if events % REPORT_EVENTS == 0:
                    on_progress(event.position)
        except EventLogError as error:
            raise LogError(f"{path}: {error}") from None
        file_bytes = file.tell()
    shown = sum(count for channel, count in channels.items() if is_shown(channel))
    if not shown:
        raise LogError(f"{path}: {_nothing_to_show(events, channels)}")
    return LogSummary((first_ns, clock.time_ns), events, shown, file_bytes, clock.sets, sum(damages))


def _nothing_to_show(events: int, channels: Counter[str]) -> str:
    if not events:
        return "the log is empty"
    names = ", ".join(f"{name[:60]} ({count})" for name, count in channels.most_common(MAX_NAMED))
    more = f" and {len(channels) - MAX_NAMED} more" if len(channels) > MAX_NAMED else ""
    return (
        "no channel of the log can be shown: there are neither requests of the tree viewer's clients "
        f"(DIRECTOR_TREE_VIEWER_REQUEST…) nor messages of Drake (DRAKE_VIEWER_…), only {names}{more}"
    )
