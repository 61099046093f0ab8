"""Cameras in words, orbits and poses as cameras in a scene: their poses and clipping planes."""

from __future__ import annotations

import json
import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.bounds import Bounds, corners_of, focus_bounds, loose_bounds, world_matrix
from gateway.scene.cameras import (
    DEFAULT_FOVY,
    LIMIT,
    MIN_FOVY,
    CameraError,
    CameraSpec,
    FitCamera,
    NodeCamera,
    NoSuchCameraError,
    OrbitCamera,
    PoseCamera,
    StereoCamera,
    Vector,
    quoted,
)
from gateway.scene.flatten import flatten
from gateway.scene.transforms import look_at
from gateway.scene.tree import Node, Path
from renderers.camera import Camera
from renderers.drawlist import DrawList

FIT_DIRECTION: Final = (1.0, -1.0, 0.8)
"""Direction from the scene's centre to the eye: front right and above, for robots that face +x."""
FIT_MARGIN: Final = 1.05
"""Half height of the image over that of the framed box."""


def resolve_camera(
    spec: CameraSpec | OrbitCamera | PoseCamera,
    root: Node,
    width: int,
    height: int,
    *,
    fovy: float = DEFAULT_FOVY,
    near: float | None = None,
    far: float | None = None,
    stereo: Camera | None = None,
    drawn: DrawList | None = None,
) -> Camera:
    """Return a camera in a scene for an image of a size.

    Args:
        spec: Result of ``parse_camera``, or an orbit or pose.
        root: The tree, for ``path`` and for framing.
        width, height: Pixels.
        fovy: Vertical field of view in degrees where the text has none.
        near, far: Clipping planes, metres; None: chosen so that the whole scene lies between them.
        stereo: Current left camera of the stereo sensor, of any size; None without such a sensor.
        drawn: The tree's draw list, if the caller has it.

    Raises:
        NoSuchCameraError: No such node, or no stereo camera.
        CameraError: A node's frame is not invertible, or the size or planes are invalid.
    """
    if not MIN_FOVY <= fovy < 180.0:
        raise CameraError(f"fovy {fovy:g} must be at least {MIN_FOVY:g} and less than 180 degrees")
    if isinstance(spec, StereoCamera):
        if stereo is None:
            raise NoSuchCameraError("camera 'stereo': this gateway runs no stereo camera")
        return _resized(stereo, width, height, near, far)
    scene = flatten(root) if drawn is None else drawn
    if isinstance(spec, FitCamera):
        pose = _fit(focus_bounds(scene), fovy, width / height, FIT_DIRECTION)
    elif isinstance(spec, OrbitCamera):
        pose = _on_orbit(focus_bounds(scene), fovy, width / height, spec)
    elif isinstance(spec, PoseCamera):
        pose = spec.X_world_camera
    elif isinstance(spec, NodeCamera):
        pose = _node_pose(root, spec.path)
    else:
        try:
            pose = look_at(spec.eye, spec.target, spec.up)
        except ValueError as error:  # points so close that their distance rounds to 0
            raise CameraError(str(error)) from None
        fovy = fovy if spec.fovy is None else spec.fovy
    lens = 0.5 * height / math.tan(math.radians(0.5 * fovy))
    near, far = _clipped(near, far, _planes(loose_bounds(scene), pose))
    return _camera(width, height, lens, lens, width / 2, height / 2, near, far, pose)


def _clipped(near: float | None, far: float | None, chosen: tuple[float, float]) -> tuple[float, float]:
    """Return the given clipping planes, else the chosen ones, moved where they conflict with a given one."""
    chosen_near, chosen_far = chosen
    if near is None:
        return (chosen_near if far is None else min(chosen_near, 0.5 * far)), far or chosen_far
    return near, (far or max(chosen_far, 2.0 * near))


def _camera(
    width: int,
    height: int,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    near: float,
    far: float,
    pose: NDArray[np.float64],
) -> Camera:
    try:
        return Camera(width, height, fx, fy, cx, cy, near, far, pose)
    except ValueError as error:
        raise CameraError(f"camera: {error}") from error


def _resized(stereo: Camera, width: int, height: int, near: float | None, far: float | None) -> Camera:
    """Return the sensor's camera at another size: the same horizontal field of view, square pixels stay square."""
    scale = width / stereo.width
    near, far = _clipped(near, far, (stereo.near, stereo.far))
    return _camera(
        width,
        height,
        stereo.fx * scale,
        stereo.fy * scale,
        stereo.cx * scale,
        0.5 * height + (stereo.cy - 0.5 * stereo.height) * scale,
        near,
        far,
        stereo.X_world_camera,
    )


def _node_pose(root: Node, path: Path) -> NDArray[np.float64]:
    """Return the node's frame without scale and shear. The forward axis is kept, then the right one."""
    text = json.dumps(list(path))
    world = world_matrix(root, path)
    if world is None:
        raise NoSuchCameraError(f"camera path {quoted(text)}: there is no such node")
    z, x = world[:3, 2], world[:3, 0]
    with np.errstate(all="ignore"):
        z = z / np.linalg.norm(z)
        x = x - z * (x @ z)
        x = x / np.linalg.norm(x)
    if not (np.isfinite(z).all() and np.isfinite(x).all() and (np.abs(world[:3, 3]) <= LIMIT).all()):
        raise CameraError(f"camera path {quoted(text)}: the node's world transform has no usable axes")
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = x, np.cross(z, x), z, world[:3, 3]
    return pose


def _fit(
    bounds: Bounds | None, fovy: float, aspect: float, direction: Vector, distance: float | None = None
) -> NDArray[np.float64]:
    """Return a pose in a direction from the box's centre; without a distance, the nearest one that sees all corners."""
    box = np.array(((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))) if bounds is None else bounds
    centre = box.mean(axis=0)
    unit = np.array(direction) / np.linalg.norm(direction)
    pose = look_at(centre + unit, centre, (0.0, 0.0, 1.0))
    if distance is None:
        x, y, z = ((corners_of(box) - centre) @ pose[:3, :3]).T
        tan_y = math.tan(math.radians(0.5 * fovy)) / FIT_MARGIN
        reach = np.maximum(np.abs(x) / (tan_y * aspect), np.abs(y) / tan_y)
        distance = max(float((reach - z).max()), float(np.abs(box).max()) * 1e-6, 1e-6)
    pose[:3, 3] = centre + unit * distance
    return pose


def _on_orbit(bounds: Bounds | None, fovy: float, aspect: float, orbit: OrbitCamera) -> NDArray[np.float64]:
    box = np.array(((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))) if bounds is None else bounds
    distance = _orbit_radius(box.tobytes(), fovy, aspect, orbit.count, orbit.elevation)
    return _fit(box, fovy, aspect, _around(orbit.index / orbit.count, orbit.elevation), distance)


@lru_cache(maxsize=64)
def _orbit_radius(bounds: bytes, fovy: float, aspect: float, count: int, elevation: float) -> float:
    """Return the distance from which each camera of an orbit has all corners in view.

    Cached, because every camera of the orbit needs it.

    Args:
        bounds: Bytes of a (2, 3) float64 box.
    """
    box = np.frombuffer(bounds).reshape(2, 3)
    poses = (_fit(box, fovy, aspect, _around(index / count, elevation)) for index in range(count))
    return max(float(np.linalg.norm(pose[:3, 3] - box.mean(axis=0))) for pose in poses)


def _around(turn: float, elevation: float) -> Vector:
    """Return the direction from the centre to the eye after a fraction of a turn, counter-clockwise from +x."""
    angle, height = 2.0 * math.pi * turn, math.radians(elevation)
    return math.cos(angle) * math.cos(height), math.sin(angle) * math.cos(height), math.sin(height)


def _planes(bounds: Bounds | None, pose: NDArray[np.float64]) -> tuple[float, float]:
    """Return clipping planes around the whole scene.

    Depth is stored as 1/z in floating point, so a near plane close to the eye costs no resolution. For a camera within
    the scene's box the near plane is at 1 cm, or at a thousandth of the far plane if that is less.
    """
    if bounds is None:
        return 0.01, 100.0
    depth = (corners_of(bounds) - pose[:3, 3]) @ pose[:3, 2]
    farthest, nearest = float(depth.max()), float(depth.min())
    far = max(1.01 * farthest, 1e-3)
    near = min(0.01, 1e-3 * far)
    return max(near, 0.5 * nearest), far
