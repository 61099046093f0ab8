"""One frame: its images, meshes and serialised image sets, each made once for all clients."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection, Coroutine, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from typing import Any, Concatenate, Final, Literal, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.stream_settings import StreamSettings
from gateway.adapters.stereo.imaging.color_images import expose_color_camera
from gateway.adapters.stereo.imaging.rendered_images import (
    COLOR,
    GREY,
    ColorImage,
    ImageRequest,
    Imaging,
    MeteredExposure,
)
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.adapters.stereo.stream import image_messages as messages
from gateway.adapters.stereo.stream.image_messages import Chunk, ImageMetadata
from gateway.adapters.stereo.stream.set_kind import SetKind
from gateway.runtime.logs import tracing
from gateway.runtime.workers.worker_pool import WorkerPool
from renderers.drawlist import ImageError
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.depth.matching import ImagePair
from renderers.stereo.depth.metric_depth import align_depth, millimetres_from_disparity
from renderers.stereo.mesh.disparity_mesh import MeshOptions, disparity_mesh
from renderers.stereo.model import Intrinsics
from renderers.stereo.sensor.camera_image import NoiseStream, SensorImage
from scenegate.camera.image_interface_pb2 import ImageSet

P = ParamSpec("P")
T = TypeVar("T")
_MAX_RESULTS: Final = 64
"""Maximum number of images, messages and sets of a frame: 16 kinds of set (``max_kinds``) need fewer."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameRecord:
    """Inputs of a frame, from which it can be rendered again."""

    imaging: Imaging
    """Source of the images."""
    settings: StreamSettings
    camera_capture: Capture
    """Scene and pose of the left and right images."""
    depth_capture: Capture
    """Scene and pose of the depth images, 40 ms later if they are exposed with other outputs."""
    generation: int = 0
    """Generation of the hub (``ImageSetHub.generation``) at capture."""

    @property
    def number(self) -> int:
        """Number of the frame since start, from 1."""
        return self.camera_capture.frame_number


def once(
    method: Callable[Concatenate[FrameImages, P], Coroutine[Any, Any, T]],
) -> Callable[Concatenate[FrameImages, P], Awaitable[T]]:
    """Decorate a method: the first call with some arguments starts it, others join. After an error it starts again."""

    @wraps(method)
    def start_or_join(frame: FrameImages, /, *args: P.args, **kwargs: P.kwargs) -> Awaitable[T]:
        key = method.__name__, args, *kwargs.items()
        task = frame.results.get(key)
        has_failed = task is not None and task.done() and (task.cancelled() or task.exception() is not None)
        if task is None or has_failed:
            task = frame.results[key] = asyncio.get_running_loop().create_task(method(frame, *args, **kwargs))
            if len(frame.results) > _MAX_RESULTS:
                del frame.results[next(iter(frame.results))]
        return task

    return start_or_join


class FrameImages:
    """Images of one frame, each made in a worker thread when first requested.

    Cancelling a caller cancels what it waits for, too, and with it all others that wait for the same.
    """

    def __init__(self, record: FrameRecord, workers: WorkerPool, kinds: Collection[SetKind]) -> None:
        """``kinds``: those that clients stream, so that one rendering serves grey and colour images of one camera."""
        self.record = record
        self.left_metered: MeteredExposure | None = None
        """Exposure of the left image; None until a set with this image is serialised."""
        self.measuring = asyncio.Event()
        """Set when the images for depth are made, and depth is measured in them."""
        self._workers = workers
        self._imaging, self._settings = record.imaging, record.settings
        self._camera_capture, self._depth_capture = record.camera_capture, record.depth_capture
        self._config = config = record.imaging.config
        self._measures_streamed_images = (
            config.depth_mode == "matched"
            and self._camera_capture is self._depth_capture
            and self._settings.averaged_images == 1
        )
        """True if depth is measured in the left and right images themselves."""
        for_depth = [GREY] if self._measures_streamed_images and any(kind.has_depth for kind in kinds) else []
        for_color_camera = [COLOR] if config.color_camera is None and any(kind.color_camera for kind in kinds) else []
        for_left = [kind.color for kind in kinds if kind.needs_left]
        for_right = [kind.color for kind in kinds if kind.right]
        self._colors_to_render = {
            NoiseStream.LEFT: frozenset([*for_depth, *for_color_camera, *for_left]),
            NoiseStream.RIGHT: frozenset([*for_depth, *for_right]),
        }
        """Images to make from one rendering of each camera: ``ImageRequest.colors``."""
        self.results: dict[tuple[object, ...], asyncio.Task[Any]] = {}
        """Tasks of the methods with ``once``, by name and arguments."""

    @once
    async def serialised(self, kind: SetKind) -> bytes:
        """Return the serialised ``ImageSet`` of a kind."""
        fields: list[tuple[int, Awaitable[list[Chunk]]]] = []
        if kind.left:
            fields.append((ImageSet.LEFT_FIELD_NUMBER, self._image_message(NoiseStream.LEFT, kind.color)))
        if kind.right:
            fields.append((ImageSet.RIGHT_FIELD_NUMBER, self._image_message(NoiseStream.RIGHT, kind.color)))
        if kind.disparity:
            fields.append((ImageSet.DISPARITY_FIELD_NUMBER, self._depth_message("disparity", kind)))
        if kind.error:
            fields.append((ImageSet.DISPARITY_ERROR_FIELD_NUMBER, self._depth_message("error", kind)))
        if kind.confidence:
            fields.append((ImageSet.CONFIDENCE_FIELD_NUMBER, self._depth_message("confidence", kind)))
        if kind.color_camera:
            fields.append((ImageSet.COLOR_CAMERA_FIELD_NUMBER, self._color_camera_message()))
        if kind.depth_mm:
            fields.append((ImageSet.DEPTH_MM_FIELD_NUMBER, self._depth_mm_message(kind)))
        if kind.mesh is not None:
            color = kind.color and kind.mesh.textured
            fields.append((ImageSet.MESH_FIELD_NUMBER, self._mesh_message(kind.mesh, color)))
        contents = await _gather([content for _, content in fields])
        capture = self._depth_capture if kind.has_depth else self._camera_capture
        chunks: list[Chunk] = [messages.timestamp_field(capture.timestamp)]
        for (number, _), content in zip(fields, contents, strict=True):
            chunks += messages.field(number, content)
        with tracing.span("serialise"):
            if messages.byte_count(chunks) < messages.MIN_BYTES_WITHOUT_GIL:
                return b"".join(chunks)
            return await self._workers.run(messages.join, chunks)

    @once
    async def depth_images(self) -> DepthImages:
        """Return the disparity, error and confidence images, by matching, or exact from rendered depth."""
        capture, settings, config = self._depth_capture, self._settings, self._config
        with tracing.span("depth"):
            pair = dark_pair = None
            if config.depth_mode == "matched":
                pair = await self._image_pair(capture, NoiseStream.LEFT_DEPTH, NoiseStream.RIGHT_DEPTH)
            dark_capture = replace(capture, gpio=settings.camera_gpio)
            is_darker = capture.has_projection(config) and not dark_capture.out1_high
            if settings.double_shot and config.depth_mode == "matched" and is_darker:
                dark_pair = await self._image_pair(dark_capture, NoiseStream.LEFT_SECOND, NoiseStream.RIGHT_SECOND)
            self.measuring.set()
            return await self._workers.run(self._imaging.measure, capture, settings, pair, dark_pair)

    @once
    async def metered(self, capture: Capture) -> MeteredExposure:
        """Return the exposure of the images of a capture."""
        with tracing.span("meter"):
            return await self._workers.run(self._imaging.meter, capture, self._settings)

    async def image(self, stream: NoiseStream, color: bool) -> SensorImage:
        """Return the left or right image in colour or grey."""
        colors = self._colors_to_render[stream]
        if color not in colors:  # requested by a client that subscribed after the capture
            colors = frozenset((color,))
        return (await self._expose(self._camera_capture, stream, colors))[color]

    @once
    async def color_camera_image(self) -> ColorImage:
        """Return the image of the colour camera; without a colour camera, the left image in colour."""
        color_camera, capture = self._config.color_camera, self._camera_capture
        if color_camera is None:
            image = await self.image(NoiseStream.LEFT, COLOR)
            return ColorImage(image, (await self.metered(capture)).exposure)
        return await self._workers.run(expose_color_camera, self._imaging, color_camera, capture, self._settings)

    @once
    async def depth_mm(self, *, aligned: bool) -> NDArray[np.uint16]:
        """Return depth in millimetres, (H, W) uint16, 0: invalid; ``aligned``: as seen by the colour camera, if there
        is one."""
        images, config, divisor = await self.depth_images(), self._config, self._settings.quality.divisor
        factor = config.model.focal_times_baseline(divisor)
        depth = await self._workers.run(millimetres_from_disparity, images.disparity, factor)
        if not aligned or config.color_camera is None:
            return depth
        return await self._workers.run(align_depth, depth, config.model.intrinsics(divisor), config.color_camera)

    def depth_intrinsics(self, *, aligned: bool) -> Intrinsics:
        """Return the intrinsics of ``depth_mm``."""
        if aligned and self._config.color_camera is not None:
            return self._config.color_intrinsics
        return self._config.model.intrinsics(self._settings.quality.divisor)

    async def _image_message(self, stream: NoiseStream, color: bool) -> list[Chunk]:
        """Return the left or right image as a message, and set ``left_metered`` if it is the left one."""
        image = await self.image(stream, color)
        metered = replace(await self.metered(self._camera_capture), brightness=image.brightness)
        if stream is NoiseStream.LEFT:
            self.left_metered = metered
        return self._image_chunks(image.image, self._config.model.intrinsics(), self._camera_capture, metered)

    async def _depth_message(self, name: Literal["disparity", "error", "confidence"], kind: SetKind) -> list[Chunk]:
        capture, config = self._depth_capture, self._config
        images = await self.depth_images()
        pixels: NDArray[np.uint8] | NDArray[np.uint16] = getattr(images, name)
        intrinsics = config.model.intrinsics(self._settings.quality.divisor)
        image = self._image_chunks(pixels, intrinsics, capture, await self._depth_metered(kind))
        if name != "disparity":
            return image
        return messages.disparity(image, capture.timestamp, config.model.baseline)

    async def _color_camera_message(self) -> list[Chunk]:
        color, capture = await self.color_camera_image(), self._camera_capture
        metered = MeteredExposure(color.exposure, color.sensor_image.brightness)
        return self._image_chunks(color.sensor_image.image, self._config.color_intrinsics, capture, metered)

    async def _depth_mm_message(self, kind: SetKind) -> list[Chunk]:
        pixels = await self.depth_mm(aligned=kind.aligned)
        intrinsics, metered = self.depth_intrinsics(aligned=kind.aligned), await self._depth_metered(kind)
        return self._image_chunks(pixels, intrinsics, self._depth_capture, metered)

    async def _depth_metered(self, kind: SetKind) -> MeteredExposure:
        """Return the exposure of the depth images, with the mean brightness of the left image of that exposure."""
        colors, metered = self._colors_to_render[NoiseStream.LEFT], await self.metered(self._depth_capture)
        if colors and self._depth_capture is self._camera_capture:
            color = kind.color if kind.left else (GREY if GREY in colors else COLOR)
            try:
                return replace(metered, brightness=(await self.image(NoiseStream.LEFT, color)).brightness)
            except ImageError:  # a broken texture prevents images, but not depth in every mode
                return replace(metered, brightness=0.0)
        if self._config.depth_mode == "matched":  # the images have been made for depth
            image = await self._depth_image(self._depth_capture, NoiseStream.LEFT_DEPTH)
            return replace(metered, brightness=image.brightness)
        return metered

    @once
    async def _mesh_message(self, options: MeshOptions, color: bool) -> list[Chunk]:
        left = (await self.image(NoiseStream.LEFT, color)).image if options.textured else None
        images, model = await self.depth_images(), self._config.model
        k = model.intrinsics(self._settings.quality.divisor)
        ply = await self._workers.run(disparity_mesh, images.disparity, k, model.baseline, options, left)
        return messages.mesh(ply, self._depth_capture.timestamp)

    def _image_chunks(
        self,
        pixels: NDArray[np.uint8] | NDArray[np.uint16],
        intrinsics: Intrinsics,
        capture: Capture,
        metered: MeteredExposure,
    ) -> list[Chunk]:
        """Return an ``Image``; see ``messages.image``."""
        metadata = ImageMetadata(
            capture.timestamp,
            metered.exposure,
            noise=metered.exposure.mid_grey_noise * self._config.noise_factor,
            brightness=metered.brightness,
            gpio=capture.gpio,
            out1_reduction=metered.out1_reduction,
        )
        return messages.image(pixels, intrinsics, metadata)

    @once
    async def _expose(
        self, capture: Capture, stream: NoiseStream, colors: frozenset[bool], averaged_images: int = 1
    ) -> dict[bool, SensorImage]:
        metered = await self.metered(capture)
        request = ImageRequest(metered.exposure, stream, colors, averaged_images, metered.key_light)
        with tracing.span("expose", attributes={"stereo.image": stream.name.lower()}):
            return await self._workers.run(self._imaging.expose, capture, request)

    async def _image_pair(self, capture: Capture, left: NoiseStream, right: NoiseStream) -> ImagePair:
        """Return the grey images of two streams, from which depth is measured: the streamed ones unless depth needs
        others.

        Depth needs other images if its timestamp differs, or if several images are averaged.
        """
        if self._measures_streamed_images:
            images = await _gather([self.image(NoiseStream.LEFT, GREY), self.image(NoiseStream.RIGHT, GREY)])
        else:
            images = await _gather([self._depth_image(capture, left), self._depth_image(capture, right)])
        exposure = (await self.metered(capture)).exposure
        return ImagePair(images[0], images[1], exposure)

    async def _depth_image(self, capture: Capture, stream: NoiseStream) -> SensorImage:
        """Return a grey image from which depth is measured, and which no client gets."""
        colors, count = frozenset((GREY,)), self._settings.averaged_images
        return (await self._expose(capture, stream, colors, count))[GREY]


async def _gather(awaitables: Sequence[Awaitable[T]]) -> list[T]:
    """Return all results. If any fails, wait until all have ended, then raise the first failure."""
    results = await asyncio.gather(*awaitables, return_exceptions=True)
    for result in results:
        if isinstance(result, BaseException):
            raise result
    return results  # type: ignore[return-value]  # no exceptions are left
