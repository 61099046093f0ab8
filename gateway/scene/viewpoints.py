"""Cameras in words, orbits and poses as cameras in a scene: where they stand, and how far they see."""

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
"""From the scene's middle to the eye: from the front right and above, for robots that face +x."""
FIT_MARGIN: Final = 1.05
"""The picture's half height over that of the framed box."""


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
    """The camera that a text means in a scene, at a picture size.

    Args:
        spec: from ``parse_camera``, or one that no text can mean.
        root: the tree; needed for ``path`` and for framing.
        width, height: pixels.
        fovy: vertical field of view in degrees where the text names none.
        near, far: clipping planes in metres; None: chosen so that the whole scene is in between.
        stereo: the left camera of the stereo sensor as it is now, of any size; None: there is no such sensor.
        drawn: the tree's draw list when the caller has it already.

    Raises:
        NoSuchCameraError: no such node, or no stereo camera.
        CameraError: a node's frame is not invertible, bad size or planes.
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
    """Clipping planes as given, else as chosen; a given one beyond the chosen other moves that one."""
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
    """The sensor's camera at another size: the same horizontal field of view, square pixels stay square."""
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
    """The node's frame without its scale and shear: forward is kept, then right."""
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
    """A pose in a direction from the box's middle; ``distance`` None: just so far that all its corners are in view."""
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
    """The distance from which each camera of an orbit has all corners in view; remembered, since all of them ask.

    Args:
        bounds: the bytes of a (2, 3) float64 box.
    """
    box = np.frombuffer(bounds).reshape(2, 3)
    poses = (_fit(box, fovy, aspect, _around(index / count, elevation)) for index in range(count))
    return max(float(np.linalg.norm(pose[:3, 3] - box.mean(axis=0))) for pose in poses)


def _around(turn: float, elevation: float) -> Vector:
    """The direction from the middle to the eye after a part of a turn, counter-clockwise from +x."""
    angle, height = 2.0 * math.pi * turn, math.radians(elevation)
    return math.cos(angle) * math.cos(height), math.sin(angle) * math.cos(height), math.sin(height)


def _planes(bounds: Bounds | None, pose: NDArray[np.float64]) -> tuple[float, float]:
    """Clipping planes around the whole scene as seen from a pose.

    Depth is kept as a float of 1/z, so a near plane close to the eye costs no resolution: a camera within the scene's
    box (above a ground of 100 m, say) sees from 1 cm, or from a thousandth of the scene if that is less.
    """
    if bounds is None:
        return 0.01, 100.0
    depth = (corners_of(bounds) - pose[:3, 3]) @ pose[:3, 2]
    farthest, nearest = float(depth.max()), float(depth.min())
    far = max(1.01 * farthest, 1e-3)
    near = min(0.01, 1e-3 * far)
    return max(near, 0.5 * nearest), far
