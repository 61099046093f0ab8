"""The connected browsers, and the loop that sends them updates of the live tree, or of another time."""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import msgspec

from gateway.adapters.viewer.browser import Browser, BrowserState
from gateway.adapters.viewer.config import ViewerConfig
from gateway.adapters.viewer.encoder import Encoder, encode_page, encode_stereo_rig
from gateway.adapters.viewer.frames import ControlFrames, encode
from gateway.adapters.viewer.light import encode_light
from gateway.adapters.viewer.messages import ControlChange, Fact, Received, Status
from gateway.adapters.viewer.resources import Resources
from gateway.adapters.viewer.sources import StereoSource
from gateway.runtime.logs.render_record import RenderRecord
from gateway.scene.page.live_page import LivePage
from gateway.scene.tree.live import LiveTree, Snapshot
from gateway.scene.tree.timeline import Timeline
from scenegate.messages.clicks import Button, Click


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
        status: Callable[[], Status] = Status,
        stereo: StereoSource | None = None,
        renders: Sequence[RenderRecord] = (),
        live_page: LivePage | None = None,
        timeline: Timeline | None = None,
        has_live: bool = True,
    ) -> None:
        """``status`` returns the content of the page's status bar, to which the hub adds figures of its own; called
        every ``status_seconds`` while browsers are connected. ``timeline``: states that pages can go to; None: pages
        are always live. ``has_live``: True if its end is the live tree.
        """
        self.config = config
        self.resources = Resources()
        self._tree = tree
        self._status_source = status
        self._stereo = stereo
        self._renders = renders
        self._timeline = timeline
        self._has_live = has_live
        self._live_page = live_page or LivePage()
        self._live_page.listen(self._send_page_settings)
        self._page_settings_frame = encode_page(self._live_page)
        """The frame with view settings and clickable paths that was sent last."""
        self._encoder = Encoder(self.resources, config.max_node_ids)
        self._browsers: set[Browser] = set()
        self._changed = asyncio.Event()
        """Set when the tree or a control has changed."""
        self._controls = ControlFrames(self._live_page.controls, tree)
        self._live_page.controls.listen(self._changed.set)  # controls change on the event loop only
        self.ready = False
        """True while ``run`` runs."""

    def status(self) -> dict[str, Any]:
        """Return the number of browsers and the revision of the scene, for health and metrics."""
        return {"browsers": len(self._browsers), "revision": self._encoder.current.revision}

    async def run(self) -> None:
        """Send updates and, every ``status_seconds``, the status until cancelled."""
        loop = asyncio.get_running_loop()
        stop_listening = self._tree.listen(partial(loop.call_soon_threadsafe, self._changed.set))
        self._changed.set()  # the tree may have changed before
        status_time = loop.time()
        self.ready = True
        try:
            while True:
                with suppress(TimeoutError):
                    async with asyncio.timeout_at(status_time):
                        await self._changed.wait()
                update_start = loop.time()
                if update_start >= status_time:
                    status_time = update_start + self.config.status_seconds
                    self._send_status()
                if not self._changed.is_set():
                    continue
                self._changed.clear()
                if self._live_page.controls.clients:
                    self._live_page.controls.deliver_values()  # those that pages have set since the last update
                if self._browsers:
                    self._advance()
                    for browser in self._browsers:
                        browser.wake()
                await asyncio.sleep(max(0.0, update_start + 1.0 / self.config.max_update_rate - loop.time()))
        finally:
            self.ready = False
            stop_listening()
            for browser in tuple(self._browsers):
                browser.close()

    def _advance(self) -> None:
        """Pass the tree's newest snapshot to the encoder, and the stereo camera's pose in it to the pages."""
        self._encoder.advance(self._tree.snapshot)
        frame = self._rig_frame(self._encoder.current)
        for browser in self._browsers:
            if browser.follows_live:
                browser.send_rig(frame)

    def _rig_frame(self, snapshot: Snapshot) -> bytes:
        return encode_stereo_rig(self._stereo.rig(snapshot) if self._stereo is not None else None)

    def _send_page_settings(self) -> None:
        """Send view settings and clickable paths to all browsers if they have changed."""
        frame = encode_page(self._live_page)
        if frame != self._page_settings_frame:
            self._page_settings_frame = frame
            for browser in self._browsers:
                browser.send_latest("page", frame)

    def click(self, browser: Browser, node_id: int, point: tuple[float, float, float], button: Button) -> None:
        """Pass a click in a page to the clients that want it. Clicks on nodes that were removed are dropped.

        In a page that shows another time, it is a click on the path of the node that was there then.
        """
        path = self._encoder.path_of(node_id)
        shown_snapshot = self._tree.snapshot if browser.follows_live else browser.target
        if path is not None and shown_snapshot.root.find(path) is not None:
            self._live_page.clicks.click(Click(path, point, button))

    def change_control(self, browser: Browser, change: ControlChange) -> None:
        """Execute a change of a control in a page, and say so."""
        self._controls.change(change)
        browser.send_latest("received", encode(Received(number=change.number)))

    def _send_status(self) -> None:
        """Send the status to all browsers; forget clients, meshes and pages that have gone."""
        self._live_page.controls.remove_vanished()
        removed_meshes = self.resources.take_removed_meshes()
        if not self._browsers:
            return
        now = asyncio.get_running_loop().time()
        frame = self._status_frame()
        self._send_page_settings()  # subscriptions to clicks end without notice
        for browser in self._browsers:
            if browser.state is not BrowserState.RELEASED:  # the stereo camera may have been placed elsewhere
                browser.send_rig(self._rig_frame(browser.target))
            browser.remove_meshes(removed_meshes)
            browser.send_latest("status", frame)
            browser.drop_snapshot_if_sent_before(now - self.config.ack_timeout_seconds)
            if browser.playback is not None:
                browser.playback.tick()

    def _status_frame(self) -> bytes:
        status = self._status_source()
        facts = [*status.facts, Fact(name="viewers", value=len(self._browsers))]
        render_count = self._renders[-1].number if self._renders else 0
        return encode(msgspec.structs.replace(status, facts=facts, renders=render_count))

    def connect(self) -> Browser:
        """Add a browser. Raises ConnectionRefusedError if there are ``max_browsers`` already."""
        if len(self._browsers) >= self.config.max_browsers:
            raise ConnectionRefusedError(
                f"{len(self._browsers)} browsers are connected, which is the limit (max_browsers)"
            )
        self._advance()
        browser = Browser(self._encoder, self.resources, self._controls, self._browsers.discard)
        browser.send_latest("light", encode_light(self.config.style.rig))
        browser.send_rig(self._rig_frame(self._encoder.current))
        if self._timeline is not None:
            browser.follow(self._timeline, has_live=self._has_live, rig_frame=self._rig_frame)
        self._send_page_settings()
        browser.send_latest("page", self._page_settings_frame)
        browser.send_latest("status", self._status_frame())
        self._browsers.add(browser)
        return browser
