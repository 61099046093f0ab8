"""Render the live scene and its history as JPEG, and the live scene as MJPEG, for ``image_routes``."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import structlog

from gateway.adapters.viewer.config import ViewerConfig
from gateway.runtime.workers.pool_errors import DeadlineExceeded, PoolClosed, QueueFull
from gateway.runtime.workers.shared_results import SharedResults
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.draw.cameras import CameraSpec
from gateway.scene.draw.live_scene import LiveScene
from gateway.scene.draw.shown import with_visibility
from gateway.scene.draw.viewpoints import resolve_camera
from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.nodes import Path
from gateway.scene.tree.timeline import state_at
from renderers.encode import jpeg_rgb
from renderers.interface import LookName, Output, Renderer
from renderers.light_rig import LightChange

_log = structlog.get_logger("view")

MAX_IMAGES: Final = 8
"""Maximum number of encoded images that are kept. Clients that request an equal image of the same revision share it."""
BOUNDARY: Final = b"scenegate-frame"
"""Separator of the parts of a ``multipart/x-mixed-replace`` response."""
_REPEAT_SECONDS: Final = 5.0
"""Interval at which a stream repeats its image while the scene does not change. A disconnected client is detected by
it, and proxies keep the connection open."""
_CLOSING_POLL_SECONDS: Final = 0.5
"""Interval at which a waiting stream checks whether the gateway shuts down."""


class StreamsFull(RuntimeError):  # noqa: N818 - an expected response, not an error
    """``max_streams`` streams are open already."""

    retry_after = 10
    """Seconds."""


@dataclass(frozen=True, slots=True)
class ImageRequest:
    """Contents and look of an image of the live scene."""

    camera: CameraSpec
    width: int
    """Pixels."""
    height: int
    """Pixels."""
    quality: int
    """JPEG quality, 1 to 100."""
    look: LookName
    hide: tuple[Path, ...] = ()
    """Nodes to hide with everything below them."""
    show: tuple[Path, ...] = ()
    """Hidden nodes to show."""
    background: tuple[int, int, int] | None = None
    """0 .. 255; None: the configured one."""
    light: LightChange = field(default_factory=LightChange)
    """Changes of the configured light."""


class SceneImages:
    """Renders the newest scene in worker threads. Not thread-safe: called in the event loop only."""

    def __init__(self, config: ViewerConfig, scene: LiveScene, renderer: Renderer, workers: WorkerPool) -> None:
        self.config = config
        self._scene = scene
        self._renderer = renderer
        self._workers = workers
        self._images: SharedResults[tuple[ImageRequest, int], bytes] = SharedResults(MAX_IMAGES)
        self.streams = 0
        """Number of open MJPEG streams."""

    async def jpeg(self, request: ImageRequest, time: float | None = None) -> tuple[bytes, int]:
        """Return the scene as JPEG, and its revision. ``time``: see ``state_at``; None: the newest scene.

        Raises TimeError, CameraError (no such node, or no stereo camera), ImageError, QueueFull, DeadlineExceeded, or
        PoolClosed.
        """
        scene = self._scene
        snapshot = scene.tree.snapshot if time is None else await state_at(scene.timeline, time)
        key = (request, snapshot.revision)
        data = await self._images.get(key, lambda: self._workers.run(self._render, request, snapshot))
        return data, snapshot.revision

    def _render(self, request: ImageRequest, snapshot: Snapshot) -> bytes:
        """Return a snapshot as JPEG. Called in a worker thread."""
        shown = with_visibility(snapshot, request.hide, request.show)
        draw_list = self._scene.draw_list(shown)
        camera = resolve_camera(
            request.camera,
            shown.root,
            request.width,
            request.height,
            stereo=self._scene.stereo_camera(shown),
            draw_list=draw_list,
        )
        look = self.config.style.for_image(request.background, request.light).look_for(request.look)
        frame = self._renderer.render(draw_list, camera, Output.COLOR, look)
        assert frame.color is not None
        return jpeg_rgb(frame.color, quality=request.quality)

    def stream(self, request: ImageRequest, rate: float, closing: Callable[[], bool]) -> AsyncIterator[bytes]:
        """Return the parts of a ``multipart/x-mixed-replace`` response: an image for every change, up to ``rate`` a
        second.

        It ends when ``closing`` returns True. Raises StreamsFull if ``max_streams`` streams are open already.
        """
        if self.streams >= self.config.max_streams:
            raise StreamsFull(f"{self.streams} streams are open, which is the limit (max_streams)")
        self.streams += 1
        return self._stream_parts(request, rate, closing)

    async def _stream_parts(
        self, request: ImageRequest, rate: float, closing: Callable[[], bool]
    ) -> AsyncIterator[bytes]:
        loop = asyncio.get_running_loop()
        changed = asyncio.Event()
        stop_listening = self._scene.tree.listen(partial(loop.call_soon_threadsafe, changed.set))
        try:
            while not closing():
                frame_start = loop.time()
                changed.clear()
                try:
                    data, _ = await self.jpeg(request)
                except QueueFull as error:
                    await asyncio.sleep(error.retry_after)
                    continue
                except (DeadlineExceeded, PoolClosed) as error:  # the response has begun: no error status can be sent
                    _log.warning("image stream ended", reason=str(error))
                    return
                part_header = f"Content-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n".encode()
                yield b"--" + BOUNDARY + b"\r\n" + part_header + data + b"\r\n"
                await asyncio.sleep(max(0.0, frame_start + 1.0 / rate - loop.time()))
                await _wait_for_change(changed, frame_start + _REPEAT_SECONDS, closing)
        finally:
            stop_listening()
            self.streams -= 1


async def _wait_for_change(event: asyncio.Event, deadline: float, closing: Callable[[], bool]) -> None:
    """Wait until the event is set, ``deadline`` of the event loop's clock has passed, or the gateway shuts down."""
    loop = asyncio.get_running_loop()
    while not event.is_set() and not closing() and (seconds_left := deadline - loop.time()) > 0:
        with suppress(TimeoutError):
            async with asyncio.timeout(min(seconds_left, _CLOSING_POLL_SECONDS)):
                await event.wait()
