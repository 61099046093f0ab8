"""Effects of lights and lenses that need further renderings: projectors, shadows of the key light, motion blur."""

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import METERING_DIVISOR, StereoConfig
from gateway.adapters.stereo.imaging.scene_motion import Motion, moving_rectangles, subframe_count
from gateway.adapters.stereo.imaging.scene_view import Capture
from renderers.camera import Camera
from renderers.drawlist import DrawList
from renderers.interface import Frame, Look, Output, Renderer
from renderers.light_rig import KeyLight
from renderers.stereo.lens.motion_blur import write_mean_light
from renderers.stereo.light.posed_projector import Surfaces, add_dots
from renderers.stereo.light.projector import projected_dots, returned_shares
from renderers.stereo.light.scene_light import NORMAL_OFFSET, shadow_camera, with_share_of_light


def key_light(renderer: Renderer, look: Look, level: float, scene: DrawList, camera: Camera) -> KeyLight | None:
    """Return the key light with its shadow map; None if it reaches nothing that is visible.

    The light on a surface that faces it is ``level``. The shadow map covers the view of ``camera``, which has
    1/``METERING_DIVISOR`` of the images' resolution.
    """
    view = renderer.render(scene, camera, Output.DEPTH | Output.NORMAL, look)
    assert view.depth is not None
    assert view.normal is not None
    light_camera = shadow_camera(view.depth, camera, METERING_DIVISOR)
    if light_camera is None:
        return None
    shadows = renderer.render(scene, light_camera, Output.DEPTH, look)
    assert shadows.depth is not None
    light = KeyLight(level, light_camera, shadows.depth, NORMAL_OFFSET / light_camera.fx)
    return with_share_of_light(light, view.depth, view.normal, camera)


def blur_motion(
    renderer: Renderer, look: Look, motion: Motion, camera: Camera, exposure_time: float, roots: NDArray[np.uint32]
) -> None:
    """Blur what moves since the previous frame: average further renderings of these parts into an image.

    ``roots`` is the rendered image (``Frame.roots``), (H, W + 8) uint32, and changed. The exposure time is in seconds.
    """
    relative_exposure = exposure_time / motion.seconds
    rectangles = moving_rectangles(motion, camera, relative_exposure)
    total_area = sum(rectangle.area for rectangle in rectangles)
    for rectangle in rectangles:
        count = subframe_count(rectangle, total_area, camera.width * camera.height)
        subframes: list[NDArray[np.uint32]] = []
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
            frame = renderer.render(motion.scene_at(time), view, Output.ROOTS, look)
            assert frame.roots is not None
            subframes.append(frame.roots[:, : view.width])
        write_mean_light(roots, rectangle.left, rectangle.top, subframes)


def light_of_projectors(
    renderer: Renderer,
    look: Look,
    config: StereoConfig,
    capture: Capture,
    frame: Frame,
    offset: float,
    divisor: int,
    *,
    has_own: bool,
) -> NDArray[np.uint16]:
    """Return the light of the projectors at each pixel of a frame, relative to all other light, (H, W) uint16.

    Args:
        look: look of the surfaces that dots fall on, with their other light.
        capture: scene and pose, with the projectors of other cameras.
        frame: the rendered depth and instances; the share of the lamp, and with other projectors normals and
            light.
        offset: metres from the left camera to that of the frame, along its x axis.
        divisor: width of the camera images divided by that of the frame.
        has_own: True if the camera's own projector is on.
    """
    assert frame.depth is not None
    assert frame.instance is not None
    returned = frame.instance, returned_shares(capture.scene.instances)
    model, k, soft = config.model, config.model.intrinsics(divisor), "projector" in config.realism
    camera_at = partial(model.camera, capture.X_world_left, divisor=divisor, near=config.near, far=config.far)
    projector_offset = model.baseline / 2
    right = offset > projector_offset
    dots = np.zeros(frame.depth.shape, np.uint16)
    if has_own:
        projector_view = renderer.render(capture.scene, camera_at(offset=projector_offset), Output.DEPTH, look)
        assert projector_view.depth is not None
        dots = projected_dots(
            frame.depth,
            k.focal_length,
            k.cx,
            k.cy,
            offset - projector_offset,
            projector_view.depth,
            lamp_share=frame.lamp_share,
            soft=soft,
            right=right,
            point_samples=soft and divisor == METERING_DIVISOR,
            returned=returned,
        )
    if not capture.projectors:
        return dots
    assert frame.normal is not None
    assert frame.light is not None
    surfaces = Surfaces(camera_at(offset=offset), frame.depth, frame.normal, returned, frame.light)
    for other in capture.projectors:
        projector = other.camera(divisor, near=config.near, far=config.far)
        projector_view = renderer.render(capture.scene, projector, Output.DEPTH, look)
        assert projector_view.depth is not None
        strength = other.dot_light / config.full_dot_light
        add_dots(dots, surfaces, projector, projector_view.depth, strength, soft=soft, right=right)
    return dots
