"""Camera images with the effects that ``--stereo-realism`` enables."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.stereo.auto_exposure import METERING_DIVISOR
from gateway.stereo.clock import NANOSECONDS_PER_SECOND
from gateway.stereo.config import StereoConfig
from gateway.stereo.images import METERED_PIXELS, Capture, ColorImage, ImageRequest, Imaging, own_exposure
from gateway.stereo.motion import MAX_INTERVAL, Motion, has_equal_instances, moving_rectangles, subframe_count
from gateway.stereo.settings import StreamSettings
from renderers.camera import Camera
from renderers.drawlist import DrawList
from renderers.interface import Frame, Output, Renderer
from renderers.stereo.color_camera import ColorCamera
from renderers.stereo.exposure import LUMA, Exposure
from renderers.stereo.fixed_pattern import fixed_pattern
from renderers.stereo.key_light import light_factors, shadow_camera
from renderers.stereo.motion_blur import write_mean_light
from renderers.stereo.noise import NoiseStream, frame_key
from renderers.stereo.optics import LENS_BLUR, Lens, SceneLight, brightness_of_light, light_on_sensor
from renderers.stereo.sensor import SensorImage, image_from_light

_GEOMETRY: Final = Output.DEPTH | Output.NORMAL
"""Outputs from which the factors of the key light follow."""


def make_imaging(config: StereoConfig, renderer: Renderer) -> Imaging:
    """Return the source of images for a configuration: with realism if any part is enabled."""
    return RealisticImaging(config, renderer) if config.realism else Imaging(config, renderer)


@dataclass(frozen=True, slots=True, eq=False)
class RealisticImaging(Imaging):
    """Source of images with the parts of ``config.realism``. Rendered depth does not depend on them."""

    def expose(self, capture: Capture, request: ImageRequest) -> dict[bool, SensorImage]:
        config, exposure = self.config, request.exposure
        offset = config.model.baseline if request.stream.is_right else 0.0
        key = frame_key(config.seed, capture.frame_number, request.stream)
        k = config.model.intrinsics()
        has_pattern = "fixed-pattern" in config.realism and config.noise_factor > 0.0
        pattern = None
        if has_pattern:
            pattern = fixed_pattern(config.seed, right=request.stream.is_right, height=k.height, width=k.width)
        noise_factor = config.noise_factor / request.averaged_images**0.5
        with self.render(capture, offset, 1, self._outputs(capture)) as frame:
            assert frame.color is not None
            self._blur_motion(capture, offset, exposure.time, frame.color)
            dots = self._projected_dots(frame, capture, offset, 1)
            factors = self._light_factors(capture.scene, self._camera(capture, offset, 2))
            scene_light = SceneLight(dots, config.dot_light, factors, config.background)
            return {
                color: image_from_light(
                    light_on_sensor(frame.color, scene_light, self._lens, k, exposure, color=color),
                    exposure,
                    key,
                    pattern,
                    noise_factor,
                )
                for color in request.colors
            }

    def develop(
        self, rendered: NDArray[np.uint8], color_camera: ColorCamera, capture: Capture, settings: StreamSettings
    ) -> ColorImage:
        config, manual = self.config, settings.manual_exposure
        camera = color_camera.camera(capture.X_world_left, near=config.near, far=config.far, divisor=2)
        scene_light = SceneLight(None, 0.0, self._light_factors(capture.scene, camera), config.background)
        light = light_on_sensor(rendered, scene_light, self._lens, color_camera.intrinsics, manual, color=True)
        brightness = brightness_of_light(light[METERED_PIXELS]) @ LUMA.astype(np.float32)
        exposure = own_exposure(brightness, settings)
        key = frame_key(config.seed, capture.frame_number, NoiseStream.COLOR_CAMERA)
        return ColorImage(
            image_from_light(light, exposure, key, noise_factor=self._noise_factor(color_camera)), exposure
        )

    @property
    def _lens(self) -> Lens:
        return Lens(LENS_BLUR if "lens-blur" in self.config.realism else 0.0, "vignetting" in self.config.realism)

    def _metered_brightness(
        self, frame: Frame, capture: Capture, dots: NDArray[np.uint8] | None, manual: Exposure
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        assert frame.color is not None
        config, rendered = self.config, frame.color
        k = config.model.intrinsics(METERING_DIVISOR)
        lens = Lens(vignetting="vignetting" in config.realism)
        factors = self._light_factors(capture.scene, self._camera(capture, 0.0, 2 * METERING_DIVISOR))

        def brightness(dots: NDArray[np.uint8] | None) -> NDArray[np.float32]:
            scene_light = SceneLight(dots, config.dot_light, factors, config.background)
            return brightness_of_light(light_on_sensor(rendered, scene_light, lens, k, manual, color=False)[:, :, 0])

        unlit = brightness(None)
        return unlit, unlit if dots is None else brightness(dots)

    def _light_factors(self, scene: DrawList, camera: Camera) -> NDArray[np.uint8] | None:
        """Return ``key_light.light_factors`` at half the resolution of an image; None: all factors are 1.

        Args:
            scene: scene of the image.
            camera: camera with half the resolution of the image.
        """
        if "shadows" not in self.config.realism:
            return None
        with ExitStack() as stack:
            geometry = stack.enter_context(self.renderer.render(scene, camera, _GEOMETRY, self.look))
            assert geometry.depth is not None
            assert geometry.normal is not None
            light = shadow_camera(geometry.depth, camera)
            if light is None:
                return None
            shadows = stack.enter_context(self.renderer.render(scene, light, Output.DEPTH, self.look))
            assert shadows.depth is not None
            return light_factors(geometry.depth, geometry.normal, camera, shadows.depth, light)

    def _blur_motion(self, capture: Capture, offset: float, exposure_time: float, color: NDArray[np.uint8]) -> None:
        """Blur the parts of a rendered image in which something moves, by averaging further renderings of them.

        Args:
            capture: scene and pose of this frame and of the frame before.
            offset: metres along the left camera's x axis.
            exposure_time: seconds.
            color: (H, W, 3) uint8, rendered image, changed.
        """
        earlier = capture.earlier
        if "motion-blur" not in self.config.realism or earlier is None:
            return
        seconds = (capture.timestamp - earlier.timestamp) / NANOSECONDS_PER_SECOND
        if not 0.0 < seconds <= MAX_INTERVAL or not has_equal_instances(earlier.scene, capture.scene):
            return
        camera = self._camera(capture, offset, 1)
        X_world_before = earlier.X_world_left.copy()
        X_world_before[:3, 3] += X_world_before[:3, 0] * offset
        motion = Motion(earlier.scene, capture.scene, X_world_before, camera.X_world_camera)
        relative_exposure = exposure_time / seconds
        rectangles = moving_rectangles(motion, camera, relative_exposure)
        total_area = sum(rectangle.area for rectangle in rectangles)
        for rectangle in rectangles:
            count = subframe_count(rectangle, total_area, camera.width * camera.height)
            with ExitStack() as stack:
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
                    frame = stack.enter_context(
                        self.renderer.render(motion.scene_at(interval), view, Output.COLOR, self.look)
                    )
                    assert frame.color is not None
                    others.append(frame.color)
                write_mean_light(color, rectangle.left, rectangle.top, others)

    def _camera(self, capture: Capture, offset: float, divisor: int) -> Camera:
        """Return the camera of ``render`` with the same arguments."""
        config = self.config
        return config.model.camera(
            capture.X_world_left, offset=offset, divisor=divisor, near=config.near, far=config.far
        )
