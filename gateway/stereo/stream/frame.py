"""One frame: its images, meshes and serialised image sets, each made once for all clients."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Coroutine, Hashable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gateway.runtime.tracing import span
from gateway.runtime.worker_pool import WorkerPool
from gateway.stereo.depth.matched_depth import matched_depth
from gateway.stereo.depth.rendered_depth import ImagePair
from gateway.stereo.device.stream_settings import StreamSettings
from gateway.stereo.imaging.color_images import expose_color_camera
from gateway.stereo.imaging.raw_images import raw_image
from gateway.stereo.imaging.rendered_images import Capture, ColorImage, ImageRequest, Imaging, MeteredExposure
from gateway.stereo.stream import image_messages as messages
from gateway.stereo.stream import image_wire as wire
from gateway.stereo.stream.image_messages import ImageMetadata
from gateway.stereo.stream.image_wire import Chunk
from gateway.stereo.stream.set_kind import SetKind
from renderers.drawlist import ImageError
from renderers.interface import Output
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.depth.metric_depth import align_depth, millimetres_from_disparity
from renderers.stereo.mesh.disparity_mesh import MeshOptions
from renderers.stereo.model import DISPARITY_SCALE, Intrinsics
from renderers.stereo.sensor.noise import NoiseStream
from renderers.stereo.sensor.sensor_image import SensorImage

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class FrameRecord:
    """Inputs of a past frame, from which it can be rendered again."""

    number: int
    settings: StreamSettings
    camera_capture: Capture
    depth_capture: Capture
    imaging: Imaging


class Frame:
    """Images of one frame, each made in a worker thread when first requested."""

    def __init__(
        self,
        imaging: Imaging,
        workers: WorkerPool,
        settings: StreamSettings,
        camera_capture: Capture,
        depth_capture: Capture,
        kinds: Collection[SetKind],
        generation: int = 0,
    ) -> None:
        """
        Args:
            imaging: source of the images.
            workers: threads for rendering, exposure, depth and serialisation.
            settings: parameters of the frame.
            camera_capture: scene and pose of the left and right images.
            depth_capture: scene and pose of the depth images, 40 ms later if they are exposed with other outputs.
            kinds: kinds of set that clients stream, so that one rendering serves grey and colour images of one camera.
            generation: generation of the hub (``ImageSetHub.generation``) at capture.
        """
        self.number = camera_capture.frame_number
        self.generation = generation
        self.settings = settings
        self.camera_capture = camera_capture
        self.depth_capture = depth_capture
        self.left_metered: MeteredExposure | None = None
        """Exposure of the left image; None until the image is made."""
        self._imaging = imaging
        self._workers = workers
        self._measures_streamed_images = (
            imaging.config.measures_images
            and camera_capture.timestamp == depth_capture.timestamp
            and settings.averaged_images == 1
        )
        """True if depth is measured in the left and right images themselves."""
        grey = [False] if self._measures_streamed_images and any(kind.has_depth for kind in kinds) else []
        color = [True] if imaging.config.color_camera is None and any(kind.color_camera for kind in kinds) else []
        self._colors = {
            NoiseStream.LEFT: frozenset([*grey, *color, *(kind.color for kind in kinds if kind.needs_left)]),
            NoiseStream.RIGHT: frozenset([*grey, *(kind.color for kind in kinds if kind.right)]),
        }
        """Images to make of each camera: True for colour, False for grey."""
        self._tasks: dict[Hashable, asyncio.Task[Any]] = {}
        """Tasks of ``_make_once`` by key."""

    async def serialised(self, kind: SetKind) -> bytes:
        """Return the serialised ``ImageSet`` of a kind."""
        return await self._make_once(kind, lambda: self._serialise(kind))

    async def depth_images(self) -> DepthImages:
        """Return the disparity, error and confidence images."""
        is_matched = self._imaging.config.depth_mode == "matched"
        make = self._depth_from_matching if is_matched else self._depth_from_rendering
        return await self._make_once("depth", lambda: self._depth(make))

    async def metered(self, capture: Capture) -> MeteredExposure:
        """Return the exposure of the images of a capture."""
        return await self._make_once(("metered", capture.timestamp, capture.gpio), lambda: self._meter(capture))

    async def image(self, stream: NoiseStream, color: bool) -> SensorImage:
        """Return the left or right image in colour or grey."""
        colors = self._colors[stream]
        if color not in colors:  # requested by a client that subscribed after the capture
            colors = frozenset((color,))
        images = await self._make_once((stream, colors), lambda: self._expose(self.camera_capture, stream, colors))
        return images[color]

    async def color_camera_image(self) -> ColorImage:
        """Return the image of the colour camera; without a colour camera, the left image in colour."""
        color_camera = self._imaging.config.color_camera
        if color_camera is None:
            image, metered = await self.image(NoiseStream.LEFT, True), await self.metered(self.camera_capture)
            return ColorImage(image, metered.exposure)
        arguments = (self._imaging, color_camera, self.camera_capture, self.settings)
        return await self._make_once("color camera", lambda: self._workers.run(expose_color_camera, *arguments))

    async def depth_mm(self, *, aligned: bool) -> NDArray[np.uint16]:
        """Return depth in millimetres, (H, W) uint16, 0: invalid.

        Args:
            aligned: as seen by the colour camera, if there is one.
        """
        return await self._make_once(("depth_mm", aligned), lambda: self._depth_mm(aligned))

    def depth_intrinsics(self, *, aligned: bool) -> Intrinsics:
        """Return the intrinsics of ``depth_mm``."""
        config = self._imaging.config
        if aligned and config.color_camera is not None:
            return config.color_intrinsics
        return config.model.intrinsics(self.settings.quality.divisor)

    async def _depth_mm(self, aligned: bool) -> NDArray[np.uint16]:
        images, config, divisor = await self.depth_images(), self._imaging.config, self.settings.quality.divisor
        factor = config.model.focal_times_baseline(divisor)
        depth = await self._workers.run(millimetres_from_disparity, images.disparity, factor)
        if not aligned or config.color_camera is None:
            return depth
        return await self._workers.run(align_depth, depth, config.model.intrinsics(divisor), config.color_camera)

    async def raw_image(self, *, right: bool) -> SensorImage:
        """Return the grey image of one camera before rectification."""
        exposure = (await self.metered(self.camera_capture)).exposure
        return await self._workers.run(raw_image, self._imaging, self.camera_capture, exposure, right)

    def cancel(self) -> None:
        """Cancel all unfinished tasks."""
        for task in self._tasks.values():
            task.cancel()

    async def _serialise(self, kind: SetKind) -> bytes:
        # Field numbers of the message ImageSet.
        fields: list[tuple[int, Coroutine[Any, Any, list[Chunk]]]] = []
        if kind.left:
            fields.append((2, self._image_message(NoiseStream.LEFT, kind.color)))
        if kind.right:
            fields.append((3, self._image_message(NoiseStream.RIGHT, kind.color)))
        if kind.disparity:
            fields.append((4, self._disparity_message(kind)))
        if kind.error:
            fields.append((5, self._depth_message("error", kind)))
        if kind.confidence:
            fields.append((6, self._depth_message("confidence", kind)))
        if kind.color_camera:
            fields.append((1001, self._color_camera_message()))
        if kind.depth_mm:
            fields.append((1002, self._depth_mm_message(kind)))
        if kind.mesh is not None:
            fields.append((7, self._mesh_message(kind.mesh, kind.color)))
        values = await _gather([value for _, value in fields])
        capture = self.depth_capture if kind.has_depth else self.camera_capture
        chunks: list[Chunk] = [messages.timestamp_field(capture.timestamp)]
        for (number, _), value in zip(fields, values, strict=True):
            chunks += wire.field(number, value)
        if not fields:
            return wire.join(chunks)
        with span("serialise"):
            return await self._workers.run(wire.join, chunks)

    async def _image_message(self, stream: NoiseStream, color: bool) -> list[Chunk]:
        image = await self.image(stream, color)
        metered = await self.metered(self.camera_capture)
        if stream is NoiseStream.LEFT:
            self.left_metered = replace(metered, brightness=image.brightness)
        metadata = self._metadata(self.camera_capture, metered, image.brightness)
        return messages.image(image.image, self._imaging.config.model.intrinsics(), metadata)

    async def _disparity_message(self, kind: SetKind) -> list[Chunk]:
        image = await self._depth_message("disparity", kind)
        scale, baseline = (await self.depth_images()).error_scale, self._imaging.config.model.baseline
        return messages.disparity(image, self.depth_capture.timestamp, baseline, scale)

    async def _depth_message(self, name: str, kind: SetKind) -> list[Chunk]:
        images, metered, brightness = await asyncio.gather(
            self.depth_images(), self.metered(self.depth_capture), self._depth_brightness(kind)
        )
        pixels: NDArray[np.uint8] | NDArray[np.uint16] = getattr(images, name)
        if name == "disparity" and images.error_scale < DISPARITY_SCALE:
            # The message has one scale for disparity and error.
            pixels = pixels * np.uint16(DISPARITY_SCALE / images.error_scale)
        k = self._imaging.config.model.intrinsics(self.settings.quality.divisor)
        return messages.image(pixels, k, self._metadata(self.depth_capture, metered, brightness))

    async def _color_camera_message(self) -> list[Chunk]:
        config = self._imaging.config
        color = await self.color_camera_image()
        image, metered = color.sensor_image, MeteredExposure(color.exposure, color.sensor_image.brightness)
        metadata = self._metadata(self.camera_capture, metered, image.brightness)
        return messages.image(image.image, config.color_intrinsics, metadata)

    async def _depth_mm_message(self, kind: SetKind) -> list[Chunk]:
        pixels = await self.depth_mm(aligned=kind.aligned)
        metered, brightness = await self.metered(self.depth_capture), await self._depth_brightness(kind)
        k = self.depth_intrinsics(aligned=kind.aligned)
        return messages.image(pixels, k, self._metadata(self.depth_capture, metered, brightness))

    async def _depth_brightness(self, kind: SetKind) -> float:
        """Return the mean brightness of the left image of the depth exposure."""
        colors = self._colors[NoiseStream.LEFT]
        if colors and self.depth_capture.timestamp == self.camera_capture.timestamp:
            try:
                return (await self.image(NoiseStream.LEFT, kind.color if kind.left else min(colors))).brightness
            except ImageError:  # a broken texture prevents images, but not depth in every mode
                return 0.0
        if self._imaging.config.measures_images:
            return (await self._depth_image(self.depth_capture, NoiseStream.LEFT_DEPTH)).brightness
        return (await self.metered(self.depth_capture)).brightness

    async def _mesh_message(self, options: MeshOptions, color: bool) -> list[Chunk]:
        return await self._make_once(("mesh", options, color and options.textured), lambda: self._mesh(options, color))

    async def _mesh(self, options: MeshOptions, color: bool) -> list[Chunk]:
        left = (await self.image(NoiseStream.LEFT, color)).image if options.textured else None
        images = await self.depth_images()
        ply = await self._workers.run(self._imaging.mesh, images, self.settings.quality.divisor, options, left)
        return messages.mesh(ply, self.depth_capture.timestamp)

    def _metadata(self, capture: Capture, metered: MeteredExposure, brightness: float) -> ImageMetadata:
        return ImageMetadata(
            capture.timestamp,
            metered.exposure,
            noise=metered.exposure.noise_sigma(128.0) * self._imaging.config.noise_factor,
            brightness=brightness,
            gpio=capture.gpio,
            out1_reduction=metered.out1_reduction,
        )

    async def _meter(self, capture: Capture) -> MeteredExposure:
        with span("meter"):
            return await self._workers.run(self._imaging.meter, capture, self.settings)

    async def _expose(
        self, capture: Capture, stream: NoiseStream, colors: frozenset[bool], averaged_images: int = 1
    ) -> dict[bool, SensorImage]:
        exposure = (await self.metered(capture)).exposure
        request = ImageRequest(exposure, stream, colors, averaged_images)
        with span("expose", {"stereo.image": stream.name.lower()}):
            return await self._workers.run(self._imaging.expose, capture, request)

    async def _depth(self, make: Callable[[], Coroutine[Any, Any, DepthImages]]) -> DepthImages:
        with span("depth"):
            return await make()

    async def _depth_from_rendering(self) -> DepthImages:
        """Return depth images from rendered depth."""
        capture, config = self.depth_capture, self._imaging.config
        pair = None
        if config.models_errors:
            pair = await self._image_pair(capture, NoiseStream.LEFT_DEPTH, NoiseStream.RIGHT_DEPTH)
        render = self._imaging.render_lit if config.models_errors else self._imaging.render
        left, right = await _gather(
            [
                self._workers.run(render, capture, offset, self.settings.quality.divisor, Output.DEPTH)
                for offset in (0.0, config.model.baseline)
            ]
        )
        return await self._workers.run(self._imaging.measure, left, right, self.settings, pair)

    async def _depth_from_matching(self) -> DepthImages:
        """Return depth images by matching."""
        settings, capture, config = self.settings, self.depth_capture, self._imaging.config
        pair = await self._image_pair(capture, NoiseStream.LEFT_DEPTH, NoiseStream.RIGHT_DEPTH)
        dark_pair = None
        dark_capture = replace(capture, gpio=settings.gpio(depth=False))
        if settings.double_shot and capture.has_projection(config) and not dark_capture.out1_high:
            dark_pair = await self._image_pair(dark_capture, NoiseStream.LEFT_SECOND, NoiseStream.RIGHT_SECOND)
        return await self._workers.run(matched_depth, config, pair, settings, dark_pair)

    async def _image_pair(self, capture: Capture, *streams: NoiseStream) -> ImagePair:
        """Return the grey images of two streams, left and right, from which depth is measured."""
        exposure = (await self.metered(capture)).exposure
        left, right = await _gather([self._depth_image(capture, stream) for stream in streams])
        return ImagePair(left, right, exposure, self._imaging.image_kind(capture))

    async def _depth_image(self, capture: Capture, stream: NoiseStream) -> SensorImage:
        """Return a grey image from which depth is measured: the streamed one unless depth needs another.

        Depth needs another image if its timestamp differs, or if several images are averaged.
        """
        if self._measures_streamed_images:
            return await self.image(NoiseStream.RIGHT if stream.is_right else NoiseStream.LEFT, color=False)
        averaged_images, grey = self.settings.averaged_images, frozenset((False,))
        return (await self._make_once(stream, lambda: self._expose(capture, stream, grey, averaged_images)))[False]

    async def _make_once(self, key: Hashable, make: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Return the result of ``make``, called once per key. Cancelling one caller does not affect the others."""
        task = self._tasks.get(key)
        if task is None:
            task = self._tasks[key] = asyncio.get_running_loop().create_task(make())
            task.add_done_callback(_mark_exception_retrieved)
        result: T = await asyncio.shield(task)
        return result


def _mark_exception_retrieved(task: asyncio.Task[Any]) -> None:
    """Suppress asyncio's warning about an exception that no caller has waited for."""
    if not task.cancelled():
        task.exception()


async def _gather(coroutines: list[Coroutine[Any, Any, T]]) -> list[T]:
    """Return all results. If any coroutine fails, wait until all have ended, then raise the first failure."""
    results = await asyncio.gather(*coroutines, return_exceptions=True)
    for result in results:
        if isinstance(result, BaseException):
            raise result
    return results  # type: ignore[return-value]  # no exceptions are left
