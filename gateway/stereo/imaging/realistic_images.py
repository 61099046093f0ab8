"""Camera images with the effects that ``--stereo-realism`` enables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.stereo.device.camera_config import StereoConfig
from gateway.stereo.device.clock import NANOSECONDS_PER_SECOND
from gateway.stereo.imaging.rendered_images import Capture, Imaging
from gateway.stereo.imaging.scene_motion import (
    MAX_INTERVAL,
    Motion,
    has_equal_instances,
    moving_rectangles,
    subframe_count,
)
from renderers.camera import Camera
from renderers.drawlist import DrawList
from renderers.interface import Output, Renderer
from renderers.stereo.lens.motion_blur import write_mean_light
from renderers.stereo.lens.optics import LENS_BLUR, Lens
from renderers.stereo.light.key_light import light_factors, shadow_camera
from renderers.stereo.sensor.fixed_pattern import FixedPattern, fixed_pattern

_GEOMETRY: Final = Output.DEPTH | Output.NORMAL
"""Outputs from which the factors of the key light follow."""


def make_imaging(config: StereoConfig, renderer: Renderer) -> Imaging:
    """Return the source of images for a configuration: with realism if any part is enabled."""
    return RealisticImaging(config, renderer) if config.realism else Imaging(config, renderer)


@dataclass(frozen=True, slots=True, eq=False)
class RealisticImaging(Imaging):
    """Source of images with the parts of ``config.realism``. Rendered depth does not depend on them."""

    @property
    def _lens(self) -> Lens:
        return Lens(LENS_BLUR if "lens-blur" in self.config.realism else 0.0, "vignetting" in self.config.realism)

    def _fixed_pattern(self, *, right: bool) -> FixedPattern | None:
        config, k = self.config, self.config.model.intrinsics()
        if "fixed-pattern" not in config.realism or config.noise_factor == 0.0:
            return None
        return fixed_pattern(config.seed, right=right, height=k.height, width=k.width)

    def _light_factors(self, scene: DrawList, half: Camera) -> NDArray[np.uint8] | None:
        if "shadows" not in self.config.realism:
            return None
        geometry = self.renderer.render(scene, half, _GEOMETRY, self.look)
        assert geometry.depth is not None
        assert geometry.normal is not None
        light = shadow_camera(geometry.depth, half)
        if light is None:
            return None
        shadows = self.renderer.render(scene, light, Output.DEPTH, self.look)
        assert shadows.depth is not None
        return light_factors(geometry.depth, geometry.normal, half, shadows.depth, light)

    def _blur_motion(self, capture: Capture, offset: float, exposure_time: float, color: NDArray[np.uint8]) -> None:
        """Blur what has moved since ``capture.earlier``: average further renderings of these parts into ``color``."""
        earlier = capture.earlier
        if "motion-blur" not in self.config.realism or earlier is None:
            return
        seconds = (capture.timestamp - earlier.timestamp) / NANOSECONDS_PER_SECOND
        if not 0.0 < seconds <= MAX_INTERVAL or not has_equal_instances(earlier.scene, capture.scene):
            return
        camera = self.camera(capture, offset, 1)
        X_world_before = earlier.X_world_left.copy()
        X_world_before[:3, 3] += X_world_before[:3, 0] * offset
        motion = Motion(earlier.scene, capture.scene, X_world_before, camera.X_world_camera)
        relative_exposure = exposure_time / seconds
        rectangles = moving_rectangles(motion, camera, relative_exposure)
        total_area = sum(rectangle.area for rectangle in rectangles)
        for rectangle in rectangles:
            count = subframe_count(rectangle, total_area, camera.width * camera.height)
            others: list[NDArray[np.uint8]] = []
            for index in range(count):
                interval = ((index + 0.5) / count - 0.5) * relative_exposure
                if 2 * index + 1 == count:  # the middle of the exposure is rendered already
                    continue
                view = Camera(
                    rectangle.right - rectangle.left,
                    rectangle.bottom - rectangle.top,
                    camera.fx,
                    camera.fy,
                    camera.cx - rectangle.left,
                    camera.cy - rectangle.top,
                    camera.near,
                    camera.far,
                    motion.camera_at(interval),
                )
                frame = self.renderer.render(motion.scene_at(interval), view, Output.COLOR, self.look)
                assert frame.color is not None
                others.append(frame.color)
            write_mean_light(color, rectangle.left, rectangle.top, others)
