"""Materials, cameras and motion of ``albedo``, ``stereo`` and ``flow`` images."""

import struct
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import AlphaMode, DrawList, Material
from renderers.interface import VTK_LOOKS, Look
from renderers.light_rig import Rig
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
    too. It is NaN for the background and for what is behind the next camera. ``depth`` is an image of ``camera``, (H,
    W), in metres. ``X_next_camera``, (H, W, 4, 4), leads from the frame of ``camera`` to that of ``next_camera`` for
    the surface in each pixel; None: the scene is at rest.
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
