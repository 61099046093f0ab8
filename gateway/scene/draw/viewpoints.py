"""Places cameras in a scene: computes pose, focal length and clipping planes."""

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.draw.bounds import Bounds, corners_of, focus_bounds, loose_bounds
from gateway.scene.draw.cameras import (
    DEFAULT_FOVY,
    MAX_COORDINATE,
    MIN_FOVY,
    CameraError,
    CameraSpec,
    FitCamera,
    LookAtCamera,
    NodeCamera,
    NoSuchCameraError,
    OrbitCamera,
    PoseCamera,
    StereoCamera,
    Vector,
    quoted,
)
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.nodes import Node, Path
from gateway.scene.tree.transforms import look_at
from renderers.camera import Camera
from renderers.drawlist import DrawList

FIT_DIRECTION: Final = (1.0, -1.0, 0.8)
"""Direction from the scene's centre to the eye: front right and above, for robots that face +x."""
FIT_MARGIN: Final = 1.05
"""Size of the field of view, relative to the smallest one that contains the scene's box."""

_EYE_DISTANCE: Final = 1000.0
"""Distance of the pinhole that stands for an orthographic camera, relative to the size of what it sees."""
_EMPTY_SCENE_BOX: Final = np.array(((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)))
"""Box that stands for the bounds of a scene that draws nothing, metres."""


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
    draw_list: DrawList | None = None,
) -> Camera:
    """Return the camera for an image of a scene; ``fovy``, in degrees, is for a spec without one.

    Planes are in metres; None: chosen so that the whole scene lies between them. ``stereo``: current left camera of the
    stereo sensor, of any size; None without such a sensor. ``draw_list``: the tree's, if the caller has it. Raises
    NoSuchCameraError if the node or the stereo camera does not exist; CameraError if a node's frame is not invertible,
    or a number is invalid.
    """
    if not MIN_FOVY <= fovy < 180.0:
        raise CameraError(f"fovy {fovy:g} must be at least {MIN_FOVY:g} and less than 180 degrees")
    if isinstance(spec, StereoCamera):
        if stereo is None:
            raise NoSuchCameraError("camera 'stereo': this gateway runs no stereo camera")
        return _resized(stereo, width, height, near, far)
    if draw_list is None:
        draw_list = flatten(root)
    if isinstance(spec, FitCamera):
        pose = _framing_pose(focus_bounds(draw_list), fovy, width / height, FIT_DIRECTION)
    elif isinstance(spec, OrbitCamera):
        box = focus_bounds(draw_list)
        box = _EMPTY_SCENE_BOX if box is None else box
        distance = _orbit_radius(box.tobytes(), fovy, width / height, spec.count, spec.elevation)
        direction = _orbit_direction(spec.index / spec.count, spec.elevation)
        pose = _framing_pose(box, fovy, width / height, direction, distance)
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
    if isinstance(spec, LookAtCamera) and spec.xmag is not None:
        return orthographic_camera(pose, width, height, spec.xmag, draw_list, near, far)
    focal_length = 0.5 * height / math.tan(math.radians(0.5 * fovy))
    near, far = _clipping_planes(near, far, _fitted_planes(loose_bounds(draw_list), pose))
    with _camera_errors():
        return Camera(width, height, focal_length, focal_length, width / 2, height / 2, near, far, pose)


def orthographic_camera(
    pose: NDArray[np.float64],
    width: int,
    height: int,
    xmag: float,
    draw_list: DrawList,
    near: float | None = None,
    far: float | None = None,
) -> Camera:
    """Return an orthographic camera: a pinhole far behind its pose, whose depth counts from the pose.

    Its distance is ``_EYE_DISTANCE`` times the size of what is seen. Farther away, depth in float32 would be coarser;
    nearer, the scale would depend more on the depth: it differs by 0.05 % at most. ``xmag``: half of the width of the
    image, metres. Planes: metres from the pose; None: the whole scene in front of it is seen. Raises CameraError.
    """
    nearest, farthest = _depth_range(loose_bounds(draw_list), pose) or (0.0, 0.0)
    near = 0.0 if near is None else near
    last_seen = max(farthest if far is None else min(farthest, far), near)
    first_seen = min(max(nearest, near), last_seen)
    far = 1.01 * last_seen + xmag if far is None else far
    distance = _EYE_DISTANCE * max(2.0 * xmag, last_seen - first_seen)
    X_world_eye = pose.copy()
    X_world_eye[:3, 3] -= distance * pose[:3, 2]
    focal_length = 0.5 * width / xmag * (distance + 0.5 * (first_seen + last_seen))
    near, far = distance + near, distance + far
    with _camera_errors():
        return Camera(
            width, height, focal_length, focal_length, width / 2, height / 2, near, far, X_world_eye, distance
        )


def _clipping_planes(near: float | None, far: float | None, fitted: tuple[float, float]) -> tuple[float, float]:
    """Return the near and far plane. The fitted plane replaces a missing one, and is moved if near >= far otherwise."""
    fitted_near, fitted_far = fitted
    if near is None:
        return (fitted_near, fitted_far) if far is None else (min(fitted_near, 0.5 * far), far)
    return near, max(fitted_far, 2.0 * near) if far is None else far


@contextmanager
def _camera_errors() -> Iterator[None]:
    """Raise CameraError for numbers that a camera cannot have."""
    try:
        yield
    except ValueError as error:
        raise CameraError(f"camera: {error}") from error


def _resized(stereo: Camera, width: int, height: int, near: float | None, far: float | None) -> Camera:
    """Return the sensor's camera for another image size, with the same horizontal field of view and pixel aspect."""
    scale = width / stereo.width
    near, far = _clipping_planes(near, far, (stereo.near, stereo.far))
    cy = 0.5 * height + (stereo.cy - 0.5 * stereo.height) * scale
    with _camera_errors():
        return Camera(
            width, height, stereo.fx * scale, stereo.fy * scale, stereo.cx * scale, cy, near, far, stereo.X_world_camera
        )


def _node_pose(root: Node, path: Path) -> NDArray[np.float64]:
    """Return the frame of a node in the world, without scale and shear.

    Shear is removed from the axes in this order: the forward axis keeps its direction, the right axis becomes
    orthogonal to it, and the down axis orthogonal to both.
    """
    text = json.dumps(list(path))
    world = root.world_matrix(path)
    if world is None:
        raise NoSuchCameraError(f"camera path {quoted(text)}: there is no such node")
    z, x = world[:3, 2], world[:3, 0]
    with np.errstate(all="ignore"):
        z = z / np.linalg.norm(z)
        x = x - z * (x @ z)
        x = x / np.linalg.norm(x)
    if not (np.isfinite(z).all() and np.isfinite(x).all() and (np.abs(world[:3, 3]) <= MAX_COORDINATE).all()):
        raise CameraError(f"camera path {quoted(text)}: the node's world transform has no usable axes")
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = x, np.cross(z, x), z, world[:3, 3]
    return pose


def _framing_pose(
    bounds: Bounds | None, fovy: float, aspect: float, direction: Vector, distance: float | None = None
) -> NDArray[np.float64]:
    """Return a pose that looks from a direction at the centre of a box (None: ``_EMPTY_SCENE_BOX``).

    ``fovy`` is in degrees. ``distance``: metres; None: the smallest one that has all corners in view.
    """
    box = _EMPTY_SCENE_BOX if bounds is None else bounds
    centre = box.mean(axis=0)
    unit = np.array(direction) / np.linalg.norm(direction)
    pose = look_at(centre + unit, centre, (0.0, 0.0, 1.0))
    if distance is None:
        x, y, z = ((corners_of(box) - centre) @ pose[:3, :3]).T  # in the camera's axes
        tangent = math.tan(math.radians(0.5 * fovy)) / FIT_MARGIN
        min_depth = np.maximum(np.abs(x) / (tangent * aspect), np.abs(y) / tangent)
        distance = max(float((min_depth - z).max()), float(np.abs(box).max()) * 1e-6, 1e-6)
    pose[:3, 3] = centre + unit * distance
    return pose


@lru_cache(maxsize=64)
def _orbit_radius(bounds: bytes, fovy: float, aspect: float, count: int, elevation: float) -> float:
    """Return the distance from which every camera of an orbit has all corners of a box in view.

    The result is cached, because every camera of the orbit needs it. ``bounds``: bytes of the box, (2, 3) float64.
    ``fovy``: degrees. ``count``, ``elevation``: as in ``OrbitCamera``.
    """
    box = np.frombuffer(bounds).reshape(2, 3)
    poses = (_framing_pose(box, fovy, aspect, _orbit_direction(index / count, elevation)) for index in range(count))
    return max(float(np.linalg.norm(pose[:3, 3] - box.mean(axis=0))) for pose in poses)


def _orbit_direction(turn: float, elevation: float) -> Vector:
    """Return the direction from the centre to the eye: fraction of a turn from +x, and degrees above the horizon."""
    azimuth, altitude = 2.0 * math.pi * turn, math.radians(elevation)
    return math.cos(azimuth) * math.cos(altitude), math.sin(azimuth) * math.cos(altitude), math.sin(altitude)


def _fitted_planes(bounds: Bounds | None, pose: NDArray[np.float64]) -> tuple[float, float]:
    """Return a near and a far plane with the whole scene between them; None: the scene draws nothing.

    For a camera inside the scene's box, the near plane is at 1 cm, or at a thousandth of the far plane if that is less.
    A near plane so close to the eye costs no resolution, because depth is stored as 1/z in floating point.
    """
    depths = _depth_range(bounds, pose)
    if depths is None:
        return 0.01, 100.0
    nearest, farthest = depths
    far = max(1.01 * farthest, 1e-3)
    near = min(0.01, 1e-3 * far)
    return max(near, 0.5 * nearest), far


def _depth_range(bounds: Bounds | None, pose: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the smallest and largest depth of a box along a camera's optical axis, metres; None without a box."""
    if bounds is None:
        return None
    depths = (corners_of(bounds) - pose[:3, 3]) @ pose[:3, 2]
    return float(depths.min()), float(depths.max())
