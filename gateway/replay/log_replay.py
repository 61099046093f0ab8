"""Replay an LCM log into a tree of its own: requests of the tree viewer's clients, and Drake's messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import structlog

from gateway.adapters.drakeviewer.channels import channel_of
from gateway.adapters.drakeviewer.config import DrakeViewerConfig
from gateway.adapters.drakeviewer.viewer import DrakeState, DrakeViewer
from gateway.adapters.drakeviewer.wire import MessageError
from gateway.adapters.treeviewer.protocol import TreeViewerProtocol
from gateway.adapters.treeviewer.responses import FormatResponse
from gateway.files.assets.mesh_files import MeshFiles
from gateway.runtime.workers.pool_errors import UnavailableErrors
from gateway.scene.tree.live import LiveTree, Snapshot
from gateway.scene.tree.nodes import Node
from scenegate.closing import Closing
from scenegate.lcm.event_log import Event, read_events
from scenegate.messages import wire
from scenegate.regular_files import open_regular

_log = structlog.get_logger("gateway.lcmlog")

MAX_CHANNELS: Final = DrakeViewerConfig().channels
"""Maximum number of channels of Drake's clouds and frames, as while a simulation runs."""
MAX_LISTED: Final = 100
"""Maximum number of channels whose first reason is kept."""
MIN_DATA_COST: Final = 16 * 1024
"""Bytes of a message that take about as long as the message itself: 0.1 ms."""
SKIPPED_COST: Final = 0.02
"""Cost of an event of another channel, whose data is not read, in shown messages."""

SECOND_US: Final = 1_000_000
MAX_BACK_US: Final = SECOND_US
"""Maximum step back that is no set clock. Recorders with threads write messages in another order than they arrived."""
MAX_STEP_US: Final = 3600 * SECOND_US
"""Maximum time between two events. With a clock that is set from 1970 to now, the bar would have decades."""
SET_STEP_US: Final = SECOND_US
"""Time between two events on the bar if the clock was set between them."""
MAX_START_US: Final = 1 << 52
"""Limit of the first event's time, in the year 2112. A log with a later one begins at 0."""


@dataclass(frozen=True, slots=True)
class LogClock:
    """Time of an event on the time bar. It never decreases from one event to the next."""

    time_us: int = -1
    """Microseconds since the epoch; -1 before the first event."""
    shift_us: int = 0
    """Difference from the time of the recorder's clock."""
    sets: int = 0
    """Number of times that the recorder's clock was set so far."""

    def after(self, recorded_us: int) -> LogClock:
        """Return the time of the next event, given its time in the log."""
        if self.time_us < 0:
            start = recorded_us if 0 <= recorded_us < MAX_START_US else 0
            return LogClock(start, start - recorded_us)
        step = recorded_us + self.shift_us - self.time_us
        if -MAX_BACK_US <= step <= MAX_STEP_US:
            return LogClock(self.time_us + max(step, 0), self.shift_us, self.sets)
        time_us = self.time_us + SET_STEP_US
        return LogClock(time_us, time_us - recorded_us, self.sets + 1)

    @property
    def time_ns(self) -> int:
        """The time in nanoseconds."""
        return 1000 * self.time_us


def is_shown(channel: str) -> bool:
    """Return True for the channels that change the tree."""
    return channel.startswith(wire.REQUEST) or channel_of(channel) is not None


@dataclass(frozen=True, slots=True)
class ReplayState:
    """State between two events of a log, from which a replay can go on. Nothing changes it."""

    snapshot: Snapshot = field(default_factory=lambda: Snapshot(Node(), 0))
    drake: DrakeState = field(default_factory=DrakeState)
    clock: LogClock = field(default_factory=LogClock)
    """Time of the last event."""
    position: int = 0
    """Offset of the next event in the file."""


class IncompleteMessages:
    """Counts messages that could not be shown completely; keeps the first reason of each channel."""

    def __init__(self) -> None:
        self._channels: dict[str, tuple[str, int]] = {}
        """First reason, and number of these messages, by channel."""
        self.count = 0
        """Number of these messages."""

    def add(self, channel: str, reasons: Sequence[str]) -> None:
        """Count a message with the reasons why it is not shown completely."""
        self.count += 1
        reason, count = self._channels.get(channel, (reasons[0], 0))
        if count or len(self._channels) < MAX_LISTED:
            self._channels[channel] = reason, count + 1

    def listed(self) -> list[str]:
        """Return a sentence for each channel."""
        return [
            f"{channel}: messages that are not shown completely: {count}; the first one: {reason}"
            for channel, (reason, count) in tuple(self._channels.items())  # another thread adds to it
        ]


class LogReplay(Closing):
    """Replays a log from one of its states. Not thread-safe."""

    def __init__(self, path: Path, files: MeshFiles, state: ReplayState | None = None) -> None:
        """Begin with a state; None: before the first event. Messages may name ``files``. Raises EventLogError."""
        state = state or ReplayState()
        self._files = files
        self.incomplete = IncompleteMessages()
        """Messages that could not be shown completely."""
        self.clock = self._next_clock = state.clock
        """Time of the last event."""
        self.position = state.position
        """Offset of the next event in the file, or of the end of the log."""
        self._file = open_regular(path)
        try:
            self._begin(state)
            self._file.seek(state.position)
            self._events = read_events(self._file, is_shown)
            self.next_event: Event | None = None
            """The event that ``step`` applies; None at the end of the log."""
            self._read_next()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    def snapshot(self) -> Snapshot:
        """The tree after the last event. Its timestamp is that of the last event that has changed it."""
        return self._live.snapshot

    @property
    def next_time_ns(self) -> int | None:
        """Time of the next event, nanoseconds since the epoch; None at the end of the log."""
        return None if self.next_event is None else self._next_clock.time_ns

    @property
    def simulation_seconds(self) -> float | None:
        """Time of the simulation in the last draw message of Drake's; None before the first one."""
        return self._drake.state.simulation_seconds

    @property
    def state(self) -> ReplayState:
        """The state after the last event."""
        return ReplayState(self.snapshot, self._drake.state.copy(), self.clock, self.position)

    def renew(self) -> ReplayState:
        """Go on as a replay does that begins with the current state, and return the state.

        The limits on geometry in use then count that of the current tree only, whatever else holds earlier states.
        """
        state = self.state
        self._begin(state)
        return state

    def step(self) -> None:
        """Apply the next event, if there is one."""
        event = self.next_event
        if event is None:
            return
        self.clock = self._next_clock
        try:
            reasons = self._apply(event)
        except (wire.WireError, MessageError, *UnavailableErrors) as error:
            reasons = (str(error),)
        except Exception as error:  # noqa: BLE001 - one message must not end the replay
            _log.error("A message of a log could not be shown", channel=event.channel, exc_info=error)
            reasons = ("internal error; the log of the program says more",)
        self._read_next()
        if reasons:
            self.incomplete.add(event.channel, reasons)

    def advance(self, time_ns: int) -> None:
        """Apply all events up to a time, nanoseconds since the epoch."""
        while (next_ns := self.next_time_ns) is not None and next_ns <= time_ns:
            self.step()

    def _begin(self, state: ReplayState) -> None:
        self._live = LiveTree(lambda: self.clock.time_ns, state.snapshot)
        self._tree = TreeViewerProtocol(self._live, meshes=self._files)
        self._drake = DrakeViewer(self._live, self._files, state=state.drake.copy())

    def _read_next(self) -> None:
        event = next(self._events, None)
        self.next_event = event
        if event is None:
            self.position = self._file.tell()
        else:
            self.position = event.position
            self._next_clock = self.clock.after(event.time_us)

    def _apply(self, event: Event) -> Sequence[str]:
        if not event.channel.startswith(wire.REQUEST):
            shown_channels, channel = self._drake.state.newest_numbers, channel_of(event.channel)
            if channel is None:
                return ()
            is_new = channel not in shown_channels and not channel.has_fixed_name
            if is_new and len(shown_channels) >= MAX_CHANNELS:
                return (f"{len(shown_channels)} channels of clouds and frames are shown, which is the limit",)
            return self._drake.handle(event.channel, event.data)
        response = self._tree.handle(event.data)
        if isinstance(response, FormatResponse):
            return ("its format or version is unknown",)
        return (*([response.error] if response.error else ()), *response.warnings)


def cost_of(event: Event) -> float:
    """Return the time to apply an event, in that of a small message: about 0.1 ms."""
    return 1.0 + len(event.data) / MIN_DATA_COST if event.data else SKIPPED_COST
