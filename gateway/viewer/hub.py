"""Every browser's connection to the live tree: one encoder, one clock of updates, a task per browser."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Any, Final

from gateway.scene.live import LiveTree, Snapshot
from gateway.viewer.config import ViewerConfig
from gateway.viewer.encoder import Encoder, encode_rig, encode_status
from gateway.viewer.flow_control import Session
from gateway.viewer.payloads import Payloads
from gateway.viewer.renders import RecentRenders
from gateway.viewer.sources import ViewPorts

LARGE_MESH: Final = 1 << 20
"""Meshes of more bytes are encoded in a thread, so that the event loop is not held for milliseconds."""


class ViewHub:
    """Joins browsers to the tree. Lives on one event loop; ``run`` must be running."""

    def __init__(self, config: ViewerConfig, tree: LiveTree, ports: ViewPorts | None = None) -> None:
        self.config = config
        self.payloads = Payloads()
        self.renders = RecentRenders(config.max_renders, config.max_render_bytes)
        self._tree = tree
        self._ports = ports if ports is not None else ViewPorts()
        self._rig = b""
        self._encoder = Encoder(self.payloads, config.max_paths)
        self._browsers: set[Browser] = set()
        self._changed = asyncio.Event()
        self._ready = False

    @property
    def ready(self) -> bool:
        return self._ready

    def status(self) -> dict[str, Any]:
        """For the status bar, metrics and health."""
        return {"browsers": len(self._browsers), "revision": self._encoder.current.revision}

    async def run(self) -> None:
        """Watches the tree until cancelled."""
        loop = asyncio.get_running_loop()

        def changed(_: Snapshot) -> None:
            loop.call_soon_threadsafe(self._changed.set)

        def gone(number: int) -> None:
            loop.call_soon_threadsafe(self._forget, number)

        stop_listening = self._tree.listen(changed)
        stop_watching = self.payloads.when_gone(gone)
        status = loop.create_task(self._send_status(), name="view status")
        self._changed.set()
        self._ready = True
        try:
            while True:
                await self._changed.wait()
                begin = loop.time()
                self._changed.clear()
                if self._browsers:
                    self._advance()
                    for browser in tuple(self._browsers):
                        browser.wake.set()
                await asyncio.sleep(max(0.0, begin + 1.0 / self.config.rate - loop.time()))
        finally:
            self._ready = False
            status.cancel()
            stop_listening()
            stop_watching()
            for browser in tuple(self._browsers):
                browser.close()

    def _advance(self) -> None:
        """Takes the newest state in, and tells where the stereo camera is now."""
        snapshot = self._tree.snapshot
        self._encoder.advance(snapshot)
        rig = encode_rig(self._ports.rig(snapshot))
        if rig != self._rig:
            self._rig = rig
            for browser in tuple(self._browsers):
                browser.note("rig", rig)

    async def _send_status(self) -> None:
        while True:
            if self._browsers:
                late = asyncio.get_running_loop().time() - self.config.patience_seconds
                frame = self._status_frame()
                for browser in tuple(self._browsers):
                    browser.note("status", frame)
                    browser.let_go(late)
            await asyncio.sleep(self.config.status_seconds)

    def _status_frame(self) -> bytes:
        status = dict(self._ports.status())
        browsers = {"name": "viewers", "value": len(self._browsers)}
        return encode_status({**status, "facts": [*status.get("facts", ()), browsers], "renders": self.renders.count})

    def _forget(self, number: int) -> None:
        for browser in tuple(self._browsers):
            browser.forget(number)

    def connect(self) -> Browser:
        """A new browser.

        Raises:
            ConnectionRefusedError: there are ``max_browsers`` already.
        """
        if len(self._browsers) >= self.config.max_browsers:
            raise ConnectionRefusedError(
                f"{len(self._browsers)} browsers are connected, which is the limit (max_browsers)"
            )
        self._advance()
        browser = Browser(Session(self._encoder, self.payloads), self.payloads, self._browsers.discard)
        browser.note("rig", self._rig)
        browser.note("status", self._status_frame())
        self._browsers.add(browser)
        return browser


class Browser:
    """One connection: ``frames`` gives what to send, ``ready`` takes the page's word that it wants more."""

    def __init__(self, session: Session, payloads: Payloads, left: Callable[[Browser], None]) -> None:
        self._session = session
        self._payloads = payloads
        self._left = left
        self.wake = asyncio.Event()
        self._gone: set[int] = set()
        self._given = 0.0
        """When the last update was given to send, seconds of the loop's clock."""
        self._notes: dict[str, bytes] = {}
        self._open = True
        self.wake.set()

    def ready(self) -> None:
        """The page has taken the last update in."""
        self._session.credit = True
        self.wake.set()

    def forget(self, mesh: int) -> None:
        """Nothing uses the mesh any more; the page is told at the next occasion if it has it."""
        if self._session.knows(mesh):
            self._gone.add(mesh)

    def let_go(self, late: float) -> None:
        """Lets go of what the page has if its last update was given before ``late`` and is not taken in yet."""
        if self._given < late:
            self._session.let_go()

    def note(self, kind: str, frame: bytes) -> None:
        """A small frame to send at the next occasion; a newer one of its kind replaces it."""
        self._notes[kind] = frame
        self.wake.set()

    def close(self) -> None:
        """Ends ``frames``."""
        self._open = False
        self.wake.set()
        self._left(self)

    async def frames(self) -> AsyncIterator[bytes]:
        """What to send, in order, until ``close``."""
        while True:
            await self.wake.wait()
            self.wake.clear()
            if not self._open:
                return
            while self._notes:
                yield self._notes.pop(next(iter(self._notes)))
            if self._gone:
                gone, self._gone = self._gone, set()
                for frame in self._session.forget(gone):
                    yield frame
            if self._session.credit and self._session.behind:
                update = await self._session.next_update()
                self._given = asyncio.get_running_loop().time()
                missing = self._session.missing(update)
                self._session.sent(missing)
                for number in missing:
                    payload = await self._mesh(number)
                    if payload is not None:
                        yield payload
                yield update.frame

    async def _mesh(self, number: int) -> bytes | None:
        if self._payloads.mesh_size(number) > LARGE_MESH:
            return await asyncio.to_thread(self._payloads.mesh_frame, number)
        return self._payloads.mesh_frame(number)
