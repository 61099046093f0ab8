"""The render endpoint without HTTP: requests in, pictures out of the worker threads."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any

import structlog

from gateway.render.config import RenderConfig
from gateway.render.events import RenderRecord
from gateway.render.failures import FailureStore
from gateway.render.form import RenderRequest
from gateway.render.pipeline import Backdrop, Picture, Pipeline
from gateway.render.scenes import SceneStore
from gateway.runtime.worker_pool import Busy, Workers
from gateway.server.alarms import alarms_of
from renderers.interface import Renderer

_log = structlog.get_logger("gateway.render")

_RETRY_FULL = 5
"""Seconds until memory for another upload is probably free."""
_SOON = 0.05
"""Seconds in which most bodies arrive; whoever takes longer keeps no frame from other processors."""


class Place:
    """Of a request in the queue while its body arrives; given up when it is handed in, refused or too slow."""

    __slots__ = ("_service", "_timer", "since")

    def __init__(self, service: RenderService, seconds: float) -> None:
        self._service: RenderService | None = service
        self.since = time.monotonic()
        self._timer = alarms_of(asyncio.get_running_loop()).later(seconds, self.leave)

    def leave(self) -> None:
        """Calling it again does nothing."""
        self._timer.cancel()
        if self._service is not None:
            self._service.places.remove(self)
            self._service = None


class RenderService:
    """Shared by all requests of one application; belongs to one event loop."""

    def __init__(
        self,
        renderer: Renderer,
        workers: Workers,
        config: RenderConfig | None = None,
        *,
        backdrop: Backdrop | None = None,
        on_done: Callable[[RenderRecord], None] | None = None,
    ) -> None:
        """
        Args:
            backdrop: what to draw besides every request's scene; called in worker threads.
            on_done: told about every request, in the event loop; must return at once.
        """
        self.config = config if config is not None else RenderConfig()
        self.failures: FailureStore | None = None
        if self.config.keep_failures is not None:
            self.failures = FailureStore(
                self.config.keep_failures, self.config.keep_failures_count, self.config.keep_failures_bytes
            )
        self._pipeline = Pipeline(renderer, self.config, backdrop)
        self._workers = workers
        self._on_done = on_done
        self.places: set[Place] = set()
        """Of requests whose bodies arrive."""
        self._inflight = 0
        self._answered: dict[int, int] = {}

    @property
    def arriving(self) -> int:
        """Requests that hold a place while their bodies arrive."""
        return len(self.places)

    def soon(self) -> int:
        """Of them, those that will probably want a thread before a frame is drawn. Any thread."""
        earliest = time.monotonic() - _SOON
        return sum([place.since > earliest for place in tuple(self.places)])  # copied at one go

    def refuse(self) -> Busy | None:
        """Why a request whose head has just arrived would be refused, if it would; then it is counted as answered."""
        if (busy := self._workers.refuse(self.arriving)) is not None:
            self._count(503)
        return busy

    def admit(self) -> Place:
        """A place for a request whose head has arrived; its body may be read.

        Raises:
            Busy: as many wait or arrive as may wait.
        """
        if (busy := self._workers.refuse(self.arriving)) is not None:
            raise busy
        place = Place(self, self.config.arrival_seconds)
        self.places.add(place)
        return place

    async def render(self, request: RenderRequest, place: Place) -> tuple[Picture, float]:
        """The picture, and the seconds that the request waited for a thread. ``place`` is given up for one with it.

        Raises:
            RequestError: it cannot be drawn.
            Busy: too many wait already.
            Closed: the server is shutting down.
            TooSlow: reading and drawing took too long.
        """
        submitted = time.perf_counter()

        def work() -> tuple[Picture, float]:
            queued = time.perf_counter() - submitted
            return self._pipeline.picture(request), queued

        place.leave()
        return await self._workers.run(work, weight=len(request.scene))

    def take(self, nbytes: int) -> None:
        """Accounts for bytes of a body that arrived.

        Raises:
            Busy: all bodies together are too large; the bytes are not accounted for then.
        """
        if self._inflight + nbytes > self.config.max_inflight_bytes:
            raise Busy(
                f"the requests that are being answered hold {self._inflight} bytes, "
                f"the limit is {self.config.max_inflight_bytes} (max_inflight_bytes)",
                _RETRY_FULL,
            )
        self._inflight += nbytes

    def give_back(self, nbytes: int) -> None:
        """The bytes of a body are gone."""
        self._inflight -= nbytes

    def done(self, record: RenderRecord) -> None:
        """Counts a finished request and tells the observer."""
        self._count(record.status)
        if self._on_done is not None:
            try:
                self._on_done(record)
            except Exception:  # noqa: BLE001 - nobody's picture depends on who watches
                _log.exception("an observer of renders failed")

    def _count(self, status: int) -> None:
        self._answered[status] = self._answered.get(status, 0) + 1

    @property
    def inflight_bytes(self) -> int:
        """Of bodies that arrive, wait or are rendered."""
        return self._inflight

    @property
    def scenes(self) -> SceneStore:
        """The caches, for metrics."""
        return self._pipeline.scenes

    def status(self) -> dict[str, Any]:
        """Figures for health and metrics; plain JSON values."""
        scenes = self._pipeline.scenes
        return {
            "answers": {str(status): count for status, count in sorted(self._answered.items())},
            "arriving": self.arriving,
            "inflight_bytes": self._inflight,
            "scene_cache": {"hits": scenes.scenes.hits, "misses": scenes.scenes.misses},
        }
