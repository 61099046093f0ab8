"""Affine and rigid transforms: (4, 4) float64, row-major, ``p_parent = R p_local + t``; quaternions [w, x, y, z]."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from scenegate.transforms import IDENTITY as IDENTITY
from scenegate.transforms import SAFE_SQUARED_NORMS as SAFE_SQUARED_NORMS
from scenegate.transforms import Matrix as Matrix
from scenegate.transforms import from_pose as from_pose
from scenegate.transforms import is_rotation as is_rotation
from scenegate.transforms import quaternions_of as quaternions_of
from scenegate.transforms import scaling as scaling
from scenegate.transforms import translation as translation


def from_poses(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``from_pose`` of poses, (N, 7), as (N, 4, 4); the results are bit-identical."""
    w, x, y, z = poses[:, 3:].T
    with np.errstate(all="ignore"):
        squared_norm = w * w + x * x + y * y + z * z
        if not ((squared_norm > SAFE_SQUARED_NORMS[0]) & (squared_norm < SAFE_SQUARED_NORMS[1])).all():
            return np.array([from_pose(pose[:3], pose[3:]) for pose in poses.tolist()]).reshape(-1, 4, 4)
        s = 2.0 / squared_norm
        sw, sx, sy, sz = s * w, s * x, s * y, s * z
    matrices = np.zeros((len(poses), 4, 4))
    matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 0, 2] = 1.0 - (sy * y + sz * z), sx * y - sw * z, sx * z + sw * y
    matrices[:, 1, 0], matrices[:, 1, 1], matrices[:, 1, 2] = sx * y + sw * z, 1.0 - (sx * x + sz * z), sy * z - sw * x
    matrices[:, 2, 0], matrices[:, 2, 1], matrices[:, 2, 2] = sx * z - sw * y, sy * z + sw * x, 1.0 - (sx * x + sy * y)
    matrices[:, :3, 3] = poses[:, :3]
    matrices[:, 3, 3] = 1.0
    return matrices


def affine_product(X: NDArray[np.float64], Y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return X @ Y of affine matrices, (N, 4, 4), bit-identical on every CPU, unlike NumPy's product."""
    product = np.empty(X.shape)
    product[:, :3] = X[:, :3, 0:1] * Y[:, 0:1] + X[:, :3, 1:2] * Y[:, 1:2] + X[:, :3, 2:3] * Y[:, 2:3]
    product[:, :3, 3] += X[:, :3, 3]
    product[:, 3] = IDENTITY[3]
    return product


def look_at(
    eye: Sequence[float] | NDArray[np.float64], target: Sequence[float] | NDArray[np.float64], up: Sequence[float]
) -> Matrix:
    """Return the pose of an optical frame (+Z forward, +X right, +Y down) at ``eye`` that looks at ``target``.

    ``up``, or +z or +y if that is along the line of sight, is up in the image. Raises ValueError if both coincide.
    """
    position = np.asarray(eye, dtype=np.float64)
    forward = np.asarray(target, dtype=np.float64) - position
    distance = float(np.linalg.norm(forward))
    if not distance > 0.0:
        raise ValueError("camera eye and target coincide")
    forward /= distance
    for up_axis in (np.asarray(up, dtype=np.float64), np.array((0.0, 0.0, 1.0)), np.array((0.0, 1.0, 0.0))):
        right = np.cross(forward, up_axis)
        length = float(np.linalg.norm(right))
        if length > 1e-9 * max(1.0, float(np.linalg.norm(up_axis))):
            break
    right /= length
    matrix = np.eye(4)
    matrix[:3] = np.column_stack((right, np.cross(forward, right), forward, position))
    return matrix


Y_UP_TO_Z_UP: Final[Matrix] = np.array(
    ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
)
"""Rotation by +90 degrees about X, from glTF's Y-up world to our Z-up world."""
