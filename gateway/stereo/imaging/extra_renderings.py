"""Effects of real lenses and lights that need further renderings: shadows of the key light, and motion blur."""

from __future__ import annotations

from dataclasses import replace
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


def key_light_factors(
    renderer: Renderer, look: Look, scene: DrawList, half_size_camera: Camera
) -> NDArray[np.uint8] | None:
    """Return the factor from the rendered light to that of the key light with its shadows; None: all are 1.

    Args:
        half_size_camera: camera with half the resolution of an image.

    Returns:
        (h, w) uint8; see ``key_light.light_factors``.
    """
    geometry = renderer.render(scene, half_size_camera, _GEOMETRY, look)
    assert geometry.depth is not None
    assert geometry.normal is not None
    light_camera = shadow_camera(geometry.depth, half_size_camera)
    if light_camera is None:
        return None
    shadows = renderer.render(scene, light_camera, Output.DEPTH, look)
    assert shadows.depth is not None
    return light_factors(geometry.depth, geometry.normal, half_size_camera, shadows.depth, light_camera)


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
        subframes: list[NDArray[np.uint8]] = []
        for index in range(count):
            if index == count // 2:  # the middle of the exposure is rendered already; the count is odd
                continue
            # In units of the time between the frames: the exposure is centred at 0, this frame.
            time = ((index + 0.5) / count - 0.5) * relative_exposure
            view = replace(
                camera,
                width=rectangle.right - rectangle.left,
                height=rectangle.bottom - rectangle.top,
                cx=camera.cx - rectangle.left,
                cy=camera.cy - rectangle.top,
                X_world_camera=motion.camera_at(time),
            )
            frame = renderer.render(motion.scene_at(time), view, Output.COLOR, look)
            assert frame.color is not None
            subframes.append(frame.color)
        write_mean_light(color, rectangle.left, rectangle.top, subframes)
