"""Flow control of one browser: which snapshot and meshes its page has, and when it gets the next update; no I/O.

The page acknowledges each update after processing it, and only then gets the next one, which leads to the newest
revision. A slow browser therefore skips revisions instead of building up a queue.
"""

from __future__ import annotations

from enum import Enum, auto

from gateway.scene.live import Snapshot
from gateway.viewer.encoder import EMPTY, Encoder, Update
from gateway.viewer.frames import FrameBuilder


class BrowserState(Enum):
    """State of one connection."""

    NEW = auto()
    """The page has received nothing yet. It gets an update even if the scene is empty."""
    READY = auto()
    """The page has acknowledged its last update."""
    BUSY = auto()
    """The page has not acknowledged its last update; it gets no other one until then."""
    CLOSED = auto()
    """The connection is closed."""


class FlowControl:
    """The snapshot and the meshes that one page has. Belongs to the event loop."""

    def __init__(self, encoder: Encoder) -> None:
        self.state = BrowserState.NEW
        self._encoder = encoder
        self._page_snapshot: Snapshot = EMPTY
        self._epoch = encoder.epoch
        self._page_meshes: set[int] = set()
        self._outdated_meshes: set[int] = set()
        """Ids of meshes that the page has and that no longer exist."""

    @property
    def update_due(self) -> bool:
        """True if the page should be sent an update now."""
        if self.state is not BrowserState.READY:
            return self.state is BrowserState.NEW
        return self._epoch != self._encoder.epoch or self._page_snapshot.revision != self._encoder.current.revision

    async def next_update(self) -> Update:
        """Return the update to the newest snapshot; the page is busy from now on."""
        self.state = BrowserState.BUSY
        while True:
            if self._epoch != self._encoder.epoch:
                self._page_snapshot, self._epoch = EMPTY, self._encoder.epoch
            update, self._page_snapshot = await self._encoder.update(self._page_snapshot)
            if self._epoch == self._encoder.epoch:
                return update

    def take_missing_meshes(self, update: Update) -> list[int]:
        """Return the ids of an update's meshes that the page does not have; they count as sent."""
        missing = sorted(update.meshes - self._page_meshes)
        self._page_meshes.update(missing)
        return missing

    def acknowledge(self) -> None:
        """Note that the page has processed its last update."""
        if self.state is BrowserState.BUSY:
            self.state = BrowserState.READY

    def drop_snapshot(self) -> None:
        """Release the snapshot of a page that does not acknowledge; its next update is the whole scene."""
        if self.state is BrowserState.BUSY:
            self._page_snapshot = EMPTY

    def remove_meshes(self, removed: set[int]) -> None:
        """Note that these meshes no longer exist."""
        outdated = self._page_meshes & removed
        self._page_meshes -= outdated
        self._outdated_meshes |= outdated

    def take_forget_frame(self) -> bytes | None:
        """Return a frame that makes the page drop the meshes that no longer exist; None if it has none of them."""
        if not self._outdated_meshes:
            return None
        outdated, self._outdated_meshes = self._outdated_meshes, set()
        return FrameBuilder().finish({"kind": "forget", "meshes": sorted(outdated)})
