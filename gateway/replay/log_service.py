"""A log in place of the live tree (``scenegate view``)."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any, Final

from gateway.replay.log_timeline import LogTimeline
from gateway.scene.tree.live import LiveTree

SHOW_SECONDS: Final = 1.0
"""Time between two states in the live tree while the log is indexed."""


class LogService:
    """Indexes a log while it is served."""

    def __init__(self, timeline: LogTimeline, on_progress: Callable[[float], None] = lambda progress: None) -> None:
        """``on_progress`` is called with the fraction of the log that is indexed."""
        self.timeline = timeline
        self.tree = LiveTree()
        """The live tree of the application: the last state of the part of the log that is indexed."""
        self._shown_time = -SHOW_SECONDS
        """Time of the last replacement of the live tree, in seconds of the event loop's clock."""
        self._on_progress = on_progress
        self.ready = False

    def status(self) -> Mapping[str, Any]:
        """Return figures of the log, and which messages cannot be shown."""
        timeline = self.timeline
        begin, end = timeline.span
        figures: dict[str, Any] = {
            "messages": timeline.summary.events,
            "shown_messages": timeline.summary.shown,
            "seconds": (end - begin) / 1e9,
            "indexed": round(timeline.progress, 3),
            "incomplete_messages": timeline.incomplete.count,
        }
        warnings = timeline.incomplete.listed()
        if timeline.summary.clock_sets:
            warnings.append(
                f"the recorder's clock was set during the recording, number of times: {timeline.summary.clock_sets}"
            )
        return {**figures, "warnings": warnings} if warnings else figures

    async def run(self) -> None:
        """Index the log into the live tree, then wait until cancelled, and close the log."""
        self.ready = True
        try:
            await self.timeline.build_index(self._show)
            self.tree.replace(self.timeline.newest)
            await asyncio.Event().wait()
        finally:
            self.ready = False
            self.timeline.close()

    def _show(self, progress: float) -> None:
        self._on_progress(progress)
        now = asyncio.get_running_loop().time()
        if now >= self._shown_time + SHOW_SECONDS:
            self._shown_time = now
            self.tree.replace(self.timeline.newest)
