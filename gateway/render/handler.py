"""One HTTP exchange of the render endpoint: body in, picture or sentence out."""

from __future__ import annotations

import asyncio
import logging
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import structlog
from fastapi import Request, Response
from starlette.requests import ClientDisconnect

from gateway.render.errors import RequestError, message_bytes
from gateway.render.events import RenderRecord
from gateway.render.form import RenderRequest, read_form
from gateway.render.multipart import Form, FormReader, too_large
from gateway.render.pipeline import Picture
from gateway.render.service import Place, RenderService
from gateway.runtime.worker_pool import Busy, Closed, TooSlow
from gateway.server.direct import Direct
from gateway.server.disconnect import CLIENT_GONE

_log = structlog.get_logger("gateway.render")

_NOT_THE_REQUESTS_FAULT = frozenset((CLIENT_GONE, 503))
"""Statuses of requests that would be answered another time; not kept for replay."""


class Exchange:
    """Answers one request. Make one for each."""

    def __init__(self, service: RenderService, http: Request) -> None:
        self._service = service
        self._http = http
        self._direct = Direct.of(http.scope)
        self._begin = time.perf_counter()
        self._queued = 0.0
        self._received = 0
        self._place: Place | None = None
        self._kept: list[bytes] | None = [] if service.failures is not None else None
        bound = structlog.contextvars.get_contextvars().get("request_id")
        self._request_id = str(bound) if bound else uuid.uuid4().hex
        self._headers = {} if bound else {"X-Request-ID": self._request_id}
        """A middleware that has given the request an id also answers with it."""

    async def answer(self) -> Response:
        """Never raises."""
        request: RenderRequest | None = None
        try:
            place = self._place = self._service.admit()
            request = read_form(await self._form(), self._service.config)
            picture = await self._picture(request, place)
        except RequestError as error:
            _log.warning("render request rejected", status=error.status, reason=error.sentence)
            return await self._refusal(error.status, error.sentence, request)
        except Busy as error:
            _log.warning("render request turned away", reason=str(error))
            self._headers["Retry-After"] = str(error.retry_after)
            return await self._refusal(503, f"the server is busy: {error}", request)
        except Closed as error:
            self._headers["Retry-After"] = "1"
            return await self._refusal(503, str(error), request)
        except TooSlow as error:
            sentence = f"the picture was given up: {error}"
            _log.warning("render request given up", reason=sentence, request_id=self._request_id)
            return await self._refusal(503, sentence, request, outcome="slow")
        except asyncio.CancelledError:  # the time for shutting down is over; the client should hear it, not a 500
            self._headers["Retry-After"] = "1"
            return await self._refusal(503, "the server shut down before the picture was ready", request)
        except ClientDisconnect:
            _log.info("render client left before its picture was ready", received=self._received)
            return await self._refusal(CLIENT_GONE, "the client left", request)
        except Exception:  # noqa: BLE001 - whatever it is, the client gets a sentence and the log the traceback
            _log.exception("render request failed", request_id=self._request_id)
            sentence = f"internal error while rendering; the server's log has the details under {self._request_id}"
            return await self._refusal(500, sentence, request)
        finally:
            if self._place is not None:
                self._place.leave()
            self._service.give_back(self._received)
        self._done(200, request, picture, "")
        return self._response(request, picture)

    async def _form(self) -> Form:
        """Reads the body, parsing as it comes."""
        config = self._service.config
        announced = self._http.headers.get("content-length", "")
        if announced.isdecimal() and len(announced) < 20 and int(announced) > config.max_body_bytes:
            raise too_large(int(announced), config)
        reader = FormReader(self._http.headers.get("content-type", ""), config)

        def take(buffer: bytes | bytearray, count: int) -> None:
            self._service.take(count)
            self._received += count
            if self._kept is not None:
                self._kept.append(bytes(buffer[:count]))
            reader.feed(buffer, count)

        try:
            if self._direct is not None:
                await self._direct.pour(take, config.receive_timeout)
            else:
                await _read(self._http, take, config.receive_timeout)
        except TimeoutError:
            raise RequestError(
                408, f"no data for {config.receive_timeout:g} s after {self._received} bytes (receive_timeout)"
            ) from None
        else:
            return reader.form()
        finally:
            reader.close()

    async def _picture(self, request: RenderRequest, place: Place) -> Picture:
        """Renders, unless the client leaves before."""
        task = asyncio.current_task()
        assert task is not None
        left = False

        def gone() -> None:
            nonlocal left
            left = True
            task.cancel()

        with _told_when_gone(self._http, self._direct, gone):
            try:
                picture, self._queued = await self._service.render(request, place)
            except asyncio.CancelledError:
                if left and task.uncancel() == 0:
                    raise ClientDisconnect from None
                raise
        return picture

    def _response(self, request: RenderRequest, picture: Picture) -> Response:
        for warning in (*request.warnings, *picture.warnings):
            _log.warning("render request is odd", warning=warning)
        stages = (("queue", self._queued), *picture.stages)
        if logging.getLogger("gateway.render").isEnabledFor(logging.DEBUG):  # else all this would be made for nothing
            _log.debug(
                "rendered",
                image_type=request.image_type,
                size=f"{request.width}x{request.height}",
                elements=picture.elements,
                generator=picture.generator,
                **{f"{name}_ms": round(seconds * 1e3, 2) for name, seconds in stages},
            )
        self._headers["Server-Timing"] = ", ".join(f"{name};dur={seconds * 1e3:.2f}" for name, seconds in stages)
        return Response(picture.body, headers=self._headers, media_type=picture.media_type)

    async def _refusal(
        self, status: int, sentence: str, request: RenderRequest | None, *, outcome: str = ""
    ) -> Response:
        """``outcome``: for metrics, where the status does not tell it."""
        self._done(status, request, None, sentence, outcome)
        failures = self._service.failures
        fault = status not in _NOT_THE_REQUESTS_FAULT or outcome == "slow"
        if failures is not None and self._kept is not None and fault:
            content_type = self._http.headers.get("content-type", "")
            try:
                path = await asyncio.to_thread(
                    failures.keep, self._kept, content_type, status, sentence, self._request_id
                )
                _log.info("rejected render request kept", path=str(path))
            except OSError as error:
                _log.warning("rejected render request could not be kept", reason=str(error))
        return Response(message_bytes(sentence), status, headers=self._headers, media_type="text/plain; charset=utf-8")

    def _done(
        self, status: int, request: RenderRequest | None, picture: Picture | None, error: str, outcome: str = ""
    ) -> None:
        seconds = time.perf_counter() - self._begin
        record = RenderRecord(self._request_id, status, seconds, self._queued, request, picture, error, outcome)
        self._service.done(record)


async def _read(http: Request, take: Callable[[bytes, int], None], patience: float) -> None:
    """``Direct.pour`` by ASGI alone."""
    loop = asyncio.get_running_loop()
    async with asyncio.timeout(patience) as deadline:
        async for chunk in http.stream():
            deadline.reschedule(loop.time() + patience)
            take(chunk, len(chunk))


@contextmanager
def _told_when_gone(http: Request, direct: Direct | None, gone: Callable[[], None]) -> Iterator[None]:
    """Has ``gone`` called when the client leaves; the body must have been read."""
    if direct is not None:
        direct.watch(gone)
        try:
            yield
        finally:
            direct.watch(None)
        return

    async def wait() -> None:
        while (await http.receive())["type"] != "http.disconnect":
            pass
        gone()

    waiting = asyncio.create_task(wait())
    try:
        yield
    finally:
        waiting.cancel()
