"""Flow control of one page: which snapshot and meshes it has, and when its next update is due. It does no I/O.

The page acknowledges each update after processing it. Only then does it receive the next update, which leads to the
newest revision, or to the state of another time. A slow page therefore skips revisions, and no queue builds up. ``hub``
has one object per browser.
"""

from __future__ import annotations

from enum import Enum, auto

from gateway.scene.live import Snapshot
from gateway.viewer.encoder import EMPTY_SNAPSHOT, Encoder, Update
from gateway.viewer.frames import encode
from gateway.viewer.messages import Forget


class BrowserState(Enum):
    """State of the connection to one page."""

    NEW = auto()
    """The page has received no update. An update is due even if the scene is empty."""
    READY = auto()
    """The page has acknowledged its last update."""
    BUSY = auto()
    """The page has not acknowledged its last update. No further update is sent until it does."""
    RELEASED = auto()
    """The page shows a state that the gateway has no more. It gets no update until it shows another one."""
    CLOSED = auto()
    """The connection is closed."""


class FlowControl:
    """The snapshot and meshes of one page. Not thread-safe: it is used in the event loop only."""

    def __init__(self, encoder: Encoder) -> None:
        self.state = BrowserState.NEW
        self._encoder = encoder
        self._target: Snapshot | None = None
        """The state that the page is to show; None: the newest."""
        self._page_snapshot: Snapshot = EMPTY_SNAPSHOT
        """The snapshot that the page has, or will have after it has processed its last update."""
        self._epoch = encoder.epoch
        """Epoch of the node ids that the page has."""
        self._page_meshes: set[int] = set()
        """Ids of the meshes that were sent to the page and still exist."""
        self._outdated_meshes: set[int] = set()
        """Ids of the meshes that were sent to the page and no longer exist."""

    @property
    def update_due(self) -> bool:
        """True if an update should be sent to the page now."""
        if self.state is not BrowserState.READY:
            return self.state is BrowserState.NEW
        return (
            self._epoch != self._encoder.epoch
            or self._page_snapshot.revision != (self._target or self._encoder.current).revision
        )

    @property
    def follows_live(self) -> bool:
        """True if the page is to show the newest snapshot."""
        return self._target is None

    @property
    def target(self) -> Snapshot:
        """The snapshot that the page is to show."""
        return self._target or self._encoder.current

    def show(self, snapshot: Snapshot | None) -> None:
        """Make a snapshot the target of the next updates; None: always the newest one."""
        self._encoder.limit_ids()
        self._target = snapshot
        if self.state is BrowserState.RELEASED:
            self.state = BrowserState.NEW

    def release(self) -> None:
        """Drop the snapshot if the page shows the target. The next update, after ``show``, is the whole scene."""
        if self.state is BrowserState.READY and not self.update_due:
            self._target = self._page_snapshot = EMPTY_SNAPSHOT
            self.state = BrowserState.RELEASED

    async def next_update(self) -> Update:
        """Return the update to the target, and set the state to ``BUSY``."""
        self.state = BrowserState.BUSY
        while True:
            if self._epoch != self._encoder.epoch:
                self._page_snapshot, self._epoch = EMPTY_SNAPSHOT, self._encoder.epoch
            update, self._page_snapshot = await self._encoder.update(self._page_snapshot, self._target)
            if self._epoch == self._encoder.epoch:
                return update

    def take_missing_meshes(self, update: Update) -> list[int]:
        """Return the ids of the update's meshes that the page does not have. They count as sent from now on."""
        missing = sorted(update.meshes - self._page_meshes)
        self._page_meshes.update(missing)
        return missing

    def acknowledge(self) -> None:
        """Set the state to ``READY``, because the page has processed its last update."""
        if self.state is BrowserState.BUSY:
            self.state = BrowserState.READY

    def drop_snapshot(self) -> None:
        """Release the snapshot if the state is ``BUSY``. The next update is then the whole scene."""
        if self.state is BrowserState.BUSY:
            self._page_snapshot = EMPTY_SNAPSHOT

    def remove_meshes(self, mesh_ids: set[int]) -> None:
        """Mark meshes that no longer exist as outdated, if the page has them."""
        outdated = self._page_meshes & mesh_ids
        self._page_meshes -= outdated
        self._outdated_meshes |= outdated

    def forgot(self, mesh_ids: list[int]) -> None:
        """Record that the page has dropped meshes. It says so before an acknowledgement: no update is on its way."""
        self._page_meshes.difference_update(mesh_ids)

    def take_forget_frame(self) -> bytes | None:
        """Return a frame by which the page drops its outdated meshes, or None if it has none.

        A page that shows a released state still needs them.
        """
        if not self._outdated_meshes or self.state is BrowserState.RELEASED:
            return None
        outdated, self._outdated_meshes = self._outdated_meshes, set()
        return encode(Forget(meshes=sorted(outdated)))
