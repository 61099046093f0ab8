"""``/view``: the page, its files, the WebSocket, textures and channels of point clouds."""

from __future__ import annotations

import asyncio
import hashlib
import mimetypes
from functools import cache
from importlib.resources import files
from typing import Final

from fastapi import APIRouter, Request, Response, WebSocket, WebSocketDisconnect
from fastapi.responses import PlainTextResponse

from gateway.server.access import same_origin
from gateway.viewer.hub import Browser, ViewHub
from renderers.drawlist import Image, ImageError
from renderers.encode import png_rgba

STATIC: Final = files("gateway.viewer") / "static"
READY: Final = "k"
"""What the page sends when it has taken an update in."""
_MAX_MESSAGE: Final = 16
"""Characters of a message from the page; it has nothing longer to say."""
FOR_EVER: Final = {"Cache-Control": "public, max-age=31536000, immutable"}
ASK_AGAIN: Final = {"Cache-Control": "no-cache"}


def router(hub: ViewHub) -> APIRouter:
    """The routes of the browser view."""
    routes = APIRouter()

    @routes.get("/view", include_in_schema=False)
    async def page(request: Request) -> Response:
        return _file("index.html", request, ASK_AGAIN)

    @routes.get("/view/assets/{name}", include_in_schema=False)
    async def asset(name: str, request: Request) -> Response:
        if name not in _assets():
            return PlainTextResponse(f"the page has no file {name[:80]!r}", 404)
        return _file(f"assets/{name}", request, FOR_EVER)

    @routes.get("/view/image/{number}", include_in_schema=False)
    async def image(number: int) -> Response:
        found = hub.payloads.image(number)
        if found is None:
            return PlainTextResponse(f"nothing in the scene uses image {number} any more", 404)
        try:
            data = await asyncio.to_thread(_encode, found)
        except ImageError as error:
            return PlainTextResponse(f"image {number}: {error}", 415)
        return Response(data, media_type="image/png", headers=ASK_AGAIN)

    @routes.get("/view/channel/{mesh}", include_in_schema=False)
    async def channel(mesh: int, name: str) -> Response:
        values = hub.payloads.channel(mesh, name)
        if values is None:
            return PlainTextResponse(f"mesh {mesh} is no point cloud with a channel {name[:80]!r}", 404)
        # Copied in a thread: a cloud of millions of points has tens of megabytes.
        data = await asyncio.to_thread(values.tobytes)
        return Response(data, media_type="application/octet-stream", headers=ASK_AGAIN)

    @routes.websocket("/view/ws")
    async def connection(socket: WebSocket) -> None:
        origin = socket.headers.get("origin")
        if origin is not None and not same_origin(origin, socket.headers.get("host", ""), socket.url.scheme):
            # Browsers let any page open a WebSocket to any host, this one included.
            await socket.close(1008, "the page comes from another host")
            return
        await socket.accept()
        try:
            browser = hub.connect()
        except ConnectionRefusedError as error:
            await socket.close(1013, str(error))
            return
        sending = asyncio.create_task(_send(socket, browser), name="view browser")
        try:
            await _receive(socket, browser)
        finally:
            browser.close()
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    return routes


async def _send(socket: WebSocket, browser: Browser) -> None:
    try:
        async for frame in browser.frames():
            await socket.send_bytes(frame)
        await socket.close(1001, "the gateway ends")
    except (WebSocketDisconnect, RuntimeError):
        # The page is gone; ``_receive`` notices the same and ends the connection.
        return


async def _receive(socket: WebSocket, browser: Browser) -> None:
    try:
        while True:
            text = await socket.receive_text()
            if text == READY:
                browser.ready()
            elif len(text) > _MAX_MESSAGE:
                await socket.close(1009, "the page has nothing so long to say")
                return
    except (WebSocketDisconnect, KeyError):
        # KeyError: bytes instead of text.
        return


def _encode(image: Image) -> bytes:
    return png_rgba(image.decode())


@cache
def _assets() -> frozenset[str]:
    return frozenset(entry.name for entry in (STATIC / "assets").iterdir())


@cache
def _read(path: str) -> tuple[bytes, str]:
    """A file of the page and its tag; there is a handful, and they do not change."""
    data = STATIC.joinpath(path).read_bytes()
    return data, f'"{hashlib.sha256(data).hexdigest()[:16]}"'


def _file(path: str, request: Request, headers: dict[str, str]) -> Response:
    data, tag = _read(path)
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers={**headers, "ETag": tag})
    kind = mimetypes.guess_type(path)[0] or "application/octet-stream"
    return Response(data, media_type=kind, headers={**headers, "ETag": tag})
