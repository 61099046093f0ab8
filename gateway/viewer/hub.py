"""The connected browsers, and the loop that sends them updates of the live tree, or of another time.

``routes`` connects a WebSocket to a ``Browser``; ``gateway.wiring`` runs the ``ViewHub``.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from typing import Any, Final

from gateway.scene.clicks import Button, Click
from gateway.scene.live import LiveTree, Snapshot
from gateway.scene.live_page import LivePage
from gateway.scene.timeline import Timeline
from gateway.viewer.config import ViewerConfig
from gateway.viewer.control_frames import ControlChange, ControlFrames, received_frame
from gateway.viewer.encoder import Encoder, encode_page, encode_status, encode_stereo_rig
from gateway.viewer.flow_control import BrowserState, FlowControl
from gateway.viewer.playback import Playback, TimeCommand
from gateway.viewer.recent_renders import RecentRenders
from gateway.viewer.resources import Resources
from gateway.viewer.sources import StereoSource

LARGE_MESH_BYTES: Final = 1 << 20
"""Meshes with larger arrays are encoded in a thread, because that takes milliseconds."""


class ViewHub:
    """Sends the live tree to browsers while ``run`` runs. Not thread-safe: it is used in one event loop only.

    With a timeline, each page has a time bar. For a log, whose end is not live, give the hub its timeline, an empty
    tree and ``has_live=False``: ``ViewHub(config, LiveTree(), timeline=log, has_live=False)``. Its pages then play from
    the first state, and pause at the last. A log that cannot be read raises OSError, ValueError or RuntimeError in
    ``snapshot_at``, and the page shows the sentence.
    """

    def __init__(
        self,
        config: ViewerConfig,
        tree: LiveTree,
        *,
        status: Callable[[], Mapping[str, Any]] = dict,
        stereo: StereoSource | None = None,
        page: LivePage | None = None,
        timeline: Timeline | None = None,
        has_live: bool = True,
    ) -> None:
        """Create a hub without browsers.

        Args:
            config: limits and intervals.
            tree: the live tree.
            status: returns the content of the page's status bar. ``interfaces`` has state and problem of each interface
                by its name; ``facts`` is a list of values with ``name``, ``value`` and ``warn``. Called every
                ``status_seconds`` while browsers are connected.
            stereo: the stereo camera; None if there is none.
            page: view settings, clickable paths and controls, which clients of the tree viewer set.
            timeline: states of the scene that pages can go to; None: pages are always live.
            has_live: True if the end of the timeline is the live tree.
        """
        self.config = config
        self.resources = Resources()
        self.renders = RecentRenders(config.max_renders, config.max_render_bytes)
        self._tree = tree
        self._status_source = status
        self._stereo = stereo
        self._timeline = timeline
        self._has_live = has_live
        self._page = page or LivePage()
        self._page.listen(self._send_page)
        self._page_frame = encode_page(self._page)
        """The frame with view settings and clickable paths that was sent last."""
        self._encoder = Encoder(self.resources, config.max_node_ids)
        self._browsers: set[Browser] = set()
        self._changed = asyncio.Event()
        """Set when the tree or a control has changed."""
        self._controls = ControlFrames(self._page.controls, tree)
        self._page.controls.listen(self._changed.set)
        self._ready = False

    @property
    def ready(self) -> bool:
        """True while ``run`` runs."""
        return self._ready

    def status(self) -> dict[str, Any]:
        """Return the number of browsers and the revision of the scene, for health and metrics."""
        return {"browsers": len(self._browsers), "revision": self._encoder.current.revision}

    async def run(self) -> None:
        """Send updates until cancelled."""
        loop = asyncio.get_running_loop()

        def on_change(_: Snapshot) -> None:
            loop.call_soon_threadsafe(self._changed.set)

        stop_listening = self._tree.listen(on_change)
        status_task = loop.create_task(self._send_status(), name="view status")
        self._changed.set()
        self._ready = True
        try:
            while True:
                await self._changed.wait()
                update_start = loop.time()
                self._changed.clear()
                self._page.controls.deliver_values()
                if self._browsers:
                    self._take_snapshot()
                    self._remove_meshes()
                    for browser in self._browsers:
                        browser.wake()
                await asyncio.sleep(max(0.0, update_start + 1.0 / self.config.max_update_rate - loop.time()))
        finally:
            self._ready = False
            status_task.cancel()
            stop_listening()
            for browser in tuple(self._browsers):
                browser.close()

    def _take_snapshot(self) -> None:
        """Pass the tree's newest snapshot to the encoder; send the stereo camera's pose if it has changed."""
        self._encoder.advance(self._tree.snapshot)
        frame = self._rig_frame(self._encoder.current)
        for browser in self._browsers:
            if browser.flow.follows_live:
                browser.send_rig(frame)

    def _rig_frame(self, snapshot: Snapshot) -> bytes:
        """Return the frame with the stereo camera's pose in a snapshot."""
        return encode_stereo_rig(self._stereo.rig(snapshot) if self._stereo is not None else None)

    def _send_page(self) -> None:
        """Send view settings and clickable paths to all browsers if they have changed."""
        frame = encode_page(self._page)
        if frame != self._page_frame:
            self._page_frame = frame
            for browser in self._browsers:
                browser.send_latest("page", frame)

    def click(self, browser: Browser, node_id: int, point: tuple[float, float, float], button: Button) -> None:
        """Pass a click in a page to the clients that want it. Clicks on nodes that were removed are dropped.

        In a page that shows another time, it is a click on the path of the node that was there then.
        """
        path = self._encoder.path_of(node_id)
        shown = self._tree.snapshot if browser.flow.follows_live else browser.flow.target
        if path is not None and shown.root.find(path) is not None:
            self._page.clicks.click(Click(path, point, button))

    def change_control(self, browser: Browser, change: ControlChange) -> None:
        """Execute a change of a control in a page."""
        self._controls.change(change)
        browser.send_latest("received", received_frame(change.number))

    def _remove_meshes(self) -> None:
        """Make all pages drop the meshes that no longer exist."""
        removed = self.resources.take_removed_meshes()
        if removed:
            for browser in self._browsers:
                browser.remove_meshes(removed)

    async def _send_status(self) -> None:
        """Send the status to all browsers every ``status_seconds``; release the snapshots of pages that hang."""
        while True:
            self._page.controls.remove_vanished()
            if self._browsers:
                now = asyncio.get_running_loop().time()
                frame = self._status_frame()
                self._remove_meshes()
                self._send_page()  # subscriptions to clicks end without notice
                for browser in self._browsers:
                    browser.send_latest("status", frame)
                    browser.drop_snapshot_if_sent_before(now - self.config.ack_timeout_seconds)
                    if browser.playback is not None:
                        browser.playback.tick()
            await asyncio.sleep(self.config.status_seconds)

    def _status_frame(self) -> bytes:
        """Return the frame with the status, the number of browsers and the number of render requests."""
        status = dict(self._status_source())
        browsers = {"name": "viewers", "value": len(self._browsers)}
        return encode_status({**status, "facts": [*status.get("facts", ()), browsers], "renders": self.renders.count})

    def connect(self) -> Browser:
        """Add a browser.

        Raises:
            ConnectionRefusedError: there are ``max_browsers`` already.
        """
        if len(self._browsers) >= self.config.max_browsers:
            raise ConnectionRefusedError(
                f"{len(self._browsers)} browsers are connected, which is the limit (max_browsers)"
            )
        self._take_snapshot()
        browser = Browser(FlowControl(self._encoder), self.resources, self._controls, self._browsers.discard)
        browser.send_rig(self._rig_frame(self._encoder.current))
        if self._timeline is not None:
            browser.follow(self._timeline, has_live=self._has_live, rig_frame=self._rig_frame)
        self._send_page()
        browser.send_latest("page", self._page_frame)
        browser.send_latest("status", self._status_frame())
        self._browsers.add(browser)
        return browser


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
