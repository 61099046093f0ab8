"""The connection to one page: the snapshot and meshes that the page has, and the frames to send to it. It does no I/O.

The page acknowledges each update after processing it. Only then does it receive the next update, which leads to the
newest revision, or to the state of another time. A slow page therefore skips revisions, and no queue builds up.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from enum import Enum, auto
from functools import partial
from typing import Final

from gateway.adapters.viewer.encoder import EMPTY_SNAPSHOT, Encoder, Update
from gateway.adapters.viewer.frames import ControlFrames, encode
from gateway.adapters.viewer.messages import Forget, TimeCommand
from gateway.adapters.viewer.playback import Playback
from gateway.adapters.viewer.resources import Resources
from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.timeline import Timeline

LARGE_MESH_BYTES: Final = 1 << 20
"""Meshes with larger arrays are encoded in a thread, because that takes milliseconds."""


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


class Browser:
    """The connection to one page. Not thread-safe: it is used in the event loop only."""

    def __init__(
        self, encoder: Encoder, resources: Resources, controls: ControlFrames, on_close: Callable[[Browser], None]
    ) -> None:
        self.state = BrowserState.NEW
        self.playback: Playback | None = None
        """Time that the page shows; None: always the live scene."""
        self._playing: asyncio.Task[None] | None = None
        self._encoder = encoder
        self._resources = resources
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
        self._rig_frame = b""
        """The frame with the stereo camera's pose that was sent last."""
        self._controls = controls
        self._controls_revision = 0
        """Revision of the controls that the page has, or will have when it has processed the last frame."""
        self._controls_due = True
        """False until the page has acknowledged the last frame of controls: a slow page skips values in between."""
        self._on_close = on_close
        self._wake_event = asyncio.Event()
        """Set when there may be a frame to send."""
        self._pending_frames: dict[str, bytes] = {}
        """The newest unsent frame of each kind that ``send_latest`` sends."""
        self._update_time = 0.0
        """Time of the last update, in seconds of the event loop's clock."""
        self.wake()

    def wake(self) -> None:
        """Make ``frames`` check whether there is a frame to send."""
        self._wake_event.set()

    @property
    def follows_live(self) -> bool:
        """True if the page is to show the newest snapshot."""
        return self._target is None

    @property
    def target(self) -> Snapshot:
        """The snapshot that the page is to show."""
        return self._target or self._encoder.current

    def acknowledge(self) -> None:
        """Record that the page has processed the last update."""
        if self.state is BrowserState.BUSY:
            self.state = BrowserState.READY
        self.wake()

    def acknowledge_controls(self) -> None:
        """Record that the page has processed the last frame of controls."""
        self._controls_due = True
        self.wake()

    def remove_meshes(self, mesh_ids: set[int]) -> None:
        """Make the page drop meshes that no longer exist, if it has them."""
        outdated = self._page_meshes & mesh_ids
        self._page_meshes -= outdated
        self._outdated_meshes |= outdated
        self.wake()

    def forgot(self, mesh_ids: list[int]) -> None:
        """Record that the page has dropped meshes. It says so before an acknowledgement: no update is on its way."""
        self._page_meshes.difference_update(mesh_ids)

    def drop_snapshot_if_sent_before(self, time: float) -> None:
        """Forget the page's snapshot if its update, sent before ``time``, is not acknowledged; the next is whole."""
        if self.state is BrowserState.BUSY and self._update_time < time:
            self._page_snapshot = EMPTY_SNAPSHOT

    def send_latest(self, kind: str, frame: bytes) -> None:
        """Send a frame of a kind such as ``status``. It replaces an unsent frame of the same kind."""
        self._pending_frames[kind] = frame
        self.wake()

    def send_rig(self, frame: bytes) -> None:
        """Send a frame with the stereo camera's pose if it is another one than the last."""
        if frame != self._rig_frame:
            self._rig_frame = frame
            self.send_latest("rig", frame)

    def follow(self, timeline: Timeline, *, has_live: bool, rig_frame: Callable[[Snapshot], bytes]) -> None:
        """Give the page a time bar. ``rig_frame`` returns the frame with the stereo camera's pose in a snapshot.

        ``has_live``: True if the end of the timeline is the live tree.
        """

        def show(snapshot: Snapshot | None) -> None:
            self._encoder.limit_ids()
            self._target = snapshot
            if self.state is BrowserState.RELEASED:
                self.state = BrowserState.NEW
            self.send_rig(rig_frame(self.target))
            self.wake()

        if not has_live:
            self.state = BrowserState.RELEASED  # no update before there is a state
        self.playback = Playback(
            timeline,
            has_live=has_live,
            show=show,
            release=self._release,
            send=lambda frame: self.send_latest("time", frame),
        )
        self.playback.tick()
        self._playing = asyncio.get_running_loop().create_task(self.playback.run(), name="view time")

    def execute(self, command: TimeCommand) -> None:
        """Execute a command of the page's time bar."""
        if self.playback is not None:
            self.playback.execute(command)

    def close(self) -> None:
        """Disconnect the browser: ``frames`` ends."""
        if self._playing is not None:
            self._playing.cancel()
        self.state = BrowserState.CLOSED
        self.wake()
        self._on_close(self)

    async def frames(self) -> AsyncIterator[bytes]:
        """Yield the frames to send until ``close``."""
        while True:
            await self._wake_event.wait()
            self._wake_event.clear()
            if self.state is BrowserState.CLOSED:
                return
            while self._pending_frames:
                yield self._pending_frames.pop(next(iter(self._pending_frames)))
            if self._controls_due and self._controls_revision != self._controls.store.revision:
                self._controls_due = False
                controls = self._controls.since(self._controls_revision)
                self._controls_revision = self._controls.store.revision
                yield controls
            if (forget := self.take_forget_frame()) is not None:
                yield forget
            if self.update_due:
                update = await self.next_update()
                self._update_time = asyncio.get_running_loop().time()
                for mesh_id in self.take_missing_meshes(update):
                    is_large = self._resources.bytes_to_encode(mesh_id) > LARGE_MESH_BYTES
                    encode_mesh = partial(self._resources.mesh_frame, mesh_id)
                    frame = await asyncio.to_thread(encode_mesh) if is_large else encode_mesh()
                    if frame is not None:
                        yield frame
                yield update.frame

    @property
    def update_due(self) -> bool:
        """True if an update should be sent to the page now."""
        if self.state is not BrowserState.READY:
            return self.state is BrowserState.NEW
        target = self._target or self._encoder.current
        return self._epoch != self._encoder.epoch or self._page_snapshot.revision != target.revision

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

    def take_forget_frame(self) -> bytes | None:
        """Return a frame that drops outdated meshes; None without, or while the page shows a released state."""
        if not self._outdated_meshes or self.state is BrowserState.RELEASED:
            return None
        outdated, self._outdated_meshes = self._outdated_meshes, set()
        return encode(Forget(meshes=sorted(outdated)))

    def _release(self) -> None:
        """Drop the snapshot if the page shows the target. The next update is then the whole scene."""
        if self.state is BrowserState.READY and not self.update_due:
            self._target = self._page_snapshot = EMPTY_SNAPSHOT
            self.state = BrowserState.RELEASED
