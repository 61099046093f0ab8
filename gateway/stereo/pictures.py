"""What worker threads do for a frame: render, measure, build meshes. Nothing here knows the event loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.stereo.config import StereoConfig
from gateway.stereo.settings import StreamSettings
from gateway.stereo.wire import Chunk
from renderers.drawlist import DrawList, ImageError
from renderers.port import Frame, Look, Output, Renderer
from renderers.stereo.errors import ErrorModel, Measured, measure
from renderers.stereo.filters import Filters, apply_filters
from renderers.stereo.matching import match
from renderers.stereo.mesh import MeshOptions, disparity_mesh
from renderers.stereo.noise import Stream, frame_key
from renderers.stereo.projector import dots_on
from renderers.stereo.sensor import AutoExposure, Exposure, Taken, auto_exposure, brightness_of, take
from renderers.stereo.truth import DepthRange, true_disparity

METER_DIVISOR = 8
"""Automatic exposure measures a picture this much smaller than the camera's."""


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """The scene and the camera at one instant."""

    timestamp: int
    """Nanoseconds."""
    scene: DrawList
    revision: int
    """Of the scene."""
    X_world_left: NDArray[np.float64]
    """(4, 4) float64: pose of the left optical frame."""
    lines: int
    """GPIO values."""

    def projected(self, config: StereoConfig) -> bool:
        """Whether the projector's light is on: it hangs on Out1."""
        return config.projector and bool(self.lines & 1)


@dataclass(frozen=True, slots=True)
class Metered:
    """What automatic exposure decided."""

    exposure: Exposure
    brightness: float
    """Mean of the image it gives, 0 to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Studio:
    """What renders."""

    config: StereoConfig
    renderer: Renderer

    def render(self, shot: Shot, offset: float, divisor: int, outputs: Output) -> Frame:
        """The pictures of the camera at ``offset`` metres to the right of the left one; close the frame."""
        c = self.config
        camera = c.model.camera(shot.X_world_left, offset=offset, divisor=divisor, near=c.near, far=c.far)
        return self.renderer.render(shot.scene, camera, outputs, Look(c.look, c.background))

    def meter(self, shot: Shot, limits: AutoExposure | None, manual: Exposure) -> Metered:
        """The exposure that suits what the left camera sees, and the brightness that it gives.

        Args:
            limits: None: the manual exposure is kept.
            manual: also when a texture is broken; its gamma always counts.
        """
        outputs = Output.COLOR | (Output.DEPTH if shot.projected(self.config) else Output(0))
        try:
            frame = self.render(shot, 0.0, METER_DIVISOR, outputs)
        except ImageError:
            return Metered(manual, 0.0)
        with frame:
            dots = self._dots(frame, 0.0, METER_DIVISOR)
            assert frame.color is not None
            values = brightness_of(frame.color, dots, self.config.dot_light)
        exposure = auto_exposure(values, limits, manual.gamma) if limits is not None else manual
        seen = np.minimum(values * np.float32(exposure.factor), 1.0) ** np.float32(1.0 / exposure.gamma)
        return Metered(exposure, float(seen.mean()))

    def take(
        self, shot: Shot, exposure: Exposure, number: int, stream: Stream, divisor: int, colors: frozenset[bool]
    ) -> dict[bool, Taken]:
        """Images of one camera, in grey (False) and colour (True) as wanted."""
        c = self.config
        offset = c.model.baseline if stream in (Stream.RIGHT, Stream.RIGHT_DEPTH) else 0.0
        key = frame_key(c.seed, number, stream)
        outputs = Output.COLOR | (Output.DEPTH if shot.projected(c) else Output(0))
        with self.render(shot, offset, divisor, outputs) as frame:
            dots = self._dots(frame, offset, divisor)
            assert frame.color is not None
            return {
                color: take(
                    frame.color, exposure, key, color=color, dots=dots, dot_light=c.dot_light, noise=c.noise_factor
                )
                for color in colors
            }

    def measure(self, left: Frame, right: Frame, settings: StreamSettings, number: int) -> Measured:
        """Ground-truth depth with the injected errors, from rendered depth; closes the frames."""
        c, divisor = self.config, settings.quality.divisor
        k = c.model.intrinsics(divisor)
        ft = k.focal_length * c.model.baseline
        filters = settings.filters
        with left, right:
            assert left.depth is not None
            assert right.depth is not None
            limits = DepthRange(c.model.nearest_depth(filters.mindepth), filters.maxdepth)
            true = true_disparity(left.depth, right.depth, ft, limits)
        sigma = c.d_eps / divisor if c.noise else 0.0
        measured = measure(true, ErrorModel(sigma), frame_key(c.seed, number, Stream.DISPARITY))
        if not c.noise:
            # Nothing to repair: every hole is one that the geometry makes.
            filters = Filters(0.0, 0, 0, filters.maxdeptherr, filters.mindepth, filters.maxdepth)
        apply_filters(measured, filters, ft, divisor)
        return measured

    def match(self, left: Taken, right: Taken, exposure: Exposure, settings: StreamSettings) -> Measured:
        """Depth by matching the images."""
        c, divisor = self.config, settings.quality.divisor
        ft = c.model.intrinsics(divisor).focal_length * c.model.baseline
        searched = c.model.disparity_range(divisor, settings.filters.mindepth)
        measured = match(left.image, right.image, searched, exposure.sigma(128.0) * c.noise_factor)
        apply_filters(measured, settings.filters, ft, divisor)
        return measured

    def mesh(
        self, measured: Measured, divisor: int, options: MeshOptions, left: NDArray[np.uint8] | None
    ) -> tuple[Chunk, ...]:
        """A PLY file in parts."""
        model = self.config.model
        return disparity_mesh(measured.disparity, model.intrinsics(divisor), model.baseline, options, left)

    def _dots(self, frame: Frame, offset: float, divisor: int) -> NDArray[np.uint8] | None:
        if frame.depth is None:
            return None
        k = self.config.model.intrinsics(divisor)
        return dots_on(frame.depth, k.focal_length, k.cx, k.cy, offset - self.config.model.baseline / 2)
