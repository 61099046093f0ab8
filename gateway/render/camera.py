"""Camera of a render request: intrinsics from the form, the pose from the scene's camera node."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.render.errors import RequestError
from gateway.render.form import RenderRequest
from gateway.render.scenes import PreparedScene
from renderers.camera import OPENGL_FROM_OPTICAL, Camera

_NEAR_FAR_RATIO: Final = 1e-6
"""Ratio of near to far plane, used if neither the form nor the scene's camera has a near plane."""
_MIN_NEAR: Final = 1e-9
"""Minimum near plane, metres: with it, the rasterizer's 1/z fits float32. It is less than ``form.MIN_FAR``."""
_MAX_COORDINATE: Final = 1e12
"""Maximum coordinate of the camera, metres. Larger float64 coordinates do not resolve millimetres."""
_RIGID_TOLERANCE: Final = 1e-6
"""Maximum error of a rotation matrix that is used unchanged: the rounding error of numbers with six digits."""
_MIN_ANGLE: Final = 1e-9
"""Minimum angle between up and the line of sight, radians. With a smaller angle the pose is singular."""
_NO_CAMERA: Final = (
    "the scene has geometry but no camera: Drake's client leaves the camera out when everything with a perception role "
    "is a glTF mesh. Add any other geometry with a perception role (a Box, Sphere or OBJ mesh, as small as you like) "
    "to the SceneGraph; other clients: add a 'cameras' entry and a node with \"camera\": 0, "
    "or export the live scene with one: /scene.glb?camera=fit"
)


def camera_of(request: RenderRequest, scene: PreparedScene) -> Camera:
    """Return the camera of a request.

    A scene without camera and geometry is seen from the origin along -Z: the pose of a glTF camera with the identity as
    transform.

    Raises:
        RequestError: There is geometry but no camera, or the node's transform is singular.
    """
    camera = scene.camera
    if camera is None and scene.has_geometry:
        raise RequestError(400, _NO_CAMERA)
    near = request.near
    if near == 0.0:  # the client formats small numbers as 0 (std::to_string); the scene's camera has all digits
        znear = camera.znear if camera is not None else 0.0
        near = znear if 0.0 < znear < request.far else request.far * _NEAR_FAR_RATIO
    return Camera(
        width=request.width,
        height=request.height,
        fx=request.focal_x,
        fy=request.focal_y,
        cx=request.center_x,
        cy=request.center_y,
        near=max(near, _MIN_NEAR),
        far=request.far,
        X_world_camera=OPENGL_FROM_OPTICAL if camera is None else rigid_pose(camera.X_world_camera, camera.name),
    )


def rigid_pose(X: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Return a rigid pose with the position and line of sight of a transform, since camera nodes may have a scale.

    As in VTK, the image's up direction is the part of the transform's up axis that is orthogonal to the line of sight.

    Args:
        X: (4, 4) float64, transform from the optical frame to the world.
        name: Name of the node, for messages.

    Raises:
        RequestError: The transform is singular, or too far from the origin.
    """
    linear, position = X[:3, :3], X[:3, 3]
    if not (np.abs(position) <= _MAX_COORDINATE).all():
        raise RequestError(400, f"scene: the camera node {name!r} is farther than {_MAX_COORDINATE:g} m away")
    if np.isfinite(X).all():
        with np.errstate(all="ignore"):
            deviation = np.abs(linear.T @ linear - np.eye(3)).max()
            if deviation < _RIGID_TOLERANCE and np.linalg.det(linear) > 0.0:
                return X
            forward = linear[:, 2] / np.linalg.norm(linear[:, 2])
            down = linear[:, 1] / np.linalg.norm(linear[:, 1])
            down -= forward * (forward @ down)
            length = np.linalg.norm(down)
            if length > _MIN_ANGLE:
                down /= length
                pose = np.eye(4)
                pose[:3] = np.column_stack((np.cross(down, forward), down, forward, position))
                if np.linalg.det(pose[:3, :3]) > 0.5:  # 0 or NaN where a length overflowed
                    return pose
    raise RequestError(400, f"scene: the transform of the camera node {name!r} is singular")
