"""Depth of ``measured`` images and profiles of stereo cameras. Runs without ``--stereo-profile`` do not import it."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.profile import DepthMode, Profile, read_profile
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.imaging.rendered_images import GREY, ImageRequest, Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.scene.draw.cameras import CameraError
from renderers.camera import Camera
from renderers.drawlist import DrawList
from renderers.interface import Look, Renderer
from renderers.stereo.depth.matching import ImagePair
from renderers.stereo.depth.metric_depth import millimetres_from_disparity
from renderers.stereo.model import Quality
from renderers.stereo.sensor.camera_image import NoiseStream


@lru_cache(maxsize=4)
def cached_profile(name: str) -> Profile:
    """Return a camera profile; raises ProfileError."""
    return read_profile(name)


def measured_depth(
    renderer: Renderer,
    profile: Profile,
    depth_mode: DepthMode,
    scene: DrawList,
    camera: Camera,
    look: Look,
    noise_seed: int,
) -> NDArray[np.uint16]:
    """Return depth as the stereo camera of a profile measures it: (H, W) uint16, millimetres; 0: not measured.

    It is along the optical axis. The camera has the default parameters of its profile, at the full resolution;
    ``camera`` is its left one. ``look`` gives background and cut-outs. Raises CameraError if ``camera`` has another
    lens than the profile.
    """
    k = profile.model.intrinsics()
    expected = (k.width, k.height, k.focal_length, k.focal_length, k.cx, k.cy)
    lens = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
    if not np.allclose(lens, expected, rtol=1e-9):
        raise CameraError("measured images need views with the size and lens of --stereo-profile")
    config = StereoConfig.of_profile(profile)
    config = replace(
        config, depth_mode=depth_mode, seed=noise_seed, background=look.background, alpha_threshold=look.alpha_threshold
    )
    imaging = Imaging(config, renderer)
    settings = replace(read_settings(Parameters(profile.limits)), quality=Quality.FULL)
    capture = Capture(0, scene, 0, camera.X_world_camera, settings.depth_gpio)
    pair = None
    if depth_mode == "matched":
        exposure = imaging.meter(capture, settings).exposure
        left, right = (
            imaging.expose(capture, ImageRequest(exposure, stream, frozenset((GREY,)), settings.averaged_images))[GREY]
            for stream in (NoiseStream.LEFT_DEPTH, NoiseStream.RIGHT_DEPTH)
        )
        pair = ImagePair(left, right, exposure)
    images = imaging.measure(capture, settings, pair)
    return millimetres_from_disparity(images.disparity, profile.model.focal_times_baseline(1))
