"""Images of the separate colour camera, with its rolling shutter."""

from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from gateway.adapters.stereo.device.camera_config import METERING_DIVISOR
from gateway.adapters.stereo.device.stream_settings import StreamSettings
from gateway.adapters.stereo.imaging.rendered_images import ColorImage, Imaging
from gateway.adapters.stereo.imaging.scene_motion import motion_since
from gateway.adapters.stereo.imaging.scene_view import Capture
from renderers.camera import Camera
from renderers.interface import Frame, Output
from renderers.light_rig import KeyLight
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

    A rolling shutter needs the previous frame, ``capture.earlier``. Raises ImageError if a texture cannot be decoded.
    """
    config, manual, auto_limits = imaging.config, settings.manual_exposure, settings.auto_exposure
    camera_at = partial(color_camera.camera, capture.X_world_left, near=config.near, far=config.far)
    key_light = imaging.key_light(capture, camera_at(divisor=METERING_DIVISOR))
    frame = _rendered_frame(imaging, color_camera, camera_at(), capture, key_light)
    assert frame.roots is not None
    scene_light = imaging.scene_light(frame, dots=None)
    # This applies only the white balance of the exposure, which is the manual one also with automatic exposure.
    light_root = light_on_sensor(frame.roots, color_camera.intrinsics, manual, scene_light, imaging.lens, color=True)
    exposure = manual
    if auto_limits is not None:
        metered = relative_light(light_root[_METERED_PIXELS]) @ LUMA.astype(np.float32)
        exposure = auto_exposure(metered, auto_limits, manual)
    key = frame_key(config.seed, capture.frame_number, NoiseStream.COLOR_CAMERA)
    noise_factor = color_camera.noise if config.noise else 0.0
    return ColorImage(image_from_light(light_root, exposure, key, noise_factor=noise_factor), exposure)


def _rendered_frame(
    imaging: Imaging, color_camera: ColorCamera, camera: Camera, capture: Capture, key: KeyLight | None
) -> Frame:
    """Return the rendered image. With a rolling shutter, strips are rendered at their own times."""
    motion, look = None, imaging.lit(imaging.look, capture, key)
    outputs = Output.ROOTS | Output.KEY_FACTOR if key is not None else Output.ROOTS
    earlier = capture.earlier
    if color_camera.readout > 0.0 and earlier is not None:
        X_world_before = earlier.X_world_left @ color_camera.X_left_color
        motion = motion_since(earlier, capture.timestamp, capture.scene, X_world_before, camera.X_world_camera)
    if motion is None:
        return imaging.renderer.render(capture.scene, camera, outputs, look)
    strips: list[Frame] = []
    edges = np.linspace(0, camera.height, _STRIPS + 1).astype(int)
    for top, bottom in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        # In intervals of frames: 0 is this frame, -1 the one before. The lower half is later than the frame.
        time = ((top + bottom) / 2 / camera.height - 0.5) * (color_camera.readout / motion.seconds)
        pose = motion.camera_at(time)
        strip = replace(camera, height=bottom - top, cy=camera.cy - top, X_world_camera=pose)
        strips.append(imaging.renderer.render(motion.scene_at(time), strip, outputs, look))
    factors = [strip.key_factor for strip in strips if strip.key_factor is not None]
    roots = [strip.roots for strip in strips if strip.roots is not None]
    return Frame(roots=np.concatenate(roots), key_factor=np.concatenate(factors) if factors else None)
