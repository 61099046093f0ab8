"""States of a tree over time: the history of the live tree, or a log."""

from __future__ import annotations

from typing import Protocol

from gateway.scene.live import Snapshot


class Timeline(Protocol):
    """States of the tree over time."""

    @property
    def span(self) -> tuple[int, int]:
        """First and last time that have a state, nanoseconds since the epoch. The last one of a live tree advances."""

    async def snapshot_at(self, time: int) -> Snapshot:
        """Return the state that was valid at a time; times outside the span are clamped.

        A call with a time at which the same state was valid returns a snapshot of the same revision.
        """
