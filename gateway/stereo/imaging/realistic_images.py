"""Effects of real lenses and lights that need further renderings: shadows of the key light, and motion blur."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.stereo.imaging.scene_motion import Motion, moving_rectangles, subframe_count
from renderers.camera import Camera
from renderers.drawlist import DrawList
from renderers.interface import Look, Output, Renderer
from renderers.stereo.lens.motion_blur import write_mean_light
from renderers.stereo.light.key_light import light_factors, shadow_camera

_GEOMETRY: Final = Output.DEPTH | Output.NORMAL
"""Outputs from which the factors of the key light follow."""


def key_light_factors(renderer: Renderer, look: Look, scene: DrawList, half: Camera) -> NDArray[np.uint8] | None:
    """Return ``key_light.light_factors`` for a camera with half the resolution of an image; None: all are 1."""
    geometry = renderer.render(scene, half, _GEOMETRY, look)
    assert geometry.depth is not None
    assert geometry.normal is not None
    light = shadow_camera(geometry.depth, half)
    if light is None:
        return None
    shadows = renderer.render(scene, light, Output.DEPTH, look)
    assert shadows.depth is not None
    return light_factors(geometry.depth, geometry.normal, half, shadows.depth, light)


def blur_motion(
    renderer: Renderer, look: Look, motion: Motion, camera: Camera, exposure_time: float, color: NDArray[np.uint8]
) -> None:
    """Blur what moves: average further renderings of these parts into an image.

    Args:
        motion: motion since the previous frame.
        camera: camera of the image.
        exposure_time: seconds.
        color: (H, W, 3) uint8, rendered image, changed.
    """
    relative_exposure = exposure_time / motion.seconds
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
            frame = renderer.render(motion.scene_at(interval), view, Output.COLOR, look)
            assert frame.color is not None
            others.append(frame.color)
        write_mean_light(color, rectangle.left, rectangle.top, others)
