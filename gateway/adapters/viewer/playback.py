"""The time that a page shows: the live scene, or a moment of a timeline, at rest or playing.

The page sends a ``TimeCommand``; the gateway moves the page's target. The page learns the result by frames of the kind
``time``.
"""

import asyncio
from collections.abc import Callable
from enum import StrEnum
from typing import Final

from gateway.adapters.viewer.frames import encode
from gateway.adapters.viewer.messages import TimeCommand, TimeState
from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.timeline import Timeline, next_state

PLAY_PERIOD: Final = 1.0 / 60.0
"""Seconds between two states of a page that plays or whose time is dragged."""
WORKING_SECONDS: Final = 0.15
"""Time after which a page says that a state is being looked for."""
AFTER_CHANGE_NS: Final = 1000
"""Time after a change at which a step stops: seconds as float64 are exact to 240 nanoseconds."""
DRAG_NS: Final = 1_000_000_000
"""Time before the first state to which a page still seeks while its bar is dragged: a live span moves meanwhile."""
MAX_STEPS: Final = 10
"""Maximum number of steps that wait; each may take a second in a log."""


class Mode(StrEnum):
    """State of a page's time."""

    LIVE = "live"
    PLAYING = "playing"
    PAUSED = "paused"


class Playback:
    """Time of one page. Not thread-safe: it is used in the event loop only, and works while ``run`` runs."""

    def __init__(
        self,
        timeline: Timeline,
        *,
        has_live: bool,
        show: Callable[[Snapshot | None], None],
        release: Callable[[], None],
        send: Callable[[bytes], None],
    ) -> None:
        """``has_live``: True if the timeline's end is the live scene; otherwise the page plays from the start.

        ``show`` makes a state, or the live scene (None), the target of the page; ``send`` sends it a frame; ``release``
        lets it show its state without the gateway, which does not keep it any more.
        """
        self.mode = Mode.LIVE if has_live else Mode.PLAYING
        self._timeline = timeline
        self._has_live = has_live
        self._show = show
        self._release = release
        self._send = send
        self._rate = 1.0
        self._loop_end: int | None = None
        """Time at which playing starts again at the first state; None: it does not. A live scene's end moves."""
        self._snapshot: Snapshot | None = None
        """The state that the page shows; None: the live one, or one that was released."""
        self._steps = 0
        """Number of changes to go forward, or back if negative."""
        self._is_working = False
        self._error = ""
        self._changed = asyncio.Event()
        """Set after a command."""
        self._move(timeline.span[0])

    def execute(self, command: TimeCommand) -> None:
        """Execute a command of the page."""
        first, last = self._timeline.span
        position = self._position()
        self._error = ""
        self._rate = self._rate if command.rate is None else command.rate
        if command.loop is not None:
            self._loop_end = last if command.loop else None
        match command.time:
            case "live" if self._has_live:
                self._go_live()
            case "play" if self.mode is not Mode.LIVE:
                position = first if position >= last else position
                self.mode = Mode.PLAYING
            case "pause":
                self.mode = Mode.PAUSED
            case "seek":
                wanted = round(command.at * 1e9) if command.by is None else position + round(command.by * 1e9)
                position = min(max(wanted, first), last)
                if command.by is None and wanted < first - DRAG_NS:
                    self._error = "That time is older than what is kept: this is the oldest state"
                if self._has_live and command.by is not None and wanted >= last:
                    self._go_live()
                elif self.mode is Mode.LIVE:
                    self.mode = Mode.PAUSED
            case "step":
                self.mode = Mode.PAUSED
                self._steps = max(-MAX_STEPS, min(self._steps + command.steps, MAX_STEPS))
            case _:
                pass
        self._move(position)
        self._changed.set()

    def tick(self) -> None:
        """Send the span to the page. Called once a second.

        A state that is older than the timeline is pinned for images and files, or else released.
        """
        if self.mode is Mode.PAUSED and self._position() < self._timeline.span[0] and not self._pin():
            self._snapshot = None
            self._release()
        self._send(self.frame())

    def _pin(self) -> bool:
        """Return True if the state stays in the timeline while the page shows it."""
        return self._snapshot is not None and self._timeline.pin(self._position(), self._snapshot)

    def frame(self) -> bytes:
        """Return the frame with mode, position and span, seconds since the epoch, and the time of the simulation."""
        first, last = self._timeline.span
        position = self._position()
        return encode(
            TimeState(
                mode=self.mode.value,
                live=self._has_live,
                rate=self._rate,
                loop=self._loop_end is not None,
                working=self._is_working,
                problem=self._error,
                simulation=self._timeline.simulation_seconds_at(position),
                position=position / 1e9,
                first=first / 1e9,
                last=last / 1e9,
            )
        )

    async def run(self) -> None:
        """Show what the commands say, until cancelled. Of the seeks that come while one takes time, the last counts."""
        while True:
            if self.mode is not Mode.PLAYING:
                await self._changed.wait()
            self._changed.clear()
            if self.mode is Mode.PLAYING:
                self._pass_end()
            if self.mode is not Mode.LIVE:
                await self._follow()
            self._send(self.frame())
            await asyncio.sleep(PLAY_PERIOD)

    async def _follow(self) -> None:
        """Find the state of the position, and show it unless the page has gone live since."""
        steps, self._steps = self._steps, 0
        slow = asyncio.get_running_loop().call_later(WORKING_SECONDS, self._say_working)
        try:
            snapshot = await self._timeline.snapshot_at(self._position())
            if steps:
                snapshot = await next_state(self._timeline, self._snapshot or snapshot, steps)
        except (OSError, ValueError, RuntimeError) as error:
            self.mode, self._error = Mode.PAUSED, str(error)
            return
        finally:
            slow.cancel()
            self._is_working = False
        if self.mode is Mode.LIVE:
            return
        if steps and not self._changed.is_set():
            self._move(snapshot.timestamp + AFTER_CHANGE_NS)
        self._snapshot = snapshot
        self._show(snapshot)

    def _say_working(self) -> None:
        self._is_working = True
        self._send(self.frame())

    def _position(self) -> int:
        """Return the time that the page shows now, nanoseconds since the epoch."""
        if self.mode is Mode.LIVE:
            return self._timeline.span[1]
        if self.mode is Mode.PAUSED:
            return self._start
        passed = asyncio.get_running_loop().time() - self._start_time
        return self._start + round(passed * self._rate * 1e9)

    def _move(self, position: int) -> None:
        """Go to a time, from which a page that plays goes on."""
        self._start, self._start_time = position, asyncio.get_running_loop().time()

    def _pass_end(self) -> None:
        """Start again, go live or pause when playing is at the end; go on at the first state that is kept."""
        first, last = self._timeline.span
        position = self._position()
        if position < first:
            self._move(first)
        elif self._loop_end is not None and position >= self._loop_end:
            self._loop_end = last
            self._move(first)
        elif position >= last:
            self._move(last)
            if self._has_live:
                self._go_live()
            else:
                self.mode, self._snapshot = Mode.PAUSED, None

    def _go_live(self) -> None:
        self.mode, self._snapshot = Mode.LIVE, None
        self._show(None)
