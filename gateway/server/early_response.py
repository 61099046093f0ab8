"""Responses to requests whose bodies are still arriving, on connections that close after the response."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from typing import Final

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gateway.server.http_protocol import DISCARD_BYTES, DISCARD_SECONDS

_CLOSE: Final = (b"connection", b"close")


class EarlyResponse:
    """ASGI middleware: receive the rest of a body before the end of its response closes the connection.

    A connection that closes with unread bytes is reset, and a reset discards the response on its way to the client.
    Connections that stay open do without: ``BoundedHttpProtocol`` discards what follows.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] != "http" or _CLOSE not in scope["headers"]:
            return self._app(scope, receive, send)
        has_body = True

        async def receive_body() -> Message:
            nonlocal has_body
            message = await receive()
            has_body = message["type"] == "http.request" and message.get("more_body", False)
            return message

        async def send_last(message: Message) -> None:
            is_last = message["type"] == "http.response.body" and not message.get("more_body", False)
            if not (is_last and has_body):
                await send(message)
                return
            await send({**message, "more_body": True})
            discarded_bytes = 0
            try:
                async with asyncio.timeout(DISCARD_SECONDS):
                    while has_body and discarded_bytes <= DISCARD_BYTES:
                        discarded_bytes += len((await receive_body()).get("body", b""))
            except TimeoutError:
                pass
            await send({"type": "http.response.body", "body": b"", "more_body": False})

        return self._app(scope, receive_body, send_last)
