"""One browser's side of the conversation, without I/O: what it has, what it may be sent next.

Flow is by credit: the page says "ready" when it has taken a frame in, and only then gets the newest state, however
many revisions lie between. A slow browser therefore skips frames, and never makes a queue.
"""

from __future__ import annotations

from collections.abc import Iterator

from gateway.scene.live import Snapshot
from gateway.viewer.encoder import EMPTY, Encoder, Update
from gateway.viewer.frames import FrameBuilder
from gateway.viewer.payloads import Payloads


class Session:
    """Lives on the event loop."""

    def __init__(self, encoder: Encoder, payloads: Payloads) -> None:
        self._encoder = encoder
        self._payloads = payloads
        self._have: Snapshot = EMPTY
        self._epoch = encoder.epoch
        self._known: set[int] = set()
        self._told = False
        self.credit = True
        """Whether the page is ready for another update."""

    @property
    def behind(self) -> bool:
        """Whether there is something newer than what the page has; at first it has nothing, not even an empty scene."""
        if not self._told or self._epoch != self._encoder.epoch:
            return True
        return self._have.revision != self._encoder.current.revision

    def missing(self, update: Update) -> list[int]:
        """Meshes that the page needs for an update and does not have."""
        return sorted(update.meshes - self._known)

    async def next_update(self) -> Update:
        """The update to the newest state; uses up the credit. A big one does not hold the event loop."""
        self.credit = False
        self._told = True
        while True:
            if self._epoch != self._encoder.epoch:
                self._have, self._epoch = EMPTY, self._encoder.epoch
            update, self._have = await self._encoder.update(self._have)
            if self._epoch == self._encoder.epoch:
                return update

    def let_go(self) -> None:
        """Keeps an old scene alive no longer for a page that does not take its update in: the next one starts over."""
        if not self.credit:
            self._have = EMPTY

    def sent(self, meshes: list[int]) -> None:
        """Notes meshes that are on their way."""
        self._known.update(meshes)

    def knows(self, mesh: int) -> bool:
        """Whether the page was sent this mesh and not told to drop it."""
        return mesh in self._known

    def forget(self, gone: set[int]) -> Iterator[bytes]:
        """Frames that let the page drop meshes which nothing uses any more."""
        dropped = self._known & gone
        if dropped:
            self._known -= dropped
            yield FrameBuilder().finish({"kind": "forget", "meshes": sorted(dropped)})
