"""Images of the separate colour camera, with its rolling shutter."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.stereo.device.clock import NANOSECONDS_PER_SECOND
from gateway.stereo.device.stream_settings import StreamSettings
from gateway.stereo.imaging.rendered_images import Capture, ColorImage, Imaging
from gateway.stereo.imaging.scene_motion import MAX_INTERVAL, Motion, has_equal_instances
from renderers.camera import Camera
from renderers.interface import Output
from renderers.stereo.lens.color_camera import ColorCamera

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
    config = imaging.config
    camera = color_camera.camera(capture.X_world_left, near=config.near, far=config.far)
    rendered = _rolling_image(imaging, color_camera, camera, capture)
    return imaging.develop(rendered, color_camera, capture, settings)


def _rolling_image(imaging: Imaging, color_camera: ColorCamera, camera: Camera, capture: Capture) -> NDArray[np.uint8]:
    """Return the rendered image, (H, W, 3) uint8. With a rolling shutter, strips are rendered at their own times."""
    motion, relative_readout = _motion(color_camera, camera, capture)
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
        frame = imaging.renderer.render(scene, strip, Output.COLOR, imaging.look)
        assert frame.color is not None
        image[top:bottom] = frame.color
    return image


def _motion(color_camera: ColorCamera, camera: Camera, capture: Capture) -> tuple[Motion | None, float]:
    """Return the motion since the previous frame, and the readout time in units of the time between the frames.

    The motion is None for a global shutter, if nothing moves, and if the previous frame is too old or has other meshes.
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
