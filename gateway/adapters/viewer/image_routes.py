"""Routes of images: ``/view/frame.jpg``, ``/view/stream.mjpg``, ``/view/sensor`` and ``/view/renders``."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Annotated, Any, ClassVar, Final

import cv2
import msgspec
import numpy as np
from fastapi import APIRouter, Path, Query, Request, Response
from fastapi.responses import PlainTextResponse, StreamingResponse

from gateway.adapters.viewer.config import ViewerConfig
from gateway.adapters.viewer.messages import IMAGE_NAMES, RenderEntry, StereoCapture
from gateway.adapters.viewer.scene_images import BOUNDARY, ImageRequest, SceneImages, StreamsFull
from gateway.adapters.viewer.sensor_images import SensorImages, depth_to_rgb, gray_to_rgb, shrink_to_width
from gateway.runtime.http.disconnect import while_connected
from gateway.runtime.http.openapi import error_responses, example, file_response
from gateway.runtime.http.plain_error_route import PlainErrorRoute
from gateway.runtime.http.scene_query import TIME_PARAMETER, ColorQuery, side_parameter
from gateway.runtime.logs.render_record import RenderRecord
from gateway.scene.draw.cameras import CameraError, NoSuchCameraError
from gateway.scene.tree.timeline import TimeError
from renderers.drawlist import ImageError
from renderers.encode import png_rgb
from renderers.interface import LookName

NO_STORE: Final = {"Cache-Control": "no-store"}
_UNBUFFERED: Final = {**NO_STORE, "X-Accel-Buffering": "no"}
"""For streams: nginx would keep the end of each image, up to 4 KiB, until the next one begins."""
_DEFAULTS: Final = ViewerConfig()


MaxWidth = Annotated[int | None, Query(ge=1, description="Maximum width in pixels.", openapi_examples=example(320))]


_side: Final = partial(side_parameter, max_side=_DEFAULTS.max_side, max_pixels_text=str(_DEFAULTS.max_pixels))


def _quality(default: int) -> Any:
    return Query(default, ge=1, le=100, description="JPEG quality", openapi_examples=example(85))


class JpegQuery(ColorQuery):
    """Parameters of JPEG images of the scene."""

    width: int | None = _side(_DEFAULTS.width, example_value=640)
    height: int | None = _side(_DEFAULTS.height, example_value=480)
    quality: int = _quality(85)
    look: LookName | None = Query(
        None,
        description=f"Shading. Default: {_DEFAULTS.look}, for streams {_DEFAULTS.stream_look}.",
        openapi_examples=example("plain"),
    )

    def image_request(self, config: ViewerConfig, default_look: LookName) -> ImageRequest:
        """Return the image that these parameters describe. Raises RequestValidationError if it is too large."""
        width, height = self.size(config.width, config.height, config.max_side, config.max_pixels)
        return ImageRequest(
            camera=self.camera_spec,
            width=width,
            height=height,
            quality=self.quality,
            look=self.look or default_look,
            hide=self.hidden,
            show=self.shown,
            background=self.background_rgb,
            light=self.light,
        )


class FrameQuery(JpegQuery):
    """Parameters of ``/view/frame.jpg``."""

    time: float | None = TIME_PARAMETER


class StreamQuery(JpegQuery):
    """Parameters of ``/view/stream.mjpg``."""

    quality: int = _quality(80)
    rate: float = Query(15.0, gt=0, description="Maximum frame rate, Hz", openapi_examples=example(15.0))


StereoImage = Annotated[
    str,
    Path(
        description="Name of the image",
        json_schema_extra={"enum": list(IMAGE_NAMES)},
        openapi_examples=example("disparity"),
    ),
]

_ERROR_RESPONSES: Final = error_responses(
    {
        400: "The camera cannot be used in the scene.",
        404: "The camera's node is not in the scene, there is no stereo camera, or no state of this time.",
        422: "A parameter is invalid, or a texture of the scene cannot be decoded.",
        503: "Too many requests are waiting, see Retry-After; without Retry-After, rendering took too long.",
    }
)
_JPEG_RESPONSES: Final = {**file_response("The image.", "image/jpeg"), **_ERROR_RESPONSES}
_SENSOR_RESPONSES: Final = {  # 404 has another reason here
    **_JPEG_RESPONSES,
    **error_responses({404: "There is no such image, or no stereo camera."}),
}
_STREAM_RESPONSES: Final = {
    **file_response("Images until the client disconnects.", "multipart/x-mixed-replace"),
    **_ERROR_RESPONSES,
}


class _ImageRoute(PlainErrorRoute):
    statuses: ClassVar[Mapping[type[Exception], int]] = {
        NoSuchCameraError: 404,
        TimeError: 404,
        CameraError: 400,
        ImageError: 422,
        StreamsFull: 503,
    }


def image_router(images: SceneImages, sensor: SensorImages | None, renders: Sequence[RenderRecord]) -> APIRouter:
    """Return the routes of this module. ``sensor`` is None if there is no stereo camera."""
    router = APIRouter(tags=["Browser view"], route_class=_ImageRoute)
    _add_scene_routes(router, images)
    _add_sensor_routes(router, sensor)
    _add_render_routes(router, renders)
    return router


def _add_scene_routes(router: APIRouter, images: SceneImages) -> None:
    config = images.config

    @router.get("/view/frame.jpg", summary="The live scene as JPEG", response_class=Response, responses=_JPEG_RESPONSES)
    async def frame(request: Request, query: Annotated[FrameQuery, Query()]) -> Response:
        """The gateway renders it on request."""
        image_request = query.image_request(config, config.look)
        data, revision = await while_connected(request, images.jpeg(image_request, query.time))
        return Response(data, media_type="image/jpeg", headers={**NO_STORE, "X-Scene-Revision": str(revision)})

    @router.get(
        "/view/stream.mjpg",
        summary="The live scene as MJPEG",
        response_class=StreamingResponse,
        responses=_STREAM_RESPONSES,
    )
    async def stream(request: Request, query: Annotated[StreamQuery, Query()]) -> Response:
        """A new image whenever the scene changes."""
        image_request = query.image_request(config, config.stream_look)
        await while_connected(request, images.jpeg(image_request))  # an error has a status before the stream begins
        closing: Callable[[], bool] = getattr(request.app.state, "closing", lambda: False)  # of ``cli.serve_app``
        parts = images.stream(image_request, min(query.rate, config.max_stream_rate), closing)
        media_type = f"multipart/x-mixed-replace; boundary={BOUNDARY.decode()}"
        return StreamingResponse(parts, media_type=media_type, headers=_UNBUFFERED)


def _add_sensor_routes(router: APIRouter, sensor: SensorImages | None) -> None:
    @router.get("/view/sensor", include_in_schema=False)
    async def sensor_state(request: Request) -> Response:
        if sensor is None:
            return Response(status_code=204)  # not 404, which browsers would log as an error
        capture = await while_connected(request, sensor.fresh_capture())
        return _uncached_json(
            StereoCapture(number=capture.number, captions=dict(capture.images.captions), pose=capture.images.pose)
        )

    @router.get(
        "/view/sensor/{name}.jpg",
        summary="Images of the stereo camera",
        response_class=Response,
        responses=_SENSOR_RESPONSES,
    )
    async def image(request: Request, name: StereoImage, width: MaxWidth = None) -> Response:
        """``left``, ``right``, ``disparity`` (coloured) or ``confidence`` as JPEG."""
        if sensor is None:
            return PlainTextResponse("No stereo camera runs in this gateway.", 404)
        if name not in IMAGE_NAMES:
            return PlainTextResponse(f"there is no image {name[:40]!r}; there are {', '.join(IMAGE_NAMES)}", 404)
        capture = await while_connected(request, sensor.last_capture())
        data = await sensor.jpeg(capture, name, width)
        return Response(data, media_type="image/jpeg", headers={**NO_STORE, "X-Frame": str(capture.number)})


def _add_render_routes(router: APIRouter, renders: Sequence[RenderRecord]) -> None:
    @router.get("/view/renders", include_in_schema=False)
    async def listing() -> Response:
        return _uncached_json(render_entries(renders))

    @router.get("/view/renders/{number}.png", include_in_schema=False)
    async def preview(number: int, width: MaxWidth = None) -> Response:
        record = next((record for record in renders if record.number == number and record.body), None)
        if record is None:
            return PlainTextResponse(f"the image of render {number} is no longer kept", 404)
        try:
            data = await asyncio.to_thread(encode_preview, record, width)
        except ValueError as error:
            return PlainTextResponse(str(error), 415)
        return Response(data, media_type="image/png", headers={"Cache-Control": "private, max-age=3600"})


def _uncached_json(value: Any) -> Response:
    """Return a response with a value as JSON."""
    return Response(msgspec.json.encode(value), media_type="application/json", headers=NO_STORE)


def render_entries(renders: Sequence[RenderRecord]) -> list[RenderEntry]:
    """Return requests, oldest first, as the page lists them: newest first."""
    return [
        RenderEntry(
            id=record.number,
            when=record.end_time,
            status=record.status,
            milliseconds=round(record.seconds * 1e3, 2),
            queued=round(record.queue_seconds * 1e3, 2),
            what=record.image_text,
            scene=record.scene_text,
            image=bool(record.body),
            error=record.error,
            warnings=record.warnings,
        )
        for record in reversed(renders)
    ]


def encode_preview(record: RenderRecord, width: int | None) -> bytes:
    """Return a request's image as a PNG, at most a width (None: any). Depth is mapped to colours. Raises ValueError."""
    if record.media_type == "image/png" and width is None and record.kind != "depth":
        return record.body
    pixels = cv2.imdecode(np.frombuffer(record.body, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise ValueError(f"an image of type {record.media_type} cannot be displayed")
    if record.kind == "depth":
        rgb = depth_to_rgb(np.asarray(pixels))
    else:
        bgr = gray_to_rgb(np.asarray(pixels, np.uint8))  # OpenCV's order; a fourth channel is alpha
        rgb = np.ascontiguousarray(bgr[:, :, 2::-1])
    return png_rgb(shrink_to_width(rgb, width, interpolate=record.kind != "label"))
