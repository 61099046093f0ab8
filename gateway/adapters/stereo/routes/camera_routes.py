"""``/cameras/…``: descriptions and places of the cameras, and images that are captured on request, without a stream."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, Literal

import numpy as np
from fastapi import APIRouter, Path, Query
from fastapi.responses import Response
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.timestamps import timestamp_text
from gateway.adapters.stereo.imaging.scene_view import SceneView
from gateway.adapters.stereo.routes.rest_common import RestError, error_responses, new_router
from gateway.adapters.stereo.routes.truth_routes import npz_bytes
from gateway.adapters.stereo.service import StereoService
from gateway.adapters.stereo.stream.frame import FrameImages
from gateway.adapters.stereo.stream.set_kind import SetKind
from gateway.runtime.http.openapi import Responses, example, file_response, json_example
from gateway.runtime.http.scene_query import TIME_PARAMETER
from gateway.scene.draw.cameras import LOOK_AT_PATTERN, CameraError
from gateway.scene.draw.mount import mount_pose_text, parse_mount_pose
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

_POSE_EXAMPLE: Final = "eye=1.4,-1.1,1.7;target=0,0,0.85;up=0,0,1"
_POSE_RESPONSES: Final = json_example({"pose": _POSE_EXAMPLE}) | error_responses({404: "There is no such camera."})

Aligned = Annotated[
    bool, Query(description="Depth as seen by the colour camera, with its size", openapi_examples=example(False))
]


def camera_router(*services: StereoService) -> APIRouter:
    """Return the routes below ``/cameras``. A camera's pipeline number is its index in ``services``."""
    routes = new_router()
    camera_name = _camera_name([service.config.name for service in services])

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
        frame = await service.capture(_RGBD, time)
        arrays = await _rgbd_arrays(frame, service.config, aligned=aligned)
        return _response(await service.workers.run(npz_bytes, arrays), "application/zip", frame)

    @routes.get(
        "/cameras/{name}/{image}", summary="An image", response_class=Response, responses=_responses("image/png")
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
        frame = await service.capture(_SETS_BY_IMAGE[image], time)
        pixels = await _pixels(frame, image, aligned=aligned)
        return _response(await service.workers.run(_png, pixels), "image/png", frame)

    return routes


def pose_router(views: Mapping[str, SceneView]) -> APIRouter:
    """Return the routes of the cameras' places. ``views``: of all cameras by name, in the order of their pipelines."""
    routes = new_router()
    camera_name = _camera_name([*views])

    def find(name: str) -> SceneView:
        return [*views.values()][_number_of(name, [*views])]

    def text_of(view: SceneView) -> dict[str, str]:
        return {"pose": mount_pose_text(view.pose_in(view.tree.snapshot))}

    @routes.get("/cameras/{name}/pose", summary="Where a camera is", responses=_POSE_RESPONSES)
    async def get_pose(name: str = camera_name) -> dict[str, str]:
        """The left optical frame in the world, as text for `--stereo-pose`."""
        return text_of(find(name))

    @routes.put(
        "/cameras/{name}/pose",
        summary="Place a camera",
        responses=_POSE_RESPONSES
        | error_responses({400: "The text is not a pose.", 409: "The camera follows a node of the scene."}),
    )
    async def put_pose(
        pose: Annotated[
            str,
            Query(
                description="x,y,z,qw,qx,qy,qz or eye=x,y,z;target=x,y,z;up=x,y,z, as --stereo-pose.",
                json_schema_extra={"pattern": LOOK_AT_PATTERN},
                openapi_examples=example(_POSE_EXAMPLE),
            ),
        ],
        name: str = camera_name,
    ) -> dict[str, str]:
        """Move the camera until the gateway ends; the next images are from there."""
        view, status = find(name), 400
        try:
            X_world_left = parse_mount_pose(pose)
            status = 409
            view.place(X_world_left)
        except CameraError as error:
            raise RestError(status, str(error)) from None
        return text_of(view)

    return routes


def _camera_name(names: Sequence[str]) -> Any:
    """Return the parameter of a path that names a camera."""
    return Path(
        description="Name of the camera, or number of its pipeline",
        json_schema_extra={"enum": [*names, *map(str, range(len(names)))]},
        openapi_examples=example(names[0]),
    )


def _number_of(name: str, names: Sequence[str]) -> int:
    """Return the pipeline number of a camera, by its name or number. Raises RestError."""
    for number, each in enumerate(names):
        if name in (each, str(number)):
            return number
    raise RestError(404, f"there is no camera {name[:80]!r}; there are {', '.join(names)}")


def _responses(media_type: str) -> Responses:
    return {**file_response(_IMAGE_DESCRIPTION, media_type), **error_responses(_ERRORS)}


def _find(services: Sequence[StereoService], name: str) -> tuple[int, StereoService]:
    """Return the pipeline number and the service of a camera, by its name or number. Raises RestError."""
    number = _number_of(name, [service.config.name for service in services])
    return number, services[number]


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


async def _rgbd_arrays(frame: FrameImages, config: StereoConfig, *, aligned: bool) -> dict[str, Any]:
    """Return the arrays of ``rgbd.npz``, of a frame of a camera with colour. Raises ImageError.

    * ``color`` (H, W, 3) uint8 RGB; ``depth_mm`` (h, w) uint16, millimetres along the optical axis, 0: invalid.
    * ``K_color``, ``K_depth`` (3, 3) float64: intrinsics.
    * ``X_world_color``, ``X_world_depth`` (4, 4) float64: poses of the optical frames, metres.
    * ``timestamp``: int64, nanoseconds since the epoch.

    ``aligned``: depth as seen by the colour camera, with its size, intrinsics and pose.
    """
    color = await frame.color_camera_image()
    X_world_color = frame.record.camera_capture.X_world_left @ config.X_left_color
    return {
        "color": color.sensor_image.image,
        "depth_mm": await frame.depth_mm(aligned=aligned),
        "K_color": config.color_intrinsics.matrix,
        "K_depth": frame.depth_intrinsics(aligned=aligned).matrix,
        "X_world_color": X_world_color,
        "X_world_depth": X_world_color if aligned else frame.record.depth_capture.X_world_left,
        "timestamp": np.int64(frame.record.camera_capture.timestamp),
    }


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
