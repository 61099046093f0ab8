"""The live scene drawn by our own rasterizer, for machines without WebGL: exactly what the sensors see."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Final

import structlog

from gateway.runtime.worker_pool import DeadlineExceeded, PoolClosed, QueueFull, WorkerPool
from gateway.scene.cameras import CameraSpec
from gateway.scene.flatten import Flattener
from gateway.scene.live import LiveTree, Snapshot
from gateway.scene.viewpoints import resolve_camera
from gateway.viewer.config import ViewerConfig
from gateway.viewer.shared_task import SharedTask
from renderers.camera import Camera
from renderers.encode import jpeg_rgb
from renderers.interface import Look, LookName, Output, Renderer

_log = structlog.get_logger("view")

KEPT: Final = 8
"""Newest pictures kept: clients of the same camera share one."""
BOUNDARY: Final = b"scenegate-frame"
_IDLE_SECONDS: Final = 5.0
"""After that a stream repeats its picture, so that a client which left is noticed and proxies keep the connection."""


class StreamsFull(RuntimeError):  # noqa: N818 - it is an answer, not a fault
    """No further stream is taken; the message names the limit."""


@dataclass(frozen=True, slots=True)
class View:
    """What is drawn how."""

    camera: CameraSpec
    width: int
    height: int
    quality: int
    look: LookName


class Pictures:
    """Renders views of the newest scene; lives on the event loop, renders in worker threads."""

    def __init__(
        self,
        config: ViewerConfig,
        tree: LiveTree,
        flattener: Flattener,
        renderer: Renderer,
        workers: WorkerPool,
        stereo_camera: Callable[[], Camera | None] = lambda: None,
    ) -> None:
        self.config = config
        self._tree = tree
        self._flattener = flattener
        self._renderer = renderer
        self._workers = workers
        self._stereo_camera = stereo_camera
        self._made: OrderedDict[tuple[View, int], SharedTask[bytes]] = OrderedDict()
        self.streams = 0
        """Open MJPEG streams."""

    async def jpeg(self, view: View) -> tuple[bytes, int]:
        """A view as JPEG, and the revision of the scene in it.

        Raises:
            CameraError: the camera cannot be resolved in the scene as it is.
            ImageError: a texture cannot be decoded.
            QueueFull: too many requests wait already.
            DeadlineExceeded: it took too long.
        """
        snapshot = self._tree.snapshot
        key = (view, snapshot.revision)
        made = self._made.get(key)
        if made is None or not made.usable:
            made = self._made[key] = SharedTask(self._workers.run(self._draw, view, snapshot))
            while len(self._made) > KEPT:
                self._made.popitem(last=False)
        return await made.result(), snapshot.revision

    def _draw(self, view: View, snapshot: Snapshot) -> bytes:
        drawn = self._flattener.flatten(snapshot)
        camera = resolve_camera(
            view.camera, snapshot.root, view.width, view.height, stereo=self._stereo_camera(), drawn=drawn
        )
        samples = self.config.samples if view.look == "studio" else 1
        look = Look(view.look, self.config.background, samples, self.config.rig)
        with self._renderer.render(drawn, camera, Output.COLOR, look) as frame:
            assert frame.color is not None
            return jpeg_rgb(frame.color, quality=view.quality)

    def stream(self, view: View, rate: float, closing: Callable[[], bool]) -> AsyncIterator[bytes]:
        """Parts of a ``multipart/x-mixed-replace`` answer: a picture whenever the scene has changed.

        Raises:
            StreamsFull: there are ``max_streams`` already.
        """
        if self.streams >= self.config.max_streams:
            raise StreamsFull(f"{self.streams} streams are open, which is the limit (max_streams)")
        self.streams += 1
        return self._parts(view, rate, closing)

    async def _parts(self, view: View, rate: float, closing: Callable[[], bool]) -> AsyncIterator[bytes]:
        loop = asyncio.get_running_loop()
        changed = asyncio.Event()

        def notice(_: Snapshot) -> None:
            loop.call_soon_threadsafe(changed.set)

        stop_listening = self._tree.listen(notice)
        try:
            while not closing():
                begin = loop.time()
                changed.clear()
                try:
                    data, _ = await self.jpeg(view)
                except QueueFull as error:
                    await asyncio.sleep(error.retry_after)
                    continue
                except (DeadlineExceeded, PoolClosed) as error:  # the response has begun: it can only end
                    _log.warning("a stream of pictures has ended", reason=str(error))
                    return
                head = f"Content-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n".encode()
                yield b"--" + BOUNDARY + b"\r\n" + head + data + b"\r\n"
                await asyncio.sleep(max(0.0, begin + 1.0 / rate - loop.time()))
                await _wait(changed, begin + _IDLE_SECONDS, closing)
        finally:
            stop_listening()
            self.streams -= 1


async def _wait(event: asyncio.Event, until: float, closing: Callable[[], bool]) -> None:
    """Until the event, the time, or the end of the gateway, which nobody announces."""
    loop = asyncio.get_running_loop()
    while not event.is_set() and not closing() and (left := until - loop.time()) > 0:
        try:
            async with asyncio.timeout(min(left, 0.5)):
                await event.wait()
        except TimeoutError:
            pass
