"""The snapshot and meshes of one browser, and the time of its next update; no I/O.

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
    """The page has not acknowledged its last update, and gets no other one."""
    CLOSED = auto()
    """The connection is closed."""


class FlowControl:
    """The snapshot and the meshes that one page has. Belongs to the event loop."""

    def __init__(self, encoder: Encoder) -> None:
        self.state = BrowserState.NEW
        self._encoder = encoder
        self._have: Snapshot = EMPTY
        self._epoch = encoder.epoch
        self._meshes: set[int] = set()
        self._dropped: set[int] = set()
        """Meshes that the page has and that no longer exist."""

    @property
    def update_due(self) -> bool:
        """True if the page should be sent an update now."""
        if self.state is not BrowserState.READY:
            return self.state is BrowserState.NEW
        return self._epoch != self._encoder.epoch or self._have.revision != self._encoder.current.revision

    async def next_update(self) -> Update:
        """Return the update to the newest snapshot; the page is busy from now on."""
        self.state = BrowserState.BUSY
        while True:
            if self._epoch != self._encoder.epoch:
                self._have, self._epoch = EMPTY, self._encoder.epoch
            update, self._have = await self._encoder.update(self._have)
            if self._epoch == self._encoder.epoch:
                return update

    def take_missing_meshes(self, update: Update) -> list[int]:
        """Return the ids of an update's meshes that the page does not have; they count as sent."""
        missing = sorted(update.meshes - self._meshes)
        self._meshes.update(missing)
        return missing

    def acknowledge(self) -> None:
        """Note that the page has processed its last update."""
        if self.state is BrowserState.BUSY:
            self.state = BrowserState.READY

    def drop_snapshot(self) -> None:
        """Release the snapshot of a page that does not acknowledge; its next update is the whole scene."""
        if self.state is BrowserState.BUSY:
            self._have = EMPTY

    def remove_meshes(self, removed: set[int]) -> None:
        """Note that these meshes no longer exist."""
        dropped = self._meshes & removed
        self._meshes -= dropped
        self._dropped |= dropped

    def take_forget_frame(self) -> bytes | None:
        """Return a frame that makes the page drop the meshes that no longer exist; None if it has none of them."""
        if not self._dropped:
            return None
        dropped, self._dropped = self._dropped, set()
        return FrameBuilder().finish({"kind": "forget", "meshes": sorted(dropped)})
