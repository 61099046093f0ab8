"""Routes of the page ``/view``: its files, the WebSocket, textures and channels of point clouds."""

import asyncio
import gzip
import hashlib
import mimetypes
from functools import cache
from typing import Any, Final

import msgspec
from fastapi import APIRouter, Request, Response, WebSocket, WebSocketDisconnect, status
from fastapi.responses import PlainTextResponse
from fastapi.websockets import WebSocketState

from gateway.adapters.viewer.browser import Browser
from gateway.adapters.viewer.config import STATIC
from gateway.adapters.viewer.hub import ViewHub
from gateway.adapters.viewer.messages import REPORTS, Click, ControlChange, Forgot, TimeCommand
from gateway.adapters.viewer.resources import channel_values
from gateway.runtime.http.access import same_origin
from gateway.scene.tree.geometry import PointCloud
from renderers.drawlist import ImageError
from renderers.images import browser_file

ACKNOWLEDGE: Final = "k"
"""Message that the page sends after processing an update."""
ACKNOWLEDGE_CONTROLS: Final = "c"
"""Message that the page sends after processing a frame of controls."""
MAX_MESSAGE_CHARS: Final = 8192
"""Maximum length of a message from the page; a text of 1000 characters has up to 6000 in JSON."""
MAX_CHANGES: Final = 200
"""Maximum number of changes of controls of a page in a second; reading waits before further ones."""
MAX_CLICKS: Final = 50
"""Maximum number of clicks of a page in a second; further ones are dropped, because no person clicks so fast."""
IMMUTABLE: Final = {"Cache-Control": "public, max-age=31536000, immutable"}
"""Response headers: browsers keep the file and never request it again."""
CONTENT_SECURITY_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; base-uri 'none'"
)
"""Content security policy of the page: it uses its own gateway only; its icon is in the page."""
REVALIDATE: Final = {"Cache-Control": "no-cache"}
"""Response headers: browsers check at every use whether the file has changed."""


def router(hub: ViewHub) -> APIRouter:
    """Return the routes of this module."""
    routes = APIRouter()

    @routes.get("/view", include_in_schema=False)
    async def page(request: Request) -> Response:
        return await asyncio.to_thread(
            _file, "index.html", request, {**REVALIDATE, "Content-Security-Policy": CONTENT_SECURITY_POLICY}
        )

    @routes.get("/view/assets/{name}", include_in_schema=False)
    async def asset(name: str, request: Request) -> Response:
        if name not in _assets():
            return PlainTextResponse(f"the page has no file {name[:80]!r}", 404)
        return await asyncio.to_thread(_file, f"assets/{name}", request, IMMUTABLE)

    @routes.get("/view/image/{image_id}", include_in_schema=False)
    async def image(image_id: int) -> Response:
        texture = hub.resources.image(image_id)
        if texture is None:
            return PlainTextResponse(f"nothing in the scene uses image {image_id} any more", 404)
        try:
            data, media_type = await asyncio.to_thread(browser_file, texture)
        except ImageError as error:
            return PlainTextResponse(f"image {image_id}: {error}", 415)
        return Response(data, media_type=media_type, headers=REVALIDATE)

    @routes.get("/view/channel/{mesh_id}", include_in_schema=False)
    async def channel(mesh_id: int, name: str) -> Response:
        cloud = hub.resources.clouds.get(mesh_id)
        # In a thread, because a channel may have tens of megabytes.
        data = None if cloud is None else await asyncio.to_thread(_encode_channel, cloud, name)
        if data is None:
            return PlainTextResponse(f"mesh {mesh_id} is not a point cloud with a channel {name[:80]!r}", 404)
        return Response(data, media_type="application/octet-stream", headers=REVALIDATE)

    @routes.websocket("/view/ws")
    async def connection(socket: WebSocket) -> None:
        origin = socket.headers.get("origin")
        if origin is not None and not same_origin(origin, socket.headers.get("host", ""), socket.url.scheme):
            # Browsers do not prevent a page of another site from opening this WebSocket.
            await socket.close(status.WS_1008_POLICY_VIOLATION, "the page comes from another host")
            return
        await socket.accept()
        try:
            browser = hub.connect()
        except ConnectionRefusedError as error:
            await socket.close(status.WS_1013_TRY_AGAIN_LATER, str(error))
            return
        sending = asyncio.create_task(_send(socket, browser), name="view browser")
        try:
            await _receive(socket, browser, hub)
        finally:
            browser.close()
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    return routes


async def _send(socket: WebSocket, browser: Browser) -> None:
    """Send frames to the page until it disconnects or the gateway shuts down."""
    try:
        async for frame in browser.frames():
            await socket.send_bytes(frame)
        await socket.close(status.WS_1001_GOING_AWAY, "the gateway is shutting down")
    except (WebSocketDisconnect, RuntimeError):
        return  # disconnected: _receive ends, too


async def _receive(socket: WebSocket, browser: Browser, hub: ViewHub) -> None:
    """Receive the page's messages until it disconnects or sends a binary one.

    They are acknowledgements, clicks, changes of controls, commands of the time bar, and meshes that it has dropped.
    """
    clock = asyncio.get_running_loop().time
    second_start, click_count, change_count = clock(), 0, 0
    try:
        while socket.application_state is WebSocketState.CONNECTED:  # sending has not failed
            text = await socket.receive_text()
            if clock() - second_start >= 1.0:
                second_start, click_count, change_count = clock(), 0, 0
            if text == ACKNOWLEDGE:
                browser.acknowledge()
            elif text == ACKNOWLEDGE_CONTROLS:
                browser.acknowledge_controls()
            elif len(text) > MAX_MESSAGE_CHARS:
                await socket.close(
                    status.WS_1009_MESSAGE_TOO_BIG, f"messages have at most {MAX_MESSAGE_CHARS} characters"
                )
                return
            elif isinstance(message := _read_message(text), ControlChange):
                hub.change_control(browser, message)
                change_count += 1
                if change_count >= MAX_CHANGES:
                    await asyncio.sleep(max(0.0, second_start + 1.0 - clock()))
            elif isinstance(message, TimeCommand):
                browser.execute(message)
            elif isinstance(message, Forgot):
                browser.forgot(message.forgot)
            elif message is not None:
                click_count += 1
                if click_count <= MAX_CLICKS:
                    hub.click(browser, message.node, message.point, message.button)
    except WebSocketDisconnect:
        return
    except KeyError:  # of ``receive_text``: a binary message
        await socket.close(status.WS_1003_UNSUPPORTED_DATA, "messages of the page are text")


_decoders: Final[dict[str, msgspec.json.Decoder[Any]]] = {
    each.__struct_fields__[0]: msgspec.json.Decoder(each) for each in REPORTS
}
"""Decoders of messages by their first field, which tells them apart."""


def _read_message(text: str) -> Click | ControlChange | TimeCommand | Forgot | None:
    """Return the value of a message, or None if it is none of these."""
    try:
        message: Click | ControlChange | TimeCommand | Forgot = _decoders[text[:16].split('"')[1]].decode(text)
        return message
    except (IndexError, KeyError, msgspec.DecodeError, UnicodeEncodeError):
        return None


def _encode_channel(cloud: PointCloud, name: str) -> bytes | None:
    """Return a channel of a point cloud as float32, or None if there is no such channel."""
    values = channel_values(cloud, name)
    return None if values is None else values.tobytes()


@cache
def _assets() -> frozenset[str]:
    return frozenset(entry.name for entry in (STATIC / "assets").iterdir())


@cache
def _read(path: str, compressed: bool) -> tuple[bytes, str]:
    """Return a file of the page, and its ETag. Called in a thread: gzip takes 0.1 s for the largest."""
    data = STATIC.joinpath(path).read_bytes()
    if compressed:
        data = gzip.compress(data, mtime=0)
    return data, f'"{hashlib.sha256(data).hexdigest()[:16]}"'


def _file(path: str, request: Request, headers: dict[str, str]) -> Response:
    """Return the response with a file of the page, or status 304 if the browser has the current file."""
    compressed = "gzip" in request.headers.get("accept-encoding", "")  # as Starlette's GZipMiddleware decides
    data, etag = _read(path, compressed)
    headers = {**headers, "ETag": etag, "Vary": "Accept-Encoding"}
    if request.headers.get("if-none-match") == etag:
        return Response(status_code=304, headers=headers)
    if compressed:
        headers["Content-Encoding"] = "gzip"
    media_type = mimetypes.guess_type(path)[0] or "application/octet-stream"
    return Response(data, media_type=media_type, headers=headers)
