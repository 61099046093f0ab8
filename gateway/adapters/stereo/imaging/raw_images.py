"""Images of the stereo cameras before rectification, for calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.imaging.rendered_images import Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from renderers.camera import Camera
from renderers.interface import Output
from renderers.stereo.lens.distortion import distorted_image, raw_pose
from renderers.stereo.sensor.camera_image import NoiseStream, SensorImage, frame_key, image_from_light, light_on_sensor
from renderers.stereo.sensor.exposure import Exposure


def raw_image(imaging: Imaging, capture: Capture, exposure: Exposure, right: bool) -> SensorImage:
    """Return the grey image of one camera before rectification, without projector and realism.

    Args:
        imaging: source of the images.
        capture: scene and pose.
        exposure: exposure of the image.
        right: the right camera instead of the left one.

    Raises:
        ImageError: a texture cannot be decoded.
    """
    config = imaging.config
    offset = config.model.baseline if right else 0.0
    camera = imaging.camera(capture, offset, 1)
    camera = replace(camera, X_world_camera=raw_pose(camera.X_world_camera, config.distortion, right=right))

    def render(pinhole: Camera) -> NDArray[np.uint8]:
        frame = imaging.renderer.render(capture.scene, pinhole, Output.COLOR, imaging.look)
        assert frame.color is not None
        return frame.color

    k = config.model.intrinsics()
    light = light_on_sensor(distorted_image(render, camera, k, config.distortion), k, exposure, color=False)
    key = frame_key(config.seed, capture.frame_number, NoiseStream.RAW_RIGHT if right else NoiseStream.RAW_LEFT)
    return image_from_light(light, exposure, key, noise_factor=config.noise_factor)
