"""Depth as the stereo camera of a profile measures it (``measured`` images): rendered depth with modelled errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gateway.datasets.views import Intrinsics
from gateway.scene.cameras import CameraError
from gateway.stereo.device.camera_config import StereoConfig
from gateway.stereo.device.parameters import Parameters
from gateway.stereo.device.profile import Profile, read_profile
from gateway.stereo.device.stream_settings import read_settings
from gateway.stereo.imaging.rendered_images import GREY, ImageRequest, Imaging
from gateway.stereo.imaging.scene_view import Capture
from renderers.camera import Camera
from renderers.drawlist import DrawList
from renderers.interface import Look, Renderer
from renderers.stereo.depth.image_pair import ImagePair
from renderers.stereo.depth.metric_depth import millimetres_from_disparity
from renderers.stereo.model import Quality
from renderers.stereo.sensor.camera_image import NoiseStream


@lru_cache(maxsize=4)
def cached_profile(name: str) -> Profile:
    """Return a camera profile; raises ProfileError."""
    return read_profile(name)


def intrinsics_of(profile: Profile) -> Intrinsics:
    """Return size and lens of the left camera of a profile, for the views of a dataset."""
    k = profile.model.intrinsics()
    return Intrinsics(k.width, k.height, fy=k.focal_length, cx=k.cx, cy=k.cy)


@dataclass(frozen=True, slots=True)
class StereoSensor:
    """A stereo camera with the default parameters of its profile, at the full resolution."""

    profile: Profile
    renderer: Renderer

    def measure(self, scene: DrawList, camera: Camera, look: Look, noise_seed: int) -> NDArray[np.uint16]:
        """Return depth along the optical axis, (H, W) uint16, in millimetres; 0: not measured.

        Args:
            camera: left camera; has the lens of the profile.
            look: background, and what is cut out.
            noise_seed: seed of the noise.

        Raises:
            CameraError: the camera has another lens.
        """
        profile, k = self.profile, self.profile.model.intrinsics()
        expected = (k.width, k.height, k.focal_length, k.focal_length, k.cx, k.cy)
        lens = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
        if not np.allclose(lens, expected, rtol=1e-9):
            raise CameraError("measured images need views with the size and lens of --stereo-profile")
        config = StereoConfig(
            model=profile.model,
            limits=profile.limits,
            seed=noise_seed,
            image_noise=profile.stereo.noise,
            disparity_error=profile.depth.disparity_error,
            projector=profile.projector is not None,
            dot_light=profile.projector.light if profile.projector is not None else 0.0,
            background=look.background,
            alpha_threshold=look.alpha_threshold,
        )
        imaging = Imaging(config, self.renderer)
        settings = replace(read_settings(Parameters(profile.limits)), quality=Quality.FULL)
        capture = Capture(0, scene, 0, camera.X_world_camera, settings.depth_gpio)
        exposure = imaging.meter(capture, settings).exposure
        left, right = (
            imaging.expose(capture, ImageRequest(exposure, stream, frozenset((GREY,)), settings.averaged_images))[GREY]
            for stream in (NoiseStream.LEFT_DEPTH, NoiseStream.RIGHT_DEPTH)
        )
        pair = ImagePair(left, right, exposure, imaging.image_kind(capture))
        images = imaging.measure(capture, settings, pair)
        return millimetres_from_disparity(images.disparity, profile.model.focal_times_baseline(1))
