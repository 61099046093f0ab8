"""The connection to one page, and the frames to send to it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Final

from gateway.scene.live import Snapshot
from gateway.scene.timeline import Timeline
from gateway.viewer.control_frames import ControlFrames
from gateway.viewer.flow_control import BrowserState, FlowControl
from gateway.viewer.messages import TimeCommand
from gateway.viewer.playback import Playback
from gateway.viewer.resources import Resources

LARGE_MESH_BYTES: Final = 1 << 20
"""Meshes with larger arrays are encoded in a thread, because that takes milliseconds."""


class Browser:
    """The connection to one page. ``frames`` yields the frames to send."""

    def __init__(
        self, flow: FlowControl, resources: Resources, controls: ControlFrames, on_close: Callable[[Browser], None]
    ) -> None:
        self.flow = flow
        self.playback: Playback | None = None
        """Time that the page shows; None: always the live scene."""
        self._playing: asyncio.Task[None] | None = None
        self._rig_frame = b""
        """The frame with the stereo camera's pose that was sent last."""
        self._resources = resources
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

    def acknowledge(self) -> None:
        """Record that the page has processed the last update."""
        self.flow.acknowledge()
        self.wake()

    def acknowledge_controls(self) -> None:
        """Record that the page has processed the last frame of controls."""
        self._controls_due = True
        self.wake()

    def remove_meshes(self, mesh_ids: set[int]) -> None:
        """Make the page drop meshes that no longer exist, if it has them."""
        self.flow.remove_meshes(mesh_ids)
        self.wake()

    def drop_snapshot_if_sent_before(self, time: float) -> None:
        """Release the page's snapshot if its last update was sent before ``time`` and is not acknowledged.

        Args:
            time: seconds of the event loop's clock.
        """
        if self._update_time < time:
            self.flow.drop_snapshot()

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
        """Give the page a time bar.

        Args:
            has_live: True if the end of the timeline is the live tree.
            rig_frame: returns the frame with the stereo camera's pose in a snapshot.
        """

        def show(snapshot: Snapshot | None) -> None:
            self.flow.show(snapshot)
            self.send_rig(rig_frame(self.flow.target))
            self.wake()

        if not has_live:
            self.flow.state = BrowserState.RELEASED  # no update before there is a state
        self.playback = Playback(
            timeline,
            has_live=has_live,
            show=show,
            release=self.flow.release,
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
        self.flow.state = BrowserState.CLOSED
        self.wake()
        self._on_close(self)

    async def frames(self) -> AsyncIterator[bytes]:
        """Yield the frames to send until ``close``."""
        while True:
            await self._wake_event.wait()
            self._wake_event.clear()
            if self.flow.state is BrowserState.CLOSED:
                return
            while self._pending_frames:
                yield self._pending_frames.pop(next(iter(self._pending_frames)))
            if self._controls_due and self._controls_revision != self._controls.store.revision:
                self._controls_due = False
                controls = self._controls.since(self._controls_revision)
                self._controls_revision = self._controls.store.revision
                yield controls
            forget = self.flow.take_forget_frame()
            if forget is not None:
                yield forget
            if self.flow.update_due:
                update = await self.flow.next_update()
                self._update_time = asyncio.get_running_loop().time()
                for mesh_id in self.flow.take_missing_meshes(update):
                    frame = await self._mesh_frame(mesh_id)
                    if frame is not None:
                        yield frame
                yield update.frame

    async def _mesh_frame(self, mesh_id: int) -> bytes | None:
        """Return the frame of a mesh, or None if the mesh no longer exists."""
        if self._resources.bytes_to_encode(mesh_id) > LARGE_MESH_BYTES:
            return await asyncio.to_thread(self._resources.mesh_frame, mesh_id)
        return self._resources.mesh_frame(mesh_id)
