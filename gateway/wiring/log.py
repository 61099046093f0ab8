"""A log in place of the live tree (``scenegate view``)."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

from gateway.lcmlog.timeline import LogTimeline
from gateway.scene.live import LiveTree


class LogService:
    """Indexes a log while it is served."""

    def __init__(self, timeline: LogTimeline, on_progress: Callable[[float], None] = lambda progress: None) -> None:
        """
        Args:
            on_progress: called with the fraction of the log that is indexed.
        """
        self.timeline = timeline
        self.tree = LiveTree()
        """The live tree of the application: the last state of the log, when it is indexed."""
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
            "incomplete_messages": timeline.problems.count,
        }
        warnings = timeline.problems.listed()
        if timeline.summary.clock_sets:
            warnings.append(f"the recorder's clock was set {timeline.summary.clock_sets} times during the recording")
        return {**figures, "warnings": warnings} if warnings else figures

    async def run(self) -> None:
        """Index the log, show its last state in the live tree, then wait until cancelled, and close the log."""
        self.ready = True
        try:
            await self.timeline.build_index(self._on_progress)
            self.tree.replace(await self.timeline.snapshot_at(self.timeline.span[1]))
            await asyncio.Event().wait()
        finally:
            self.ready = False
            self.timeline.close()
