"""``GET /cameras/…``: descriptions of the cameras, and images that are captured on request, without a stream."""

from __future__ import annotations

from collections.abc import Awaitable, Mapping, Sequence
from typing import Annotated, Any, Final, Literal

import numpy as np
from fastapi import APIRouter, Path, Query
from fastapi.responses import Response
from numpy.typing import NDArray

from gateway.adapters.stereo.device.timestamps import timestamp_text
from gateway.adapters.stereo.routes.rest_common import RestError, error_responses, new_router
from gateway.adapters.stereo.routes.rgbd import rgbd_npz
from gateway.adapters.stereo.service import StereoService
from gateway.adapters.stereo.stream.frame import FrameImages
from gateway.adapters.stereo.stream.set_kind import SetKind
from gateway.runtime.http.openapi import Responses, example, file_response, json_example
from gateway.runtime.http.scene_query import TIME_PARAMETER
from gateway.scene.tree.timeline import TimeError
from renderers.drawlist import ImageError
from renderers.encode import png_gray8, png_gray16, png_rgb
from renderers.stereo.model import Intrinsics
from renderers.stereo.sensor.camera_image import NoiseStream

ImageName = Literal["color", "depth", "left", "right", "disparity", "confidence"]
_SETS_BY_IMAGE: Final[Mapping[ImageName, SetKind]] = {
    "color": SetKind(color_camera=True),
    "depth": SetKind(depth_mm=True),
    "left": SetKind(left=True),
    "right": SetKind(right=True),
    "disparity": SetKind(disparity=True),
    "confidence": SetKind(confidence=True),
}
"""Image set to capture for each image."""
_RGBD: Final = SetKind(color_camera=True, depth_mm=True)
_INTRINSICS_EXAMPLE: Final = {
    "width": 848,
    "height": 480,
    "K": [[425.0, 0.0, 424.0], [0.0, 425.0, 240.0], [0.0, 0.0, 1.0]],
    "K_opencv": [[425.0, 0.0, 423.5], [0.0, 425.0, 239.5], [0.0, 0.0, 1.0]],
}
_CAMERA_EXAMPLE: Final = {
    "name": "stereo",
    "model": "RGB-D",
    "pipeline": 0,
    "port": 50051,
    "baseline": 0.05,
    "images": {"left": _INTRINSICS_EXAMPLE},
    "X_left_color": [[1.0, 0.0, 0.0, 0.015], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
}
_ERRORS: Final = {
    404: "There is no such camera, no such image of it, or no state of this time.",
    500: "A texture of the scene cannot be decoded.",
    503: "Too many requests wait already; see Retry-After.",
}
_IMAGE_DESCRIPTION: Final = (
    "X-Timestamp: time of the image, seconds.nanoseconds. The camera's parameters are those of now."
)

Aligned = Annotated[
    bool, Query(description="Depth as seen by the colour camera, with its size", openapi_examples=example(False))
]


def camera_router(*services: StereoService) -> APIRouter:
    """Return the routes below ``/cameras``. A camera's pipeline number is its index in ``services``."""
    routes = new_router()
    names = [service.config.name for service in services]
    camera_name = Path(
        description="Name of the camera, or number of its pipeline",
        json_schema_extra={"enum": [*names, *map(str, range(len(names)))]},
        openapi_examples=example(names[0]),
    )

    @routes.get("/cameras", summary="Cameras", responses=json_example({"cameras": [_CAMERA_EXAMPLE]}))
    async def cameras() -> dict[str, Any]:
        return {"cameras": [_describe(number, service) for number, service in enumerate(services)]}

    @routes.get(
        "/cameras/{name}", summary="A camera", responses=json_example(_CAMERA_EXAMPLE) | error_responses(_ERRORS)
    )
    async def camera(name: str = camera_name) -> dict[str, Any]:
        return _describe(*_find(services, name))

    @routes.get(
        "/cameras/{name}/rgbd.npz",
        summary="Colour and depth of one instant, with intrinsics and poses",
        response_class=Response,
        responses=_responses("application/zip"),
    )
    async def rgbd(name: str = camera_name, aligned: Aligned = False, time: float | None = TIME_PARAMETER) -> Response:
        service = _find_with_color(services, name)
        frame = await _capture(service, _RGBD, time)
        data = await _compute(rgbd_npz(frame, service.config, service.workers, aligned=aligned))
        return _response(data, "application/zip", frame)

    @routes.get(
        "/cameras/{name}/{image}",
        summary="An image",
        response_class=Response,
        responses=_responses("image/png"),
    )
    async def image(
        image: Annotated[
            ImageName,
            Path(
                description="color: RGB. depth: 16 bits, millimetres, 0: invalid. left, right: grey. "
                "disparity: 16 bits, 1/16 pixel, 0: invalid. confidence: 8 bits, 1/255.",
                openapi_examples=example("color"),
            ),
        ],
        name: str = camera_name,
        aligned: Aligned = False,
        time: float | None = TIME_PARAMETER,
    ) -> Response:
        service = _find_with_color(services, name) if image == "color" else _find(services, name)[1]
        frame = await _capture(service, _SETS_BY_IMAGE[image], time)
        pixels = await _compute(_pixels(frame, image, aligned=aligned))
        return _response(await service.workers.run(_png, pixels), "image/png", frame)

    return routes


def _responses(media_type: str) -> Responses:
    return {**file_response(_IMAGE_DESCRIPTION, media_type), **error_responses(_ERRORS)}


def _find(services: Sequence[StereoService], name: str) -> tuple[int, StereoService]:
    """Return the pipeline number and the service of a camera, by its name or number. Raises RestError."""
    for number, service in enumerate(services):
        if name in (service.config.name, str(number)):
            return number, service
    names = ", ".join(service.config.name for service in services)
    raise RestError(404, f"there is no camera {name[:80]!r}; there are {names}")


def _find_with_color(services: Sequence[StereoService], name: str) -> StereoService:
    """Return the service of a camera, by its name or number. Raises RestError for a monochrome one."""
    _, service = _find(services, name)
    if service.config.color_camera is None and not service.config.color:
        raise RestError(404, f"the camera {service.config.name!r}, {service.config.model.name}, is monochrome")
    return service


def _describe(number: int, service: StereoService) -> dict[str, Any]:
    """Return the JSON description of a camera: name, intrinsics in pixels, extrinsics in metres, gRPC port."""
    config, divisor = service.config, service.settings.quality.divisor
    left, depth = (_intrinsics(config.model.intrinsics(d)) for d in (1, divisor))
    images = {"left": left, "right": left, "depth": depth, "disparity": depth, "confidence": depth}
    description = {
        "name": config.name,
        "model": config.model.name,
        "pipeline": number,
        "port": service.port or config.port,  # HTTP serves before the gRPC port is open
        "baseline": config.model.baseline,
        "images": images,
    }
    if config.color or config.color_camera is not None:
        images["color"] = _intrinsics(config.color_intrinsics)
        description["X_left_color"] = config.X_left_color.tolist()
    return description


def _intrinsics(k: Intrinsics) -> dict[str, Any]:
    """Return size and camera matrices: ``K`` as in docs/conventions.md, and that of OpenCV, half a pixel less."""
    matrices = {"K": k.matrix, "K_opencv": k.opencv_matrix}
    return {"width": k.width, "height": k.height, **{name: k.round(6).tolist() for name, k in matrices.items()}}


async def _capture(service: StereoService, kind: SetKind, time: float | None) -> FrameImages:
    """Return a frame of a time. Raises RestError if there is no state of it."""
    try:
        return await service.capture(kind, time)
    except TimeError as error:
        raise RestError(404, str(error)) from None


async def _compute(work: Awaitable[Any]) -> Any:
    """Return an awaited result. Raises RestError if a texture of the scene cannot be decoded."""
    try:
        return await work
    except ImageError as error:
        raise RestError(500, f"a texture of the scene cannot be decoded: {error}") from None


async def _pixels(frame: FrameImages, name: ImageName, *, aligned: bool) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Return an image of a frame, (H, W, 3) for colour, else (H, W). Raises ImageError."""
    if name == "color":
        return (await frame.color_camera_image()).sensor_image.image
    if name == "depth":
        return await frame.depth_mm(aligned=aligned)
    if name in ("left", "right"):
        stream = NoiseStream.LEFT if name == "left" else NoiseStream.RIGHT
        return (await frame.image(stream, color=False)).image
    images = await frame.depth_images()
    return images.disparity if name == "disparity" else images.confidence


def _png(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """Return a PNG of (H, W) uint8 or uint16, or (H, W, 3) uint8."""
    if pixels.dtype == np.uint16:
        return png_gray16(np.ascontiguousarray(pixels, np.uint16))
    image = np.ascontiguousarray(pixels, np.uint8)
    return png_rgb(image) if image.ndim == 3 else png_gray8(image)


def _response(data: bytes, media_type: str, frame: FrameImages) -> Response:
    headers = {"Cache-Control": "no-store", "X-Timestamp": timestamp_text(frame.record.camera_capture.timestamp)}
    return Response(data, media_type=media_type, headers=headers)
