"""Routes of the camera's IMU: lines of JSON over HTTP, and the same lines over a WebSocket."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import ExitStack
from typing import Final

from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from fastapi.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send
from websockets.frames import CloseCode

from gateway.adapters.stereo.imaging.recorded_pairs import PairImaging
from gateway.adapters.stereo.imu.imu_service import next_lines
from gateway.adapters.stereo.routes.rest_common import Pipeline, RestError, error_responses, find_pipeline, new_router
from gateway.adapters.stereo.service import StereoService
from gateway.adapters.stereo.stream.client_queues import ClientQueue
from gateway.adapters.stereo.stream.subscriptions import LimitError, StreamError
from gateway.runtime.http.access import same_origin
from gateway.runtime.http.openapi import Responses

_MEDIA_TYPE: Final = "application/x-ndjson"
_EXAMPLE_LINE: Final = (
    '{"timestamp":{"sec":1700000000,"nsec":40000000},'
    '"linear_acceleration":{"x":0.051,"y":-9.803,"z":0.012},"angular_velocity":{"x":0.004,"y":-0.002,"z":0.006}}\n'
)
_RESPONSES: Final[Responses] = {
    200: {
        "description": "Samples until the client disconnects.",
        "content": {_MEDIA_TYPE: {"schema": {"type": "string"}, "example": _EXAMPLE_LINE}},
    },
    **error_responses(
        {
            404: "There is no such pipeline, or the camera shows recorded pairs.",
            503: "Too many clients, or the camera is not running.",
        }
    ),
}


def imu_router(*services: StereoService) -> APIRouter:
    """Return the routes ``GET /stereo/imu`` and the WebSocket ``/stereo/imu/ws``."""
    routes = new_router()

    @routes.get(
        "/stereo/imu",
        summary="Accelerometer and gyroscope of the camera, 200 samples per second",
        response_class=StreamingResponse,
        responses=_RESPONSES,
    )
    async def stream(pipeline: Pipeline = 0) -> Response:
        """Each line is a JSON object: specific force in m/s² and angular velocity in rad/s in the left optical frame.

        A client that reads too slowly loses the oldest samples: a line `{"lost": 40}` has their number. The WebSocket
        `/stereo/imu/ws` sends the same lines.
        """
        subscription = ExitStack()  # the response closes it
        queue = _subscribe(services, pipeline, subscription)
        return _ImuResponse(queue, subscription)

    @routes.websocket("/stereo/imu/ws")
    async def imu_socket(socket: WebSocket, pipeline: str = "0") -> None:
        # ``pipeline`` is not an int: FastAPI would refuse a wrong one before the connection, without a reason.
        origin = socket.headers.get("origin")
        if origin is not None and not same_origin(origin, socket.headers.get("host", ""), socket.url.scheme):
            # Browsers do not prevent a page of another site from opening this WebSocket.
            await socket.close(CloseCode.POLICY_VIOLATION, "the page comes from another host")
            return
        await socket.accept()
        with ExitStack() as subscription:
            try:
                queue = _subscribe(services, _pipeline_number(pipeline), subscription)
            except RestError as error:
                code = CloseCode.TRY_AGAIN_LATER if error.status == 503 else CloseCode.POLICY_VIOLATION
                await socket.close(code, str(error))
                return
            sending = asyncio.create_task(_send_lines(socket, queue), name="IMU client")
            try:
                while (await socket.receive())["type"] != "websocket.disconnect":
                    pass  # clients need not send anything
            finally:
                sending.cancel()
                await asyncio.gather(sending, return_exceptions=True)

    return routes


def _pipeline_number(text: str) -> int:
    """Return the number of a pipeline. Raises RestError if the text is not a number."""
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise RestError(400, f"pipeline={text[:40]!r} is not a number")
    return int(text)


def _subscribe(services: tuple[StereoService, ...], pipeline: int, subscription: ExitStack) -> ClientQueue:
    """Return the queue of a new client. Closing ``subscription`` unsubscribes it.

    Raises:
        RestError: there is no such pipeline, the camera has no IMU now, or there are too many clients.
    """
    service = find_pipeline(services, pipeline)
    if isinstance(service.imaging, PairImaging):
        raise RestError(404, "recorded pairs have no IMU")
    try:
        return subscription.enter_context(service.imu.hub.subscribe())
    except (LimitError, StreamError) as error:
        raise RestError(503, str(error)) from None


class _ImuResponse(StreamingResponse):
    """HTTP response with lines of JSON until the stream ends."""

    def __init__(self, queue: ClientQueue, subscription: ExitStack) -> None:
        """
        Args:
            queue: samples of this client.
            subscription: closed at the end, also if the client disconnects before the first line.
        """
        super().__init__(_line_stream(queue), media_type=_MEDIA_TYPE, headers={"Cache-Control": "no-store"})
        self._subscription = subscription

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        with self._subscription:
            await super().__call__(scope, receive, send)


async def _line_stream(queue: ClientQueue) -> AsyncIterator[bytes]:
    yield b""  # the response to HEAD ends at the first piece of the body: here instead of at the first sample
    try:
        while True:
            yield await next_lines(queue)
    except StreamError:
        return


async def _send_lines(socket: WebSocket, queue: ClientQueue) -> None:
    """Send lines until the client disconnects or the stream ends."""
    try:
        while True:
            await socket.send_text((await next_lines(queue)).decode())
    except StreamError as error:
        await socket.close(CloseCode.GOING_AWAY, str(error))
    except (WebSocketDisconnect, RuntimeError):  # Starlette's after a disconnect; the receiving loop ends as well
        return
