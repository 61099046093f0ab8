"""Work of the worker threads for a frame: render, expose, measure, build meshes. Independent of the event loop."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gateway.stereo import depth
from gateway.stereo.auto_exposure import DIVISOR, ExposureMemory, choose_exposure
from gateway.stereo.config import StereoConfig
from gateway.stereo.settings import StreamSettings
from gateway.stereo.wire import Chunk
from renderers.drawlist import DrawList, ImageError
from renderers.interface import Frame, Look, Output, Renderer
from renderers.stereo.errors import DepthImages
from renderers.stereo.exposure import Exposure, brightness_of
from renderers.stereo.mesh import MeshOptions, disparity_mesh
from renderers.stereo.noise import NoiseStream, frame_key
from renderers.stereo.projector import projected_dots
from renderers.stereo.sensor import SensorImage, sensor_image


@dataclass(frozen=True, slots=True)
class Capture:
    """Scene, camera pose and outputs at one instant."""

    timestamp: int
    """Nanoseconds."""
    scene: DrawList
    revision: int
    """Revision of the scene."""
    X_world_left: NDArray[np.float64]
    """(4, 4) float64: pose of the left optical frame."""
    lines: int
    """GPIO values, a bit per line; Out1 is bit 0."""
    frame_number: int = 0

    def projected(self, config: StereoConfig) -> bool:
        """Return True if the projector, which is connected to Out1, is on."""
        return config.projector and bool(self.lines & 1)


@dataclass(frozen=True, slots=True)
class ImageRequest:
    """Images to make of one camera, from one rendering."""

    exposure: Exposure
    stream: NoiseStream
    """Camera and random numbers."""
    divisor: int
    """Full resolution divided by that of the image."""
    colors: frozenset[bool]
    """True: an image in colour, False: one in grey."""
    averaged: int = 1
    """Number of images that are averaged, which reduces the noise."""


@dataclass(frozen=True, slots=True)
class MeteredExposure:
    """Result of automatic exposure."""

    exposure: Exposure
    brightness: float
    """Mean of the exposed image, 0 to 1."""
    out1_reduction: float = 0.0
    """See ``auto_exposure``."""


@dataclass(frozen=True, slots=True, eq=False)
class Imaging:
    """Source of images and depth: the rendered scene."""

    config: StereoConfig
    renderer: Renderer
    memory: ExposureMemory = field(default_factory=ExposureMemory)
    """State of automatic exposure."""

    def render(self, capture: Capture, offset: float, divisor: int, outputs: Output) -> Frame:
        """Render the view ``offset`` metres to the right of the left camera. The caller closes the frame."""
        c = self.config
        camera = c.model.camera(capture.X_world_left, offset=offset, divisor=divisor, near=c.near, far=c.far)
        return self.renderer.render(capture.scene, camera, outputs, Look(c.look, c.background))

    def meter(self, capture: Capture, settings: StreamSettings) -> MeteredExposure:
        """Return the exposure of a capture's images, and the brightness of the left one.

        If a texture is broken, the exposure is the manual one.
        """
        lit = replace(capture, lines=capture.lines | 1)
        outputs = Output.COLOR | (Output.DEPTH if lit.projected(self.config) else Output(0))
        try:
            frame = self.render(capture, 0.0, DIVISOR, outputs)
        except ImageError:
            return MeteredExposure(settings.manual, 0.0)
        with frame:
            dots = self._dots(frame, capture, 0.0, DIVISOR)
            assert frame.color is not None
            light, channels = self.config.dot_light, settings.manual.channels
            dark = brightness_of(frame.color, None, light, channels)
            bright = brightness_of(frame.color, dots, light, channels) if dots is not None else dark
        out1 = bool(capture.lines & 1)
        exposure, reduction = choose_exposure(dark, bright, out1=out1, settings=settings, memory=self.memory)
        brightness = exposure.response((bright if out1 else dark) * exposure.factor).mean()
        return MeteredExposure(exposure, float(brightness), reduction)

    def expose(self, capture: Capture, request: ImageRequest) -> dict[bool, SensorImage]:
        """Return images of one camera; True: in colour, False: in grey."""
        c = self.config
        offset = c.model.baseline if request.stream.right else 0.0
        key = frame_key(c.seed, capture.frame_number, request.stream)
        noise = c.noise_factor / request.averaged**0.5
        outputs = Output.COLOR | (Output.DEPTH if capture.projected(c) else Output(0))
        with self.render(capture, offset, request.divisor, outputs) as frame:
            dots = self._dots(frame, capture, offset, request.divisor)
            assert frame.color is not None
            return {
                color: sensor_image(
                    frame.color, request.exposure, key, color=color, dots=dots, dot_light=c.dot_light, noise=noise
                )
                for color in request.colors
            }

    def measure(self, left: Frame, right: Frame, settings: StreamSettings, number: int) -> DepthImages:
        """Return depth with modelled errors from rendered depth; closes the frames."""
        with left, right:
            assert left.depth is not None
            assert right.depth is not None
            return depth.ground_truth_depth(self.config, left.depth, right.depth, settings, number)

    def match(
        self,
        left: SensorImage,
        right: SensorImage,
        exposure: Exposure,
        settings: StreamSettings,
        second: tuple[SensorImage, SensorImage, Exposure] | None = None,
    ) -> DepthImages:
        """Return depth by matching the images; ``second`` is a pair that fills holes of the first."""
        return depth.matched_depth(self.config, left, right, exposure, settings, second)

    def mesh(
        self, images: DepthImages, divisor: int, options: MeshOptions, left: NDArray[np.uint8] | None
    ) -> tuple[Chunk, ...]:
        """Return the parts of a PLY file."""
        model = self.config.model
        return disparity_mesh(images.disparity, model.intrinsics(divisor), model.baseline, options, left)

    def _dots(self, frame: Frame, capture: Capture, offset: float, divisor: int) -> NDArray[np.uint8] | None:
        """Return the projector's light on a frame with depth; None without."""
        if frame.depth is None:
            return None
        model = self.config.model
        k, projector = model.intrinsics(divisor), model.baseline / 2
        with self.render(capture, projector, divisor, Output.DEPTH) as seen:
            assert seen.depth is not None
            return projected_dots(frame.depth, k.focal_length, k.cx, k.cy, offset - projector, seen.depth)
