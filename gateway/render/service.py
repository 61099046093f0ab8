"""Transport-independent part of the render endpoint: admission of requests, and rendering in worker threads."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import structlog

from gateway.render.config import RenderConfig
from gateway.render.failures import FailureStore
from gateway.render.form import RenderRequest
from gateway.render.pipeline import Backdrop, EncodedImage, Pipeline
from gateway.render.scenes import SceneStore
from gateway.runtime.pool_errors import QueueFull
from gateway.runtime.worker_pool import WorkerPool
from renderers.interface import Renderer

_log = structlog.get_logger("gateway.render")

_MEMORY_RETRY_SECONDS: Final = 5
"""Retry-After in seconds if ``max_inflight_bytes`` is reached."""


_OUTCOMES: Final[Mapping[int, str]] = {200: "ok", 499: "gone", 500: "failed", 503: "busy"}
"""Outcome of a request by status; all other statuses are ``rejected``."""


@dataclass(frozen=True, slots=True, eq=False)
class RenderRecord:
    """One finished request, for observers such as metrics and the browser view's list of recent renders."""

    request_id: str
    status: int
    """HTTP status of the response."""
    seconds: float
    """Time from the request's headers to the response."""
    queue_seconds: float
    """Part of ``seconds`` spent waiting for a worker thread."""
    request: RenderRequest | None
    """None if the form was invalid. Holds the whole scene: do not keep a reference."""
    image: EncodedImage | None
    """The response's image; None if there is an error."""
    error: str
    """Error message of the response; empty on success."""
    slow: bool = False
    """True for a 503 at the deadline."""

    @property
    def kind(self) -> str:
        """Type of the image; ``unknown`` if the form was invalid."""
        return self.request.image_type if self.request is not None else "unknown"

    @property
    def outcome(self) -> str:
        """Outcome, for metrics."""
        return "slow" if self.slow else _OUTCOMES.get(self.status, "rejected")

    @property
    def stages(self) -> tuple[tuple[str, float], ...]:
        """Names and seconds of the stages of a successful request."""
        return (("queue", self.queue_seconds), *self.image.stage_seconds) if self.image is not None else ()


class Admission:
    """Reserved place in the worker pool's queue for a request whose body is arriving.

    The place is released when the request is submitted to the worker pool, when the request fails, or after a time
    limit.
    """

    __slots__ = ("_admitted", "_timer")

    def __init__(self, admitted: set[Admission], seconds: float) -> None:
        self._admitted = admitted
        self._timer = asyncio.get_running_loop().call_later(seconds, self.release)
        admitted.add(self)

    def release(self) -> None:
        """Free the place; without effect when called again."""
        self._timer.cancel()
        self._admitted.discard(self)


class RenderService:
    """The render endpoint, shared by all requests of one application. It belongs to one event loop."""

    def __init__(
        self,
        renderer: Renderer,
        workers: WorkerPool,
        config: RenderConfig | None = None,
        *,
        backdrop: Backdrop | None = None,
        on_finished: Callable[[RenderRecord], object] | None = None,
    ) -> None:
        """
        Args:
            backdrop: returns the scene to draw in addition to each request's; called in worker threads.
            on_finished: called in the event loop for each finished request; must not block.
        """
        self.config = config if config is not None else RenderConfig()
        self.failures: FailureStore | None = None
        if self.config.keep_failures is not None:
            self.failures = FailureStore(
                self.config.keep_failures, self.config.keep_failures_count, self.config.keep_failures_bytes
            )
        self._pipeline = Pipeline(renderer, self.config, backdrop)
        self._workers = workers
        self._on_finished = on_finished
        self._admitted: set[Admission] = set()
        self._body_bytes = 0
        self._responses_by_status: dict[int, int] = {}
        """Number of finished requests by HTTP status."""

    @property
    def arriving(self) -> int:
        """Number of requests whose bodies are arriving and that have a place in the queue."""
        return len(self._admitted)

    def admit(self) -> Admission:
        """Reserve a place in the queue before a request's body is read.

        Raises:
            QueueFull: waiting and arriving requests together reach the limit.
        """
        self._workers.check_capacity(self.arriving)
        return Admission(self._admitted, self.config.arrival_seconds)

    async def render(self, request: RenderRequest, admission: Admission) -> tuple[EncodedImage, float]:
        """Render an image. Return it, and the seconds for which the request waited for a thread.

        Args:
            admission: the request's place in the queue, released by this call.

        Raises:
            RequestError: the scene cannot be rendered.
            QueueFull: too many requests are waiting.
            PoolClosed: the server is shutting down.
            DeadlineExceeded: reading and rendering the scene took too long.
        """
        submitted = time.perf_counter()

        def work() -> tuple[EncodedImage, float]:
            queue_seconds = time.perf_counter() - submitted
            return self._pipeline.render(request), queue_seconds

        admission.release()
        return await self._workers.run(work, nbytes=len(request.scene))

    def reserve_bytes(self, nbytes: int) -> None:
        """Count received bytes of a body towards ``max_inflight_bytes``.

        Raises:
            QueueFull: all bodies together would exceed the limit; nothing is reserved.
        """
        if self._body_bytes + nbytes > self.config.max_inflight_bytes:
            raise QueueFull(
                f"the requests in progress hold {self._body_bytes} bytes, "
                f"the limit is {self.config.max_inflight_bytes} (max_inflight_bytes)",
                _MEMORY_RETRY_SECONDS,
            )
        self._body_bytes += nbytes

    def release_bytes(self, nbytes: int) -> None:
        """Undo ``reserve_bytes``."""
        self._body_bytes -= nbytes

    def finish(self, record: RenderRecord) -> None:
        """Count a finished request and notify the observer."""
        self._responses_by_status[record.status] = self._responses_by_status.get(record.status, 0) + 1
        if self._on_finished is not None:
            try:
                self._on_finished(record)
            except Exception:  # noqa: BLE001 - an image does not depend on its observers
                _log.exception("an observer of renders failed")

    @property
    def inflight_bytes(self) -> int:
        """Bytes of bodies that are arriving, waiting or being rendered."""
        return self._body_bytes

    @property
    def scenes(self) -> SceneStore:
        """The caches of posted scenes, for metrics."""
        return self._pipeline.scenes

    def status(self) -> dict[str, Any]:
        """Return figures for health and metrics; plain JSON values."""
        return {
            "answers": {str(status): count for status, count in sorted(self._responses_by_status.items())},
            "arriving": self.arriving,
            "inflight_bytes": self._body_bytes,
            "scene_cache": {"hits": self.scenes.scenes.hits, "misses": self.scenes.scenes.misses},
        }
