"""Routes of the camera's IMU: lines of JSON over HTTP, and the same lines over a WebSocket."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import ExitStack
from typing import Final

from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from fastapi.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from gateway.server.access import same_origin
from gateway.server.openapi import Responses
from gateway.stereo.imaging.recorded_pairs import PairImaging
from gateway.stereo.imu.imu_service import next_lines
from gateway.stereo.routes.rest_common import Pipeline, RestError, error_responses, find_pipeline, new_router
from gateway.stereo.service import StereoService
from gateway.stereo.stream.client_queues import ClientQueue
from gateway.stereo.stream.subscriptions import LimitError, StreamError

_MEDIA_TYPE: Final = "application/x-ndjson"
_NO_IMU: Final = "recorded pairs have no IMU"
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
    api = new_router()

    @api.get(
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
        exit_stack = ExitStack()
        queue = _subscribe(services, pipeline, exit_stack)
        return _ImuResponse(queue, exit_stack)

    @api.websocket("/stereo/imu/ws")
    async def connection(socket: WebSocket, pipeline: str = "0") -> None:
        origin = socket.headers.get("origin")
        if origin is not None and not same_origin(origin, socket.headers.get("host", ""), socket.url.scheme):
            # Browsers do not prevent a page of another site from opening this WebSocket.
            await socket.close(1008, "the page comes from another host")
            return
        await socket.accept()
        with ExitStack() as exit_stack:
            try:
                queue = _subscribe(services, _pipeline_number(pipeline), exit_stack)
            except RestError as error:
                await socket.close(1013 if error.status == 503 else 1008, str(error))
                return
            sending = asyncio.create_task(_send(socket, queue), name="IMU client")
            try:
                while (await socket.receive())["type"] != "websocket.disconnect":
                    pass  # clients need not send anything
            finally:
                sending.cancel()
                await asyncio.gather(sending, return_exceptions=True)

    return api


def _pipeline_number(text: str) -> int:
    """Return the number of a pipeline. FastAPI would refuse a wrong one without a reason, before the connection.

    Raises:
        RestError: the text is not a number.
    """
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise RestError(400, f"pipeline={text[:40]!r} is not a number")
    return int(text)


def _subscribe(services: tuple[StereoService, ...], pipeline: int, exit_stack: ExitStack) -> ClientQueue:
    """Return the queue of a new client. Closing ``exit_stack`` unsubscribes it.

    Raises:
        RestError: there is no such pipeline, the camera has no IMU now, or there are too many clients.
    """
    service = find_pipeline(services, pipeline)
    if isinstance(service.imaging, PairImaging):
        raise RestError(404, _NO_IMU)
    try:
        return exit_stack.enter_context(service.imu.hub.subscribe())
    except (LimitError, StreamError) as error:
        raise RestError(503, str(error)) from None


class _ImuResponse(StreamingResponse):
    """HTTP response with lines of JSON until the stream ends."""

    def __init__(self, queue: ClientQueue, exit_stack: ExitStack) -> None:
        """
        Args:
            queue: samples of this client.
            exit_stack: closed at the end, also if the client disconnects before the first line.
        """
        super().__init__(_lines(queue), media_type=_MEDIA_TYPE, headers={"Cache-Control": "no-store"})
        self._exit_stack = exit_stack

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        with self._exit_stack:
            await super().__call__(scope, receive, send)


async def _lines(queue: ClientQueue) -> AsyncIterator[bytes]:
    yield b""  # a HEAD request ends here instead of at the first sample
    try:
        while True:
            yield await next_lines(queue)
    except StreamError:
        return


async def _send(socket: WebSocket, queue: ClientQueue) -> None:
    """Send lines until the client disconnects or the stream ends."""
    try:
        while True:
            await socket.send_text((await next_lines(queue)).decode())
    except StreamError as error:
        await socket.close(1001, str(error))
    except (WebSocketDisconnect, RuntimeError):
        return  # disconnected; the receiving loop ends as well
