"""``POST /render``: admits a request, receives its form, has it rendered by a worker thread, and responds."""

import asyncio
import logging
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal

import structlog
from fastapi import Request, Response
from starlette.requests import ClientDisconnect
from starlette.types import Receive, Scope, Send

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.errors import RequestError, message_bytes, quoted
from gateway.adapters.render.failures import FailureStore
from gateway.adapters.render.form import FormReader, body_too_large
from gateway.adapters.render.pipeline import Backdrop, EncodedImage, Pipeline
from gateway.adapters.render.request import RenderRequest
from gateway.runtime.http.disconnect import CLIENT_GONE, while_connected
from gateway.runtime.http.http_protocol import CONNECTION, BoundedHttpProtocol
from gateway.runtime.http.plain_error_route import retry_after, unavailable_message
from gateway.runtime.logs.metrics_registry import Metrics
from gateway.runtime.logs.render_record import RenderRecord
from gateway.runtime.logs.warning_list import WarningList
from gateway.runtime.workers.pool_errors import DeadlineExceeded, QueueFull, UnavailableErrors
from gateway.runtime.workers.worker_pool import MEMORY_RETRY_SECONDS, WorkerPool
from renderers.interface import Renderer

_log = structlog.get_logger("gateway.render")

_Outcome = Literal["ok", "rejected", "busy", "slow", "gone", "failed"]
"""Outcome of a request, for metrics."""
_STORED_OUTCOMES: Final = frozenset({"rejected", "slow", "failed"})
"""Outcomes of requests that are stored for replay. Those with other errors could succeed at another time."""
_MAX_DIGITS: Final = 20
"""Maximum number of digits of Content-Length that is converted; int() is slow for thousands of digits."""


@dataclass(slots=True, eq=False)
class _Call:
    """A request in progress."""

    http_request: Request
    pieces: list[bytes | bytearray] | None
    """Body as received, for the store of failed requests; None if there is no such store. A buffer may be larger."""
    start_time: float = field(default_factory=time.perf_counter)
    arrival_time: float = 0.0
    """Time at which the last bytes of the body arrived."""
    form_time: float = 0.0
    """Time at which the form was read."""
    received_bytes: int = 0
    held_bytes: int = 0
    """Size of the buffer for the body, or of its pieces."""
    request: RenderRequest | None = None
    """None until the form is complete and valid."""


class _TimedResponse(Response):
    """A response that reports its time to send, seconds: until the system or a buffer has taken the last byte."""

    def __init__(self, on_sent: Callable[[float], None], content: bytes, **options: Any) -> None:
        super().__init__(content, **options)
        self._on_sent = on_sent

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        start_time = time.perf_counter()
        await super().__call__(scope, receive, send)
        self._on_sent(time.perf_counter() - start_time)


class RenderService:
    """The render endpoint, shared by all requests of one application. It belongs to one event loop."""

    def __init__(
        self,
        renderer: Renderer,
        workers: WorkerPool,
        config: RenderConfig | None = None,
        *,
        backdrop: Backdrop | None = None,
        metrics: Metrics | None = None,
    ) -> None:
        """
        Args:
            backdrop: returns the scene to draw in addition to each request's; called in worker threads.
            metrics: count the requests and the seconds of their stages.
        """
        self.config = config = config if config is not None else RenderConfig()
        self._pipeline = Pipeline(renderer, config, backdrop)
        self.scenes: Final = self._pipeline.scenes
        """The caches of posted scenes, for metrics."""
        self.inflight_bytes = 0
        """Bytes held by bodies that are arriving, waiting or being rendered."""
        self._workers = workers
        self._metrics = metrics
        self.recent: Final[deque[RenderRecord]] = deque(maxlen=config.recent_count)
        """The newest finished requests, oldest first."""
        self._failures: FailureStore | None = None
        if config.keep_failures is not None:
            self._failures = FailureStore(config.keep_failures, config.keep_failures_count, config.keep_failures_bytes)
        self._arriving: set[_Call] = set()
        """Requests whose bodies are arriving and that have a place in the queue."""
        self._responses_by_status: Counter[int] = Counter()
        self._last_warnings: tuple[str, ...] = ()
        """Warnings about the last image that was rendered."""

    async def respond(self, http_request: Request) -> Response:
        """Return the response: the image, or an error message. Never raises."""
        call = _Call(http_request, [] if self._failures is not None else None)
        loop = asyncio.get_running_loop()
        # a slow upload loses its place in the queue
        place_timer = loop.call_later(self.config.arrival_seconds, self._arriving.discard, call)
        headers: dict[str, str] = {}
        outcome: _Outcome
        try:
            self._workers.check_capacity(len(self._arriving))
            self._arriving.add(call)
            request = call.request = await self._receive_form(call)
            self._arriving.discard(call)
            call.form_time = time.perf_counter()
            work = self._workers.run(self._pipeline.render, request, call.form_time, nbytes=len(request.scene))
            image = await while_connected(http_request, work)
        except RequestError as error:
            status, outcome, sentence = error.status, "rejected", error.sentence
        except UnavailableErrors as error:
            status, outcome = 503, "slow" if isinstance(error, DeadlineExceeded) else "busy"
            sentence, headers = unavailable_message(error), retry_after(error)
        except asyncio.CancelledError:  # the grace period at shutdown is over
            status, outcome, headers = 503, "busy", {"Retry-After": "1"}
            sentence = "the server shut down before the image was ready"
        except ClientDisconnect:
            status, outcome = CLIENT_GONE, "gone"
            sentence = f"the client disconnected after {call.received_bytes} bytes"
        except Exception:  # noqa: BLE001 - the client gets a sentence, the log the traceback
            _log.exception("render request failed")
            status, outcome = 500, "failed"
            sentence = f"internal error while rendering; the server's log has the details under {_request_id()}"
        else:
            return self._image_response(call, request, image)
        finally:
            place_timer.cancel()
            self._arriving.discard(call)
            self.inflight_bytes -= call.held_bytes
        return await self._error_response(call, status, outcome, sentence, headers)

    async def _receive_form(self, call: _Call) -> RenderRequest:
        """Receive the body, and parse it as it arrives.

        Raises:
            RequestError: the body is too large, stalls, or is not a valid form.
            QueueFull: all bodies together are too large.
            ClientDisconnect: the client disconnected.
        """
        config = self.config
        headers = call.http_request.headers
        content_length = headers.get("content-length", "")
        if (
            content_length.isdecimal()
            and len(content_length) < _MAX_DIGITS
            and int(content_length) > config.max_body_bytes
        ):
            raise body_too_large(int(content_length), config)
        if (coding := headers.get("content-encoding", "identity").lower()) != "identity":
            raise RequestError(415, f"Content-Encoding is {quoted(coding)}: send the form without compression")
        reader = FormReader(headers.get("content-type", ""), config)
        loop = asyncio.get_running_loop()

        def on_bytes(buffer: bytearray, count: int) -> None:
            call.arrival_time = time.perf_counter()
            timeout.reschedule(loop.time() + config.receive_timeout)
            call.received_bytes = count
            self._hold(call, len(buffer))
            if call.pieces is not None:
                call.pieces[:] = [buffer]
            reader.read(buffer, count)

        try:
            async with asyncio.timeout(config.receive_timeout) as timeout:
                connection: BoundedHttpProtocol | None = call.http_request.scope.get(CONNECTION)
                if connection is not None:
                    body = await connection.receive_body(call.http_request.scope, on_bytes)
                    if body is not None:
                        return reader.request(body if call.pieces is None else body.copy())
                async for piece in call.http_request.stream():
                    call.arrival_time = time.perf_counter()
                    timeout.reschedule(loop.time() + config.receive_timeout)
                    call.received_bytes += len(piece)
                    self._hold(call, call.received_bytes)
                    if call.pieces is not None:
                        call.pieces.append(piece)
                    reader.feed(piece)
            return reader.request()
        except TimeoutError:
            raise RequestError(
                408, f"no data for {config.receive_timeout:g} s after {call.received_bytes} bytes (receive_timeout)"
            ) from None
        finally:
            reader.close()

    def _hold(self, call: _Call, nbytes: int) -> None:
        """Set the number of bytes that a request holds. Raises QueueFull."""
        if self.inflight_bytes - call.held_bytes + nbytes > self.config.max_inflight_bytes:
            raise QueueFull(
                f"the requests in progress hold {self.inflight_bytes} bytes, "
                f"the limit is {self.config.max_inflight_bytes} (max_inflight_bytes)",
                MEMORY_RETRY_SECONDS,
            )
        self.inflight_bytes += nbytes - call.held_bytes
        call.held_bytes = nbytes

    def _image_response(self, call: _Call, request: RenderRequest, image: EncodedImage) -> Response:
        self._last_warnings = warnings = (*request.warnings, *image.warnings)
        for warning in warnings:
            _log.warning("render request has a problem", warning=warning)
        self._finish(call, 200, "ok", image=image, warnings=warnings)
        queue, parse, render, (encode, encode_seconds) = image.stage_seconds
        stages = (
            ("receive", call.arrival_time - call.start_time),
            ("form", call.form_time - call.arrival_time),
            queue,
            parse,
            render,
            (encode, encode_seconds + time.perf_counter() - image.end_time),  # with the way back to the event loop
        )
        timing = ", ".join([f"{name};dur={seconds * 1e3:.2f}" for name, seconds in stages])

        def on_sent(seconds: float) -> None:
            self._record_stages(request, image, (*stages, ("send", seconds)))

        return _TimedResponse(on_sent, image.body, headers={"Server-Timing": timing}, media_type=image.media_type)

    def _record_stages(self, request: RenderRequest, image: EncodedImage, stages: Iterable[tuple[str, float]]) -> None:
        """Add the durations of stages, seconds, to the metrics and, at debug level, to the log."""
        if self._metrics is not None:
            for name, seconds in stages:
                self._metrics.stage(name).observe(seconds)
        if logging.getLogger("gateway.render").isEnabledFor(logging.DEBUG):
            _log.debug(
                "rendered",
                image_type=request.image_type,
                size=f"{request.width}x{request.height}",
                elements=image.element_count,
                generator=image.generator,
                **{f"{name}_ms": round(seconds * 1e3, 2) for name, seconds in stages},
            )

    async def _error_response(
        self, call: _Call, status: int, outcome: _Outcome, sentence: str, headers: dict[str, str]
    ) -> Response:
        """Return an error response. Store the request for replay if the error is reproducible and there is a store."""
        log = _log.info if outcome == "gone" else _log.warning
        log("render request without an image", status=status, reason=sentence)
        self._finish(call, status, outcome, error=sentence)
        if self._failures is not None and call.pieces is not None and outcome in _STORED_OUTCOMES:
            content_type = call.http_request.headers.get("content-type", "")
            received = [memoryview(piece)[: call.received_bytes] for piece in call.pieces]
            try:
                path = await asyncio.to_thread(
                    self._failures.store, received, content_type, status, sentence, _request_id()
                )
                _log.info("rejected render request stored", path=str(path))
            except OSError as error:
                _log.warning("rejected render request could not be stored", reason=str(error))
        return Response(message_bytes(sentence), status, headers, media_type="text/plain; charset=utf-8")

    def _finish(
        self,
        call: _Call,
        status: int,
        outcome: _Outcome,
        *,
        image: EncodedImage | None = None,
        warnings: tuple[str, ...] = (),
        error: str = "",
    ) -> None:
        """Count and record a finished request. Drop the oldest images of ``recent`` that exceed its limit."""
        self._responses_by_status[status] += 1
        if self._metrics is not None:
            kind = call.request.image_type if call.request is not None else "unknown"
            self._metrics.render(kind, outcome).inc()
        request = call.request
        image_text, scene_text = "not understood", ""
        if request is not None:
            image_text = f"{request.image_type}, {request.width} × {request.height}"
            size = len(request.scene)
            scene_text = f"scene of {size / 1e6:.1f} MB" if size >= 1e6 else f"scene of {size / 1e3:.1f} kB"
        if image is not None:
            by = f" by {image.generator}" if image.generator else ""
            scene_text = f"{scene_text}{by[:80]}, {image.element_count} primitives"
        self.recent.append(
            RenderRecord(
                number=self._responses_by_status.total(),
                end_time=time.time(),
                status=status,
                seconds=time.perf_counter() - call.start_time,
                queue_seconds=image.stage_seconds[0][1] if image is not None else 0.0,
                image_text=image_text,
                scene_text=scene_text,
                kind=request.image_type if request is not None else "",
                body=image.body if image is not None else b"",
                media_type=image.media_type if image is not None else "",
                error=error,
                warnings=warnings,
            )
        )
        image_bytes = 0
        for index in range(len(self.recent) - 1, -1, -1):
            image_bytes += len(self.recent[index].body)
            if image_bytes > self.config.recent_bytes:
                self.recent[index] = replace(self.recent[index], body=b"")

    def status(self) -> dict[str, Any]:
        """Return figures for health and metrics; plain JSON values."""
        last_image = WarningList()
        last_image.set("last image", *self._last_warnings)
        warnings = last_image.listed()
        return {
            "answers": {str(status): count for status, count in sorted(self._responses_by_status.items())},
            "arriving": len(self._arriving),
            "inflight_bytes": self.inflight_bytes,
            "scene_cache": {"hits": self.scenes.scenes.hits, "misses": self.scenes.scenes.misses},
            **({"warnings": warnings} if warnings else {}),
        }


def _request_id() -> str:
    """Return the id of the current request, which ``Edge`` gave it."""
    return str(structlog.contextvars.get_contextvars().get("request_id", ""))
