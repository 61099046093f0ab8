"""Affine and rigid transforms: (4, 4) float64, row-major, ``p_parent = R p_local + t``; quaternions [w, x, y, z]."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
"""(4, 4) float64."""


def _identity() -> Matrix:
    matrix = np.eye(4)
    matrix.flags.writeable = False
    return matrix


IDENTITY: Final[Matrix] = _identity()
"""(4, 4) float64, read-only; compare by ``is`` to skip work."""


def from_pose(translation: Sequence[float], quaternion: Sequence[float]) -> Matrix:
    """A rigid transform.

    Args:
        translation: (3,) metres.
        quaternion: (4,) [w, x, y, z]; normalised here, all zeros means no rotation (as Director does).
    """
    w, x, y, z = quaternion
    norm2 = w * w + x * x + y * y + z * z
    s = 2.0 / norm2 if norm2 > 0.0 and math.isfinite(norm2) else 0.0
    if s == 0.0 and norm2 != 0.0 and math.isfinite(max(map(abs, quaternion))):
        scale = max(abs(w), abs(x), abs(y), abs(z))
        return from_pose(translation, (w / scale, x / scale, y / scale, z / scale))
    wx, wy, wz = s * w * x, s * w * y, s * w * z
    xx, xy, xz = s * x * x, s * x * y, s * x * z
    yy, yz, zz = s * y * y, s * y * z, s * z * z
    tx, ty, tz = translation
    return np.array(
        (
            (1.0 - (yy + zz), xy - wz, xz + wy, tx),
            (xy + wz, 1.0 - (xx + zz), yz - wx, ty),
            (xz - wy, yz + wx, 1.0 - (xx + yy), tz),
            (0.0, 0.0, 0.0, 1.0),
        )
    )


def translation(x: float, y: float, z: float) -> Matrix:
    """A pure translation, metres."""
    matrix = np.eye(4)
    matrix[:3, 3] = (x, y, z)
    return matrix


def scaling(x: float, y: float, z: float) -> Matrix:
    """A scale along the axes."""
    return np.diag((x, y, z, 1.0))


def from_column_major(values: Sequence[float]) -> Matrix:
    """A matrix from glTF's 16 column-major numbers."""
    return np.array(values, dtype=np.float64).reshape(4, 4).T.copy()


def from_trs(translation: Sequence[float], rotation_xyzw: Sequence[float], scale: Sequence[float]) -> Matrix:
    """glTF's node properties: T * R * S, the rotation as glTF writes it ([x, y, z, w])."""
    x, y, z, w = rotation_xyzw
    matrix = from_pose(translation, (w, x, y, z))
    matrix[:3, :3] *= np.asarray(scale, dtype=np.float64)
    return matrix


def look_at(eye: Sequence[float], target: Sequence[float], up: Sequence[float]) -> Matrix:
    """Pose of an optical frame (+Z forward, +X right, +Y down) at ``eye`` that sees ``target`` with ``up`` upwards.

    Raises:
        ValueError: eye and target coincide. An ``up`` along the line of sight is replaced by another axis.
    """
    e, t = np.asarray(eye, dtype=np.float64), np.asarray(target, dtype=np.float64)
    forward = t - e
    distance = float(np.linalg.norm(forward))
    if not distance > 0.0:
        raise ValueError("camera eye and target coincide")
    forward /= distance
    for candidate in (np.asarray(up, dtype=np.float64), np.array((0.0, 0.0, 1.0)), np.array((0.0, 1.0, 0.0))):
        right = np.cross(forward, candidate)
        length = float(np.linalg.norm(right))
        if length > 1e-9 * max(1.0, float(np.linalg.norm(candidate))):
            break
    right /= length
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = right, np.cross(forward, right), forward, e
    return matrix


Y_UP_TO_Z_UP: Final[Matrix] = np.array(
    ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
)
"""+90 degrees about X: glTF's Y-up world into our Z-up world."""
