"""What worker threads do for a frame: render, measure, build meshes. Nothing here knows the event loop."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gateway.stereo import depth
from gateway.stereo.auto_exposure import DIVISOR as METER_DIVISOR
from gateway.stereo.auto_exposure import Memory, expose
from gateway.stereo.config import StereoConfig
from gateway.stereo.settings import StreamSettings
from gateway.stereo.wire import Chunk
from renderers.drawlist import DrawList, ImageError
from renderers.interface import Frame, Look, Output, Renderer
from renderers.stereo.errors import Measured
from renderers.stereo.exposure import Exposure, brightness_of
from renderers.stereo.mesh import MeshOptions, disparity_mesh
from renderers.stereo.noise import Stream, frame_key
from renderers.stereo.projector import dots_on
from renderers.stereo.sensor import Taken, take


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
    index: int = 0
    """Number of the frame."""

    def projected(self, config: StereoConfig) -> bool:
        """Whether the projector's light is on: it hangs on Out1."""
        return config.projector and bool(self.lines & 1)


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which images of one camera are taken, and how."""

    exposure: Exposure
    number: int
    """Of the frame: noise is a function of it."""
    stream: Stream
    divisor: int
    """Of the model's resolution."""
    colors: frozenset[bool]
    """False: in grey; True: in colour."""
    averaged: int = 1
    """Each is the mean of so many, with that much less noise."""


@dataclass(frozen=True, slots=True)
class Metered:
    """What automatic exposure decided."""

    exposure: Exposure
    brightness: float
    """Mean of the image it gives, 0 to 1."""
    out1_reduction: float = 0.0
    """See ``metering``."""


@dataclass(frozen=True, slots=True, eq=False)
class Studio:
    """What renders."""

    config: StereoConfig
    renderer: Renderer
    memory: Memory = field(default_factory=Memory)
    """Of automatic exposure."""

    def render(self, shot: Shot, offset: float, divisor: int, outputs: Output) -> Frame:
        """The pictures of the camera at ``offset`` metres to the right of the left one; close the frame."""
        c = self.config
        camera = c.model.camera(shot.X_world_left, offset=offset, divisor=divisor, near=c.near, far=c.far)
        return self.renderer.render(shot.scene, camera, outputs, Look(c.look, c.background))

    def meter(self, shot: Shot, settings: StreamSettings) -> Metered:
        """How the images of a shot are taken, and the brightness of the left one.

        The manual exposure is kept when a texture is broken, too.
        """
        lit = replace(shot, lines=shot.lines | 1)
        outputs = Output.COLOR | (Output.DEPTH if lit.projected(self.config) else Output(0))
        try:
            frame = self.render(shot, 0.0, METER_DIVISOR, outputs)
        except ImageError:
            return Metered(settings.manual, 0.0)
        with frame:
            dots = self._dots(frame, shot, 0.0, METER_DIVISOR)
            assert frame.color is not None
            light, channels = self.config.dot_light, settings.manual.channels
            dark = brightness_of(frame.color, None, light, channels)
            bright = brightness_of(frame.color, dots, light, channels) if dots is not None else dark
        exposure, reduction = expose(dark, bright, high=bool(shot.lines & 1), settings=settings, memory=self.memory)
        seen = bright if shot.lines & 1 else dark
        return Metered(exposure, float(exposure.response(seen * exposure.factor).mean()), reduction)

    def take(self, shot: Shot, wanted: Wanted) -> dict[bool, Taken]:
        """Images of one camera, by whether they are in colour."""
        c = self.config
        offset = c.model.baseline if wanted.stream.right else 0.0
        key = frame_key(c.seed, wanted.number, wanted.stream)
        noise = c.noise_factor / wanted.averaged**0.5
        outputs = Output.COLOR | (Output.DEPTH if shot.projected(c) else Output(0))
        with self.render(shot, offset, wanted.divisor, outputs) as frame:
            dots = self._dots(frame, shot, offset, wanted.divisor)
            assert frame.color is not None
            return {
                color: take(
                    frame.color, wanted.exposure, key, color=color, dots=dots, dot_light=c.dot_light, noise=noise
                )
                for color in wanted.colors
            }

    def measure(self, left: Frame, right: Frame, settings: StreamSettings, number: int) -> Measured:
        """Ground-truth depth with the injected errors, from rendered depth; closes the frames."""
        with left, right:
            assert left.depth is not None
            assert right.depth is not None
            return depth.measure_depth(self.config, left.depth, right.depth, settings, number)

    def match(
        self,
        left: Taken,
        right: Taken,
        exposure: Exposure,
        settings: StreamSettings,
        second: tuple[Taken, Taken, Exposure] | None = None,
    ) -> Measured:
        """Depth by matching the images; ``second`` is a pair that fills holes of the first."""
        return depth.match_depth(self.config, left, right, exposure, settings, second)

    def mesh(
        self, measured: Measured, divisor: int, options: MeshOptions, left: NDArray[np.uint8] | None
    ) -> tuple[Chunk, ...]:
        """A PLY file in parts."""
        model = self.config.model
        return disparity_mesh(measured.disparity, model.intrinsics(divisor), model.baseline, options, left)

    def _dots(self, frame: Frame, shot: Shot, offset: float, divisor: int) -> NDArray[np.uint8] | None:
        if frame.depth is None:
            return None
        model = self.config.model
        k, middle = model.intrinsics(divisor), model.baseline / 2
        with self.render(shot, middle, divisor, Output.DEPTH) as seen:
            return dots_on(frame.depth, k.focal_length, k.cx, k.cy, offset - middle, seen.depth)
