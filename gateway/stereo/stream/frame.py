"""One frame: its images, meshes and serialised image sets, each made once for all clients."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Collection, Hashable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from gateway.runtime.shared_results import SharedResults
from gateway.runtime.tracing import span
from gateway.runtime.worker_pool import WorkerPool
from gateway.stereo.depth.matched_depth import matched_depth
from gateway.stereo.depth.rendered_depth import ImagePair
from gateway.stereo.device.stream_settings import StreamSettings
from gateway.stereo.imaging.color_images import expose_color_camera
from gateway.stereo.imaging.raw_images import raw_image
from gateway.stereo.imaging.rendered_images import (
    COLOR,
    GREY,
    Capture,
    ColorImage,
    ImageRequest,
    Imaging,
    MeteredExposure,
)
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
from scenegate.camera.image_interface_pb2 import ImageSet

T = TypeVar("T")
_ResultKey = tuple[str, *tuple[Hashable, ...]]
"""Name of a result of a frame, and the values that distinguish it from results of the same name."""

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

    @property
    def number(self) -> int:
        """Number of the frame since start, from 1."""
        return self.camera_capture.frame_number


class FrameImages:
    """Images of one frame, each made in a worker thread when first requested."""

    def __init__(
        self, record: FrameRecord, workers: WorkerPool, kinds: Collection[SetKind], generation: int = 0
    ) -> None:
        """
        Args:
            record: inputs of the frame.
            workers: threads for rendering, exposure, depth and serialisation.
            kinds: kinds of set that clients stream, so that one rendering serves grey and colour images of one camera.
            generation: generation of the hub (``ImageSetHub.generation``) at capture.
        """
        self.record = record
        self.generation = generation
        self.left_metered: MeteredExposure | None = None
        """Exposure of the left image; None until a set with this image is serialised."""
        self._workers = workers
        self._imaging, self._settings = record.imaging, record.settings
        self._camera_capture, self._depth_capture = record.camera_capture, record.depth_capture
        self._config = config = record.imaging.config
        self._measures_streamed_images = (
            config.measures_images
            and self._camera_capture.timestamp == self._depth_capture.timestamp
            and self._settings.averaged_images == 1
        )
        """True if depth is measured in the left and right images themselves."""
        grey = [GREY] if self._measures_streamed_images and any(kind.has_depth for kind in kinds) else []
        color = [COLOR] if config.color_camera is None and any(kind.color_camera for kind in kinds) else []
        self._colors_to_render = {
            NoiseStream.LEFT: frozenset([*grey, *color, *[kind.color for kind in kinds if kind.needs_left]]),
            NoiseStream.RIGHT: frozenset([*grey, *[kind.color for kind in kinds if kind.right]]),
        }
        """Images to make from one rendering of each camera: ``ImageRequest.colors``."""
        self._results: SharedResults[_ResultKey, Any] = SharedResults(_MAX_RESULTS)

    def serialised(self, kind: SetKind) -> Awaitable[bytes]:
        """Return the serialised ``ImageSet`` of a kind."""
        return self._results.get(("set", kind), partial(self._serialise, kind))

    def depth_images(self) -> Awaitable[DepthImages]:
        """Return the disparity, error and confidence images."""
        return self._results.get(("depth",), self._measure_depth)

    def metered(self, capture: Capture) -> Awaitable[MeteredExposure]:
        """Return the exposure of the images of a capture."""
        return self._results.get(("metered", capture.timestamp, capture.gpio), partial(self._meter, capture))

    async def image(self, stream: NoiseStream, color: bool) -> SensorImage:
        """Return the left or right image in colour or grey."""
        colors = self._colors_to_render[stream]
        if color not in colors:  # requested by a client that subscribed after the capture
            colors = frozenset((color,))
        make = partial(self._expose, self._camera_capture, stream, colors)
        images: dict[bool, SensorImage] = await self._results.get(("images", stream, colors), make)
        return images[color]

    async def color_camera_image(self) -> ColorImage:
        """Return the image of the colour camera; without a colour camera, the left image in colour."""
        color_camera = self._config.color_camera
        if color_camera is None:
            image, metered = await self.image(NoiseStream.LEFT, COLOR), await self.metered(self._camera_capture)
            return ColorImage(image, metered.exposure)
        arguments = (self._imaging, color_camera, self._camera_capture, self._settings)
        make = partial(self._workers.run, expose_color_camera, *arguments)
        color_image: ColorImage = await self._results.get(("color camera",), make)
        return color_image

    def depth_mm(self, *, aligned: bool) -> Awaitable[NDArray[np.uint16]]:
        """Return depth in millimetres, (H, W) uint16, 0: invalid.

        Args:
            aligned: as seen by the colour camera, if there is one.
        """
        return self._results.get(("depth_mm", aligned), partial(self._depth_mm, aligned))

    def depth_intrinsics(self, *, aligned: bool) -> Intrinsics:
        """Return the intrinsics of ``depth_mm``."""
        if aligned and self._config.color_camera is not None:
            return self._config.color_intrinsics
        return self._config.model.intrinsics(self._settings.quality.divisor)

    async def _depth_mm(self, aligned: bool) -> NDArray[np.uint16]:
        images, config, divisor = await self.depth_images(), self._config, self._settings.quality.divisor
        factor = config.model.focal_times_baseline(divisor)
        depth = await self._workers.run(millimetres_from_disparity, images.disparity, factor)
        if not aligned or config.color_camera is None:
            return depth
        return await self._workers.run(align_depth, depth, config.model.intrinsics(divisor), config.color_camera)

    async def raw_image(self, *, right: bool) -> SensorImage:
        """Return the grey image of one camera before rectification."""
        exposure = (await self.metered(self._camera_capture)).exposure
        return await self._workers.run(raw_image, self._imaging, self._camera_capture, exposure, right)

    async def _serialise(self, kind: SetKind) -> bytes:
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
            fields.append((ImageSet.MESH_FIELD_NUMBER, self._mesh_message(kind.mesh, kind.color)))
        values = await _gather([value for _, value in fields])
        capture = self._depth_capture if kind.has_depth else self._camera_capture
        chunks: list[Chunk] = [messages.timestamp_field(capture.timestamp)]
        for (number, _), value in zip(fields, values, strict=True):
            chunks += wire.field(number, value)
        if not fields:
            return wire.join(chunks)
        with span("serialise"):
            if wire.size(chunks) < wire.MIN_WITHOUT_GIL:
                return wire.join(chunks)
            return await self._workers.run(wire.join, chunks)

    async def _image_message(self, stream: NoiseStream, color: bool) -> list[Chunk]:
        """Return the left or right image as a message, and set ``left_metered`` if it is the left one."""
        image = await self.image(stream, color)
        metered = await self.metered(self._camera_capture)
        if stream is NoiseStream.LEFT:
            self.left_metered = replace(metered, brightness=image.brightness)
        metadata = self._metadata(self._camera_capture, metered, image.brightness)
        return messages.image(image.image, self._config.model.intrinsics(), metadata)

    async def _depth_message(self, name: Literal["disparity", "error", "confidence"], kind: SetKind) -> list[Chunk]:
        capture, config = self._depth_capture, self._config
        images, metered, brightness = await asyncio.gather(
            self.depth_images(), self.metered(capture), self._depth_brightness(kind)
        )
        pixels: NDArray[np.uint8] | NDArray[np.uint16] = getattr(images, name)
        if name == "disparity" and images.error_scale < DISPARITY_SCALE:
            # The message has one scale for disparity and error.
            pixels = pixels * np.uint16(DISPARITY_SCALE / images.error_scale)
        intrinsics = config.model.intrinsics(self._settings.quality.divisor)
        image = messages.image(pixels, intrinsics, self._metadata(capture, metered, brightness))
        if name != "disparity":
            return image
        return messages.disparity(image, capture.timestamp, config.model.baseline, images.error_scale)

    async def _color_camera_message(self) -> list[Chunk]:
        color = await self.color_camera_image()
        image, metered = color.sensor_image, MeteredExposure(color.exposure, color.sensor_image.brightness)
        metadata = self._metadata(self._camera_capture, metered, image.brightness)
        return messages.image(image.image, self._config.color_intrinsics, metadata)

    async def _depth_mm_message(self, kind: SetKind) -> list[Chunk]:
        pixels = await self.depth_mm(aligned=kind.aligned)
        metered, brightness = await self.metered(self._depth_capture), await self._depth_brightness(kind)
        intrinsics = self.depth_intrinsics(aligned=kind.aligned)
        return messages.image(pixels, intrinsics, self._metadata(self._depth_capture, metered, brightness))

    async def _depth_brightness(self, kind: SetKind) -> float:
        """Return the mean brightness of the left image of the depth exposure."""
        colors = self._colors_to_render[NoiseStream.LEFT]
        if colors and self._depth_capture.timestamp == self._camera_capture.timestamp:
            color = kind.color if kind.left else (GREY if GREY in colors else COLOR)
            try:
                return (await self.image(NoiseStream.LEFT, color)).brightness
            except ImageError:  # a broken texture prevents images, but not depth in every mode
                return 0.0
        if self._config.measures_images:
            return (await self._depth_image(self._depth_capture, NoiseStream.LEFT_DEPTH)).brightness
        return (await self.metered(self._depth_capture)).brightness

    def _mesh_message(self, options: MeshOptions, color: bool) -> Awaitable[list[Chunk]]:
        key = "mesh", options, color and options.textured
        return self._results.get(key, partial(self._mesh, options, color))

    async def _mesh(self, options: MeshOptions, color: bool) -> list[Chunk]:
        left = (await self.image(NoiseStream.LEFT, color)).image if options.textured else None
        images = await self.depth_images()
        ply = await self._workers.run(self._imaging.mesh, images, self._settings.quality.divisor, options, left)
        return messages.mesh(ply, self._depth_capture.timestamp)

    def _metadata(self, capture: Capture, metered: MeteredExposure, brightness: float) -> ImageMetadata:
        return ImageMetadata(
            capture.timestamp,
            metered.exposure,
            noise=metered.exposure.noise_sigma(128.0) * self._config.noise_factor,
            brightness=brightness,
            gpio=capture.gpio,
            out1_reduction=metered.out1_reduction,
        )

    async def _meter(self, capture: Capture) -> MeteredExposure:
        with span("meter"):
            return await self._workers.run(self._imaging.meter, capture, self._settings)

    async def _expose(
        self, capture: Capture, stream: NoiseStream, colors: frozenset[bool], averaged_images: int = 1
    ) -> dict[bool, SensorImage]:
        exposure = (await self.metered(capture)).exposure
        request = ImageRequest(exposure, stream, colors, averaged_images)
        with span("expose", {"stereo.image": stream.name.lower()}):
            return await self._workers.run(self._imaging.expose, capture, request)

    async def _measure_depth(self) -> DepthImages:
        """Return depth images by matching, or from rendered depth."""
        with span("depth"):
            capture, config, settings, run = self._depth_capture, self._config, self._settings, self._workers.run
            pair = None
            if config.measures_images:
                pair = await self._image_pair(capture, NoiseStream.LEFT_DEPTH, NoiseStream.RIGHT_DEPTH)
            if pair is not None and config.depth_mode == "matched":
                dark_pair, dark_capture = None, replace(capture, gpio=settings.gpio(depth=False))
                if settings.double_shot and capture.has_projection(config) and not dark_capture.out1_high:
                    streams = NoiseStream.LEFT_SECOND, NoiseStream.RIGHT_SECOND
                    dark_pair = await self._image_pair(dark_capture, *streams)
                return await run(matched_depth, config, pair, settings, dark_pair)
            render = self._imaging.render_lit if config.models_errors else self._imaging.render
            offsets, divisor = (0.0, config.model.baseline), settings.quality.divisor
            left, right = await _gather([run(render, capture, offset, divisor, Output.DEPTH) for offset in offsets])
            return await run(self._imaging.measure, left, right, settings, pair)

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
            return await self.image(NoiseStream.RIGHT if stream.is_right else NoiseStream.LEFT, color=GREY)
        make = partial(self._expose, capture, stream, frozenset((GREY,)), self._settings.averaged_images)
        images: dict[bool, SensorImage] = await self._results.get(("depth images", stream), make)
        return images[GREY]


async def _gather(awaitables: list[Awaitable[T]]) -> list[T]:
    """Return all results. If any fails, wait until all have ended, then raise the first failure."""
    results = await asyncio.gather(*awaitables, return_exceptions=True)
    for result in results:
        if isinstance(result, BaseException):
            raise result
    return results  # type: ignore[return-value]  # no exceptions are left
