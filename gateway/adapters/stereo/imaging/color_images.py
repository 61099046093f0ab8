"""Images of the separate colour camera, with its rolling shutter."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import METERING_DIVISOR
from gateway.adapters.stereo.device.stream_settings import StreamSettings
from gateway.adapters.stereo.imaging.rendered_images import ColorImage, Imaging
from gateway.adapters.stereo.imaging.scene_motion import motion_since
from gateway.adapters.stereo.imaging.scene_view import Capture
from renderers.camera import Camera
from renderers.interface import Output
from renderers.stereo.lens.color_camera import ColorCamera
from renderers.stereo.sensor.camera_image import (
    NoiseStream,
    frame_key,
    image_from_light,
    light_on_sensor,
    relative_light,
)
from renderers.stereo.sensor.exposure import LUMA, auto_exposure

_METERED_PIXELS: Final = np.s_[::METERING_DIVISOR, ::METERING_DIVISOR]
"""Pixels of the image that the camera meters."""
_STRIPS: Final = 16
"""Number of horizontal strips of a rolling-shutter image. Each is rendered at the time of its middle row."""


def expose_color_camera(
    imaging: Imaging, color_camera: ColorCamera, capture: Capture, settings: StreamSettings
) -> ColorImage:
    """Return the image of the colour camera. It has its own automatic exposure, and does not see the projector.

    Args:
        imaging: renderer and sensor model of the camera.
        color_camera: the colour camera.
        capture: scene and pose. A rolling shutter needs the previous frame, ``capture.earlier``.
        settings: parameters of the frame.

    Raises:
        ImageError: a texture cannot be decoded.
    """
    config, manual, auto_limits = imaging.config, settings.manual_exposure, settings.auto_exposure
    camera_at = partial(color_camera.camera, capture.X_world_left, near=config.near, far=config.far)
    rendered = _rendered_image(imaging, color_camera, camera_at(), capture)
    scene_light = imaging.scene_light(capture, half=partial(camera_at, divisor=2), dots=None)
    # This applies only the white balance of the exposure, which is the manual one also with automatic exposure.
    light_root = light_on_sensor(rendered, color_camera.intrinsics, manual, scene_light, imaging.lens, color=True)
    exposure = manual
    if auto_limits is not None:
        metered = relative_light(light_root[_METERED_PIXELS]) @ LUMA.astype(np.float32)
        exposure = auto_exposure(metered, auto_limits, manual)
    key = frame_key(config.seed, capture.frame_number, NoiseStream.COLOR_CAMERA)
    noise_factor = color_camera.noise if config.noise else 0.0
    return ColorImage(image_from_light(light_root, exposure, key, noise_factor=noise_factor), exposure)


def _rendered_image(imaging: Imaging, color_camera: ColorCamera, camera: Camera, capture: Capture) -> NDArray[np.uint8]:
    """Return the rendered image, (H, W, 3) uint8. With a rolling shutter, strips are rendered at their own times."""
    motion, look = None, imaging.lit(imaging.look, capture)
    earlier = capture.earlier
    if color_camera.readout > 0.0 and earlier is not None:
        X_world_before = earlier.X_world_left @ color_camera.X_left_color
        motion = motion_since(earlier, capture.timestamp, capture.scene, X_world_before, camera.X_world_camera)
    image = np.empty((camera.height, camera.width, 3), np.uint8)
    edges = np.linspace(0, camera.height, (_STRIPS if motion is not None else 1) + 1).astype(int)
    for top, bottom in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        scene, pose = capture.scene, camera.X_world_camera
        if motion is not None:
            # In intervals of frames: 0 is this frame, -1 the one before. The lower half is later than the frame.
            frame_time = ((top + bottom) / 2 / camera.height - 0.5) * (color_camera.readout / motion.seconds)
            scene, pose = motion.scene_at(frame_time), motion.camera_at(frame_time)
        strip = replace(camera, height=bottom - top, cy=camera.cy - top, X_world_camera=pose)
        frame = imaging.renderer.render(scene, strip, Output.COLOR, look)
        assert frame.color is not None
        image[top:bottom] = frame.color
    return image
