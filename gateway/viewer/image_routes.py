"""``/view/frame.jpg``, ``/view/stream.mjpg``, the stereo camera's pictures and the last renders."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Annotated, Any, Final

from fastapi import APIRouter, Path, Query, Request, Response
from fastapi.responses import JSONResponse, PlainTextResponse, StreamingResponse
from starlette.requests import ClientDisconnect

from gateway.runtime.worker_pool import DeadlineExceeded, PoolClosed, QueueFull
from gateway.scene.cameras import PATTERN, CameraError, NoSuchCameraError, parse_camera
from gateway.server.disconnect import CLIENT_GONE, while_connected
from gateway.server.openapi import example
from gateway.viewer.config import ViewerConfig
from gateway.viewer.renders import RecentRenders, shown
from gateway.viewer.scene_images import BOUNDARY, Pictures, StreamsFull, View
from gateway.viewer.sensor import SensorView
from gateway.viewer.sources import PICTURE_NAMES
from renderers.drawlist import ImageError
from renderers.interface import LookName

NO_STORE: Final = {"Cache-Control": "no-store"}
_CAMERA: Final = (
    'stereo, fit, path:["robot","head"] (a node\'s frame, optical: +Z forward), or '
    "eye=x,y,z;target=x,y,z;up=x,y,z;fovy=degrees"
)
_LIMITS: Final = ViewerConfig()
Size = Annotated[
    int | None,
    Query(
        ge=1,
        description=f"Pixels; width x height is at most {_LIMITS.max_pixels}",
        json_schema_extra={"maximum": _LIMITS.max_side},  # the handler refuses more, with a sentence
        openapi_examples=example(640),
    ),
]
Width = Annotated[int | None, Query(ge=1, description="Pixels at most", openapi_examples=example(320))]
CameraText = Annotated[
    str,
    Query(
        description=_CAMERA,
        json_schema_extra={"pattern": PATTERN},
        openapi_examples=example("eye=2,-2,1.5;target=0,0,0.5"),
    ),
]
Quality = Annotated[int, Query(ge=1, le=100, description="Of the JPEG", openapi_examples=example(85))]
LookChoice = Annotated[LookName | None, Query(description="How colour is made", openapi_examples=example("plain"))]
PictureText = Annotated[
    str,
    Path(
        description="Which picture",
        json_schema_extra={"enum": list(PICTURE_NAMES)},
        openapi_examples=example("disparity"),
    ),
]


_TEXT: Final = {"text/plain": {"schema": {"type": "string"}}}
_REFUSALS: Final[dict[int | str, dict[str, Any]]] = {
    400: {"description": "The camera or the size cannot be used; the text says why.", "content": _TEXT},
    404: {"description": "The camera's node is not in the scene, or there is no stereo camera.", "content": _TEXT},
    422: {
        "description": "A parameter is out of its range, or the scene has a texture that cannot be read.",
        "content": {**_TEXT, "application/json": {"schema": {"type": "object"}}},
    },
    503: {
        "description": "Too many requests wait already, see Retry-After; or, without it, the picture took too long.",
        "content": _TEXT,
    },
}
_JPEG: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The picture.", "content": {"image/jpeg": {"schema": {"type": "string", "format": "binary"}}}},
    **_REFUSALS,
}
_SENSOR: Final[dict[int | str, dict[str, Any]]] = {
    **_JPEG,
    404: {"description": "There is no such picture, or no stereo camera.", "content": _TEXT},
}
_STREAM: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "Pictures without an end.",
        "content": {"multipart/x-mixed-replace": {"schema": {"type": "string", "format": "binary"}}},
    },
    **_REFUSALS,
}


class _ViewError(ValueError):
    """The message names the parameter."""


def picture_router(pictures: Pictures, sensor: SensorView | None, renders: RecentRenders) -> APIRouter:
    """The routes that answer with pictures."""
    routes = APIRouter(tags=["Browser view"])
    _add_views(routes, pictures)
    _add_sensor(routes, sensor)

    @routes.get("/view/renders", include_in_schema=False)
    async def listing() -> JSONResponse:
        return JSONResponse(renders.listing(), headers=NO_STORE)

    @routes.get("/view/renders/{number}.png", include_in_schema=False)
    async def render(number: int, width: Width = None) -> Response:
        found = renders.find(number)
        if found is None:
            return PlainTextResponse(f"the picture of render {number} is not kept any more", 404)
        try:
            data = await asyncio.to_thread(shown, *found, width)
        except ValueError as error:
            return PlainTextResponse(str(error), 415)
        return Response(data, media_type="image/png", headers={"Cache-Control": "private, max-age=3600"})

    return routes


def _add_views(routes: APIRouter, pictures: Pictures) -> None:
    config = pictures.config

    def view_of(camera: str, width: int | None, height: int | None, quality: int, look: LookName) -> View:
        try:
            spec = parse_camera(camera)
        except CameraError as error:
            raise _ViewError(str(error)) from error
        wide, high = width or config.width, height or config.height
        if max(wide, high) > config.max_side or wide * high > config.max_pixels:
            limit = f"{config.max_side} pixels a side and {config.max_pixels} altogether"
            raise _ViewError(f"{wide}x{high} pixels are too many; at most {limit} are drawn")
        return View(spec, wide, high, quality, look)

    @routes.get("/view/frame.jpg", summary="The live scene as JPEG", response_class=Response, responses=_JPEG)
    async def frame(
        request: Request,
        camera: CameraText = "fit",
        width: Size = None,
        height: Size = None,
        quality: Quality = 85,
        look: LookChoice = None,
    ) -> Response:
        """Drawn by the gateway's own rasterizer."""
        try:
            view = view_of(camera, width, height, quality, look or config.look)
        except _ViewError as error:
            return PlainTextResponse(str(error), 400)
        return await _answered(request, pictures, view)

    @routes.get(
        "/view/stream.mjpg", summary="The live scene as MJPEG", response_class=StreamingResponse, responses=_STREAM
    )
    async def stream(
        request: Request,
        camera: CameraText = "fit",
        width: Size = None,
        height: Size = None,
        quality: Quality = 80,
        look: LookChoice = None,
        rate: Annotated[
            float, Query(gt=0, description="Pictures per second at most", openapi_examples=example(15.0))
        ] = 15.0,
    ) -> Response:
        """A new picture whenever the scene has changed, for anything that shows MJPEG."""
        try:
            view = view_of(camera, width, height, quality, look or config.stream_look)
        except _ViewError as error:
            return PlainTextResponse(str(error), 400)
        first = await _answered(request, pictures, view)
        if first.status_code != 200:
            return first
        closing: Callable[[], bool] = getattr(request.app.state, "closing", lambda: False)
        try:
            parts = pictures.stream(view, min(rate, config.stream_rate), closing)
        except StreamsFull as error:
            return PlainTextResponse(str(error), 503, {"Retry-After": "10"})
        kind = f"multipart/x-mixed-replace; boundary={BOUNDARY.decode()}"
        return StreamingResponse(parts, media_type=kind, headers=NO_STORE)


async def _answered(request: Request, pictures: Pictures, view: View) -> Response:
    try:
        data, revision = await while_connected(request, pictures.jpeg(view))
    except ClientDisconnect:
        return Response(status_code=CLIENT_GONE)
    except NoSuchCameraError as error:
        return PlainTextResponse(str(error), 404)
    except CameraError as error:
        return PlainTextResponse(str(error), 400)
    except ImageError as error:
        return PlainTextResponse(str(error), 422)
    except (QueueFull, PoolClosed) as error:
        return PlainTextResponse(str(error), 503, {"Retry-After": str(getattr(error, "retry_after", 1))})
    except DeadlineExceeded as error:
        return PlainTextResponse(f"the picture was given up: {error}", 503)
    return Response(data, media_type="image/jpeg", headers={**NO_STORE, "X-Scene-Revision": str(revision)})


def _add_sensor(routes: APIRouter, sensor: SensorView | None) -> None:
    @routes.get("/view/sensor", include_in_schema=False)
    async def state(request: Request) -> Response:
        if sensor is None:
            return Response(status_code=204)  # not an error: browsers would fill their console with those
        try:
            taken = await while_connected(request, sensor.newest())
            return JSONResponse(taken.describe(), headers=NO_STORE)
        except ClientDisconnect:
            return Response(status_code=CLIENT_GONE)
        except (QueueFull, PoolClosed) as error:
            return PlainTextResponse(str(error), 503, {"Retry-After": "1"})
        except DeadlineExceeded as error:
            return PlainTextResponse(f"the pictures were given up: {error}", 503)
        except ImageError as error:
            return PlainTextResponse(str(error), 422)

    @routes.get(
        "/view/sensor/{name}.jpg", summary="What the stereo camera sees", response_class=Response, responses=_SENSOR
    )
    async def picture(request: Request, name: PictureText, width: Width = None) -> Response:
        """``left``, ``right``, ``disparity`` (coloured) or ``confidence``, as JPEG."""
        if sensor is None:
            return PlainTextResponse("No stereo camera runs in this gateway.", 404)
        if name not in PICTURE_NAMES:
            return PlainTextResponse(f"there is no picture {name[:40]!r}; there are {', '.join(PICTURE_NAMES)}", 404)
        try:
            taken = await while_connected(request, sensor.last())
            data = await taken.jpeg(name, width)
        except ClientDisconnect:
            return Response(status_code=CLIENT_GONE)
        except (QueueFull, PoolClosed) as error:
            return PlainTextResponse(str(error), 503, {"Retry-After": "1"})
        except DeadlineExceeded as error:
            return PlainTextResponse(f"the pictures were given up: {error}", 503)
        except ImageError as error:
            return PlainTextResponse(str(error), 422)
        return Response(data, media_type="image/jpeg", headers={**NO_STORE, "X-Frame": str(taken.number)})
