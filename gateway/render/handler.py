"""Handles one HTTP request to the render endpoint: receives the body, returns an image or an error message."""

from __future__ import annotations

import asyncio
import logging
import time
import uuid
from typing import Final

import structlog
from fastapi import Request, Response
from starlette.requests import ClientDisconnect

from gateway.render.errors import RequestError, message_bytes
from gateway.render.form import RenderRequest, read_form
from gateway.render.multipart import Form, FormReader, body_too_large
from gateway.render.pipeline import EncodedImage
from gateway.render.service import Admission, RenderRecord, RenderService
from gateway.runtime.pool_errors import DeadlineExceeded
from gateway.server.disconnect import CLIENT_GONE, while_connected
from gateway.server.unavailable import UnavailableErrors, retry_after, unavailable_message

_log = structlog.get_logger("gateway.render")

_TRANSIENT: Final = frozenset((CLIENT_GONE, 503))
"""Statuses of requests that could succeed at another time: they are not stored for replay."""


class RenderHandler:
    """Handles one request; each request needs its own object."""

    def __init__(self, service: RenderService, http: Request) -> None:
        self._service = service
        self._http = http
        self._start_time = time.perf_counter()
        self._queue_seconds = 0.0
        self._received_bytes = 0
        self._admission: Admission | None = None
        self._body_pieces: list[bytes] | None = [] if service.failures is not None else None
        """Body as received, for the store of failed requests; None if there is no such store."""
        id_from_middleware = structlog.contextvars.get_contextvars().get("request_id")
        self._request_id = str(id_from_middleware) if id_from_middleware else uuid.uuid4().hex
        self._headers = {} if id_from_middleware else {"X-Request-ID": self._request_id}
        """Headers of the response. A middleware that sets an id also adds X-Request-ID."""

    async def respond(self) -> Response:
        """Return the response: the image, or an error message. Never raises."""
        request: RenderRequest | None = None
        try:
            self._admission = self._service.admit()
            request = read_form(await self._receive_form(), self._service.config)
            work = self._service.render(request, self._admission)
            image, self._queue_seconds = await while_connected(self._http, work)
        except RequestError as error:
            _log.warning("render request rejected", status=error.status, reason=error.sentence)
            return await self._error_response(error.status, error.sentence, request)
        except UnavailableErrors as error:
            sentence = unavailable_message(error)
            _log.warning("render request not served", reason=sentence, request_id=self._request_id)
            self._headers |= retry_after(error)
            return await self._error_response(503, sentence, request, slow=isinstance(error, DeadlineExceeded))
        except asyncio.CancelledError:  # the grace period at shutdown is over
            self._headers["Retry-After"] = "1"
            return await self._error_response(503, "the server shut down before the image was ready", request)
        except ClientDisconnect:
            _log.info("render client disconnected before its image was ready", received=self._received_bytes)
            return await self._error_response(CLIENT_GONE, "the client disconnected", request)
        except Exception:  # noqa: BLE001 - the client gets a sentence, the log the traceback
            _log.exception("render request failed", request_id=self._request_id)
            sentence = f"internal error while rendering; the server's log has the details under {self._request_id}"
            return await self._error_response(500, sentence, request)
        finally:
            if self._admission is not None:
                self._admission.release()
            self._service.release_bytes(self._received_bytes)
        return self._image_response(request, image, self._record(200, request, image, ""))

    async def _receive_form(self) -> Form:
        """Receive the body and parse it piece by piece.

        Raises:
            RequestError: the body is too large, stalls, or is not a valid form.
            QueueFull: all bodies together are too large.
            ClientDisconnect: the client disconnected.
        """
        config = self._service.config
        content_length = self._http.headers.get("content-length", "")
        if content_length.isdecimal() and len(content_length) < 20 and int(content_length) > config.max_body_bytes:
            raise body_too_large(int(content_length), config)
        reader = FormReader(self._http.headers.get("content-type", ""), config)
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(config.receive_timeout) as timeout:
                async for piece in self._http.stream():
                    timeout.reschedule(loop.time() + config.receive_timeout)
                    self._service.reserve_bytes(len(piece))
                    self._received_bytes += len(piece)
                    if self._body_pieces is not None:
                        self._body_pieces.append(piece)
                    reader.feed(piece)
            return reader.form()
        except TimeoutError:
            raise RequestError(
                408, f"no data for {config.receive_timeout:g} s after {self._received_bytes} bytes (receive_timeout)"
            ) from None
        finally:
            reader.close()

    def _image_response(self, request: RenderRequest, image: EncodedImage, record: RenderRecord) -> Response:
        for warning in (*request.warnings, *image.warnings):
            _log.warning("render request has a problem", warning=warning)
        stage_seconds = record.stages
        if logging.getLogger("gateway.render").isEnabledFor(logging.DEBUG):
            _log.debug(
                "rendered",
                image_type=request.image_type,
                size=f"{request.width}x{request.height}",
                elements=image.element_count,
                generator=image.generator,
                **{f"{name}_ms": round(seconds * 1e3, 2) for name, seconds in stage_seconds},
            )
        self._headers["Server-Timing"] = ", ".join(
            [f"{name};dur={seconds * 1e3:.2f}" for name, seconds in stage_seconds]
        )
        return Response(image.body, headers=self._headers, media_type=image.media_type)

    async def _error_response(
        self, status: int, sentence: str, request: RenderRequest | None, *, slow: bool = False
    ) -> Response:
        """Return an error response. Store the request for replay if the error is reproducible and there is a store."""
        self._record(status, request, None, sentence, slow)
        failures = self._service.failures
        reproducible = status not in _TRANSIENT or slow
        if failures is not None and self._body_pieces is not None and reproducible:
            content_type = self._http.headers.get("content-type", "")
            try:
                path = await asyncio.to_thread(
                    failures.store, self._body_pieces, content_type, status, sentence, self._request_id
                )
                _log.info("rejected render request stored", path=str(path))
            except OSError as error:
                _log.warning("rejected render request could not be stored", reason=str(error))
        return Response(message_bytes(sentence), status, headers=self._headers, media_type="text/plain; charset=utf-8")

    def _record(
        self, status: int, request: RenderRequest | None, image: EncodedImage | None, error: str, slow: bool = False
    ) -> RenderRecord:
        seconds = time.perf_counter() - self._start_time
        record = RenderRecord(self._request_id, status, seconds, self._queue_seconds, request, image, error, slow)
        self._service.finish(record)
        return record
