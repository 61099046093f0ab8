"""Images of the colour camera beside a stereo camera: exposure, noise and rolling shutter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.stereo.auto_exposure import METERING_DIVISOR
from gateway.stereo.clock import NANOSECONDS_PER_SECOND
from gateway.stereo.images import Capture, Imaging
from gateway.stereo.motion import MAX_INTERVAL, Motion, has_equal_instances
from gateway.stereo.settings import StreamSettings
from renderers.camera import Camera
from renderers.interface import Look, Output
from renderers.stereo.color_camera import ColorCamera
from renderers.stereo.exposure import Exposure, auto_exposure, brightness_of
from renderers.stereo.noise import NoiseStream, frame_key
from renderers.stereo.sensor import SensorImage, sensor_image

_STRIPS: Final = 16
"""Number of parts of a rolling image, each of one instant."""


@dataclass(frozen=True, slots=True, eq=False)
class ColorImage:
    """Image of a colour camera."""

    sensor_image: SensorImage
    exposure: Exposure


def expose_color_camera(
    imaging: Imaging, color_camera: ColorCamera, capture: Capture, settings: StreamSettings
) -> ColorImage:
    """Return the image of the colour camera. It meters its own image, and does not see the projector.

    Args:
        imaging: source of the stereo cameras' images.
        color_camera: the colour camera.
        capture: scene and pose; with the frame before, if the shutter rolls.
        settings: parameters of the frame.

    Raises:
        ImageError: a texture cannot be decoded.
    """
    config = imaging.config
    camera = color_camera.camera(capture.X_world_left, near=config.near, far=config.far)
    rendered = _rolling_image(imaging, color_camera, camera, capture)
    exposure = settings.manual_exposure
    if settings.auto_exposure is not None:
        samples = np.ascontiguousarray(rendered[::METERING_DIVISOR, ::METERING_DIVISOR])
        exposure = auto_exposure(brightness_of(samples), settings.auto_exposure, exposure)
    key = frame_key(config.seed, capture.frame_number, NoiseStream.COLOR_CAMERA)
    noise_factor = color_camera.noise if config.noise else 0.0
    return ColorImage(sensor_image(rendered, exposure, key, color=True, noise_factor=noise_factor), exposure)


def _rolling_image(imaging: Imaging, color_camera: ColorCamera, camera: Camera, capture: Capture) -> NDArray[np.uint8]:
    """Return the rendered image, (H, W, 3) uint8. If anything moves, each strip is rendered at its own time."""
    motion, relative_readout = _motion(color_camera, camera, capture)
    look = Look(imaging.config.look, imaging.config.background)
    image = np.empty((camera.height, camera.width, 3), np.uint8)
    edges = np.linspace(0, camera.height, (_STRIPS if motion is not None else 1) + 1).astype(int)
    for top, bottom in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        scene, pose = capture.scene, camera.X_world_camera
        if motion is not None:
            time = ((top + bottom) / 2 / camera.height - 0.5) * relative_readout
            scene, pose = motion.scene_at(time), motion.camera_at(time)
        strip = Camera(
            camera.width, bottom - top, camera.fx, camera.fy, camera.cx, camera.cy - top, camera.near, camera.far, pose
        )
        with imaging.renderer.render(scene, strip, Output.COLOR, look) as frame:
            assert frame.color is not None
            image[top:bottom] = frame.color
    return image


def _motion(color_camera: ColorCamera, camera: Camera, capture: Capture) -> tuple[Motion | None, float]:
    """Return the motion since the frame before, and the readout time in units of the time between the frames.

    The motion is None if the shutter does not roll, nothing moves, or the motion is not known.
    """
    earlier = capture.earlier
    if earlier is None or color_camera.readout == 0.0:
        return None, 0.0
    seconds = (capture.timestamp - earlier.timestamp) / NANOSECONDS_PER_SECOND
    is_at_rest = earlier.scene is capture.scene and np.array_equal(earlier.X_world_left, capture.X_world_left)
    if is_at_rest or not 0.0 < seconds <= MAX_INTERVAL or not has_equal_instances(earlier.scene, capture.scene):
        return None, 0.0
    before = earlier.X_world_left @ color_camera.X_left_color
    return Motion(earlier.scene, capture.scene, before, camera.X_world_camera), color_camera.readout / seconds
