"""Every browser's connection to the live tree: one encoder, one clock of updates, a task per browser."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Any, Final

from gateway.scene.live import LiveTree, Snapshot
from gateway.viewer.encoder import Encoder, encode_status
from gateway.viewer.payloads import Payloads
from gateway.viewer.session import Session

LARGE_MESH: Final = 1 << 20
"""Meshes of more bytes are encoded in a thread, so that the event loop is not held for milliseconds."""


@dataclass(frozen=True, slots=True)
class ViewerConfig:
    """Bounds and pace of the browser view."""

    rate: float = 60.0
    """Updates per second at most; screens show no more."""
    max_browsers: int = 64
    """Connections at a time; each costs a socket buffer and up to one update of memory."""
    max_paths: int = 1_000_000
    """Different paths that are numbered before browsers start over: about 300 bytes each."""
    status_seconds: float = 1.0
    """Between two looks at the state of the gateway for the status bar."""


class ViewHub:
    """Joins browsers to the tree. Lives on one event loop; ``run`` must be running."""

    def __init__(self, config: ViewerConfig, tree: LiveTree, status: Callable[[], dict[str, Any]] = dict) -> None:
        self.config = config
        self.payloads = Payloads()
        self._tree = tree
        self._status = status
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
                self._changed.clear()
                if self._browsers:
                    self._encoder.advance(self._tree.snapshot)
                    for browser in tuple(self._browsers):
                        browser.wake.set()
                await asyncio.sleep(1.0 / self.config.rate)
        finally:
            self._ready = False
            status.cancel()
            stop_listening()
            stop_watching()
            for browser in tuple(self._browsers):
                browser.close()

    async def _send_status(self) -> None:
        while True:
            if self._browsers:
                frame = encode_status({**self._status(), "view": self.status()})
                for browser in tuple(self._browsers):
                    browser.note(frame)
            await asyncio.sleep(self.config.status_seconds)

    def _forget(self, number: int) -> None:
        for browser in tuple(self._browsers):
            browser.gone.add(number)

    def connect(self) -> Browser:
        """A new browser.

        Raises:
            ConnectionRefusedError: there are ``max_browsers`` already.
        """
        if len(self._browsers) >= self.config.max_browsers:
            raise ConnectionRefusedError(
                f"{len(self._browsers)} browsers are connected, which is the limit (max_browsers)"
            )
        self._encoder.advance(self._tree.snapshot)
        browser = Browser(Session(self._encoder, self.payloads), self.payloads, self._browsers.discard)
        self._browsers.add(browser)
        return browser


class Browser:
    """One connection: ``frames`` gives what to send, ``ready`` takes the page's word that it wants more."""

    def __init__(self, session: Session, payloads: Payloads, left: Callable[[Browser], None]) -> None:
        self._session = session
        self._payloads = payloads
        self._left = left
        self.wake = asyncio.Event()
        self.gone: set[int] = set()
        self._note: bytes | None = None
        self._open = True
        self.wake.set()

    def ready(self) -> None:
        """The page has taken the last update in."""
        self._session.credit = True
        self.wake.set()

    def note(self, frame: bytes) -> None:
        """A small frame to send at the next occasion; a newer one replaces it."""
        self._note = frame
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
            if self._note is not None:
                note, self._note = self._note, None
                yield note
            if self.gone:
                gone, self.gone = self.gone, set()
                for frame in self._session.forget(gone):
                    yield frame
            if self._session.credit and self._session.behind:
                update = self._session.next_update()
                missing = self._session.missing(update)
                for number in missing:
                    payload = await self._mesh(number)
                    if payload is not None:
                        yield payload
                self._session.sent(missing)
                yield update.frame

    async def _mesh(self, number: int) -> bytes | None:
        if self._payloads.mesh_size(number) > LARGE_MESH:
            return await asyncio.to_thread(self._payloads.mesh_frame, number)
        return self._payloads.mesh_frame(number)
