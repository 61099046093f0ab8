"""Materials, cameras and depth of ``albedo``, ``stereo``, ``flow`` and ``measured`` images."""

import struct
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.profile import DepthMode, Profile, read_profile
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.imaging.rendered_images import GREY, ImageRequest, Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.datasets.views import Intrinsics
from gateway.scene.draw.cameras import CameraError
from renderers.camera import Camera
from renderers.drawlist import AlphaMode, DrawList, Material
from renderers.interface import VTK_LOOKS, Look, Renderer
from renderers.light_rig import Rig
from renderers.stereo.depth.matching import ImagePair
from renderers.stereo.depth.metric_depth import millimetres_from_disparity
from renderers.stereo.model import Quality
from renderers.stereo.sensor.camera_image import NoiseStream
from scenegate.datasets.dataset import FLOW_MAGIC, UNKNOWN_FLOW

BASE_COLOR_LOOK: Final = Look(
    "studio", (0, 0, 0), 1, Rig(surroundings=None, scene_lights=False, auto_exposure=False, tone="none", shadow_size=0)
)
"""Look that shows unlit materials as they are."""


@lru_cache(maxsize=2)
def unlit(draw_list: DrawList, look: Look) -> DrawList:
    """Return a draw list of unlit materials, with the cut-outs that the depth image has under a look."""
    materials = {id(each.material): each.material for each in draw_list.instances}
    unlit_materials = {key: _unlit_material(material, look) for key, material in materials.items()}
    instances = tuple(replace(each, material=unlit_materials[id(each.material)]) for each in draw_list.instances)
    return DrawList(instances, draw_list.images)


def _unlit_material(material: Material, look: Look) -> Material:
    """Return a material that shows the base colour on both sides."""
    mode, cutoff = material.alpha_mode, material.alpha_cutoff
    if look.name in VTK_LOOKS or (mode is AlphaMode.BLEND and look.alpha_threshold == 0.0):
        mode = AlphaMode.OPAQUE
    elif mode is AlphaMode.BLEND:
        mode, cutoff = AlphaMode.MASK, look.alpha_threshold
    return replace(material, unlit=True, alpha_mode=mode, alpha_cutoff=cutoff, double_sided=True)


def right_camera(camera: Camera, baseline: float) -> Camera:
    """Return the right camera of a rectified pair, given the left one and the distance in metres."""
    X_world_right = camera.X_world_camera.copy()
    X_world_right[:3, 3] += baseline * X_world_right[:3, 0]
    return replace(camera, X_world_camera=X_world_right)


def instance_motions(scene: DrawList, camera: Camera, next_scene: DrawList, next_camera: Camera) -> NDArray[np.float64]:
    """Return the transform of each instance from the frame of a camera to that of the next one, (I + 1, 4, 4).

    The scenes have the same instances. The last transform is for pixels without an instance. An instance that is flat,
    and has no inverse, counts as at rest.
    """
    motions = np.tile(np.eye(4), (len(scene.instances) + 1, 1, 1))
    for index, (now, then) in enumerate(zip(scene.instances, next_scene.instances, strict=True)):
        if now.X_world_mesh is not then.X_world_mesh and abs(np.linalg.det(now.X_world_mesh[:3, :3])) > 0.0:
            motions[index] = then.X_world_mesh @ np.linalg.inv(now.X_world_mesh)
    return np.asarray(next_camera.X_camera_world @ motions @ camera.X_world_camera)


def flow_between(
    depth: NDArray[np.float32], camera: Camera, next_camera: Camera, X_next_camera: NDArray[np.float64] | None = None
) -> NDArray[np.float32]:
    """Return the flow from one camera to the next, (H, W, 2): pixels to the right and down.

    Surfaces that the next camera does not see, because others hide them or they are outside of its image, have a flow,
    too. It is NaN for the background and for what is behind the next camera.

    Args:
        depth: depth image of ``camera``, (H, W), in metres.
        X_next_camera: transform from the frame of ``camera`` to that of ``next_camera`` for the surface in each pixel,
            (H, W, 4, 4); None: the scene is at rest.
    """
    columns = np.arange(camera.width) + 0.5
    rows = np.arange(camera.height)[:, None] + 0.5
    X = next_camera.X_camera_world @ camera.X_world_camera if X_next_camera is None else X_next_camera
    z = depth.astype(np.float64) + camera.depth_origin
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        x, y = (columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z
        next_x, next_y, next_z = (
            X[..., k, 0] * x + X[..., k, 1] * y + X[..., k, 2] * z + X[..., k, 3] for k in range(3)
        )
        next_z[~(next_z > 0.0)] = np.nan
        u = next_camera.fx * next_x / next_z + next_camera.cx - columns
        v = next_camera.fy * next_y / next_z + next_camera.cy - rows
    flow = np.stack((u, v), axis=-1)
    flow[~np.isfinite(flow).all(axis=-1)] = np.nan
    return flow.astype(np.float32)


def flow_file(flow: NDArray[np.float32]) -> bytes:
    """Return a flow file of the Middlebury benchmark (.flo). NaN becomes a number beyond ``UNKNOWN_FLOW``."""
    height, width = flow.shape[:2]
    values = np.nan_to_num(flow, nan=10.0 * UNKNOWN_FLOW)
    return struct.pack("<fii", FLOW_MAGIC, width, height) + values.astype("<f4").tobytes()


@lru_cache(maxsize=4)
def cached_profile(name: str) -> Profile:
    """Return a camera profile; raises ProfileError."""
    return read_profile(name)


def intrinsics_of(profile: Profile) -> Intrinsics:
    """Return size and lens of the left camera of a profile, for the views of a dataset."""
    k = profile.model.intrinsics()
    return Intrinsics(k.width, k.height, fy=k.focal_length, cx=k.cx, cy=k.cy)


def measured_depth(
    renderer: Renderer,
    profile: Profile,
    depth_mode: DepthMode,
    scene: DrawList,
    camera: Camera,
    look: Look,
    noise_seed: int,
) -> NDArray[np.uint16]:
    """Return depth as the stereo camera of a profile measures it.

    It is along the optical axis, (H, W) uint16, in millimetres; 0: not measured. The camera has the default parameters
    of its profile, at the full resolution.

    Args:
        depth_mode: source of the depth.
        camera: left camera; has the lens of the profile.
        look: background, and what is cut out.
        noise_seed: seed of the noise.

    Raises:
        CameraError: the camera has another lens.
    """
    k = profile.model.intrinsics()
    expected = (k.width, k.height, k.focal_length, k.focal_length, k.cx, k.cy)
    lens = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
    if not np.allclose(lens, expected, rtol=1e-9):
        raise CameraError("measured images need views with the size and lens of --stereo-profile")
    config = StereoConfig.of_profile(profile)
    config = replace(
        config,
        depth_mode=depth_mode,
        seed=noise_seed,
        background=look.background,
        alpha_threshold=look.alpha_threshold,
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
