"""Affine and rigid transforms: (4, 4) float64, row-major, ``p_parent = R p_local + t``; quaternions [w, x, y, z]."""

import math
from collections.abc import Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
"""(4, 4) float64."""
Vector: TypeAlias = Sequence[float] | NDArray[Any]
"""A few numbers."""


def _identity() -> Matrix:
    matrix = np.eye(4)
    matrix.flags.writeable = False
    return matrix


IDENTITY: Final[Matrix] = _identity()
"""(4, 4) float64, read-only. A matrix that ``is IDENTITY`` need not be multiplied."""

SAFE_SQUARED_NORMS: Final = (1e-200, 1e200)
"""Range of squared norms for which a quaternion is normalised without underflow or overflow."""
_FAR: Final = (1e3, 1e12)
"""Range of the largest coordinate of shapes that ``origin_amid`` looks at."""
_COARSEST_STEP: Final = 1e-5
"""Largest step of float32 coordinates, as a share of a shape's length."""
_FEW: Final = 64
"""Number of coordinates up to which a list is faster than an array."""


def from_pose(translation: Vector, quaternion: Vector) -> Matrix:
    """Return a rigid transform of (3,) metres and (4,) [w, x, y, z] of any length.

    A quaternion of zeros means no rotation, as in Director. Non-finite numbers give a non-finite matrix.
    """
    w, x, y, z = quaternion
    squared_norm = w * w + x * x + y * y + z * z
    if not SAFE_SQUARED_NORMS[0] < squared_norm < SAFE_SQUARED_NORMS[1] and all(map(math.isfinite, quaternion)):
        scale = max(abs(w), abs(x), abs(y), abs(z))
        if scale > 0.0:
            w, x, y, z = w / scale, x / scale, y / scale, z / scale
            squared_norm = w * w + x * x + y * y + z * z
    s = 2.0 / squared_norm if squared_norm > 0.0 else squared_norm
    wx, wy, wz = s * w * x, s * w * y, s * w * z
    xx, xy, xz = s * x * x, s * x * y, s * x * z
    yy, yz, zz = s * y * y, s * y * z, s * z * z
    tx, ty, tz = translation
    rows = (
        (1.0 - (yy + zz), xy - wz, xz + wy, tx),
        (xy + wz, 1.0 - (xx + zz), yz - wx, ty),
        (xz - wy, yz + wx, 1.0 - (xx + yy), tz),
        (0.0, 0.0, 0.0, 1.0),
    )
    return np.array(rows)


def is_rotation(R: NDArray[np.float64], tolerance: float) -> bool:
    """Return True if R, (3, 3), is a rotation: R^T R is the identity to a tolerance, and R does not mirror."""
    return bool((np.abs(R.T @ R - np.eye(3)) <= tolerance).all()) and float(np.linalg.det(R)) > 0.0


def quaternions_of(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit quaternions [w, x, y, z], (N, 4), of rotation matrices, (N, 3, 3), by Shepperd's method (1978).

    Each row of the matrix below is a multiple of the quaternion. The row with the largest diagonal element is used.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R.transpose(1, 2, 0)
    rows = np.array(
        (
            (1.0 + xx + yy + zz, zy - yz, xz - zx, yx - xy),
            (zy - yz, 1.0 + xx - yy - zz, xy + yx, xz + zx),
            (xz - zx, xy + yx, 1.0 - xx + yy - zz, yz + zy),
            (yx - xy, xz + zx, yz + zy, 1.0 - xx - yy + zz),
        )
    ).transpose(2, 0, 1)
    largest = np.argmax(rows.diagonal(axis1=1, axis2=2), axis=1)
    q = rows[np.arange(len(rows)), largest]
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def rotation_from_z(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shortest rotation from z to a unit vector, (3, 3); for -z, half a turn about x."""
    x, y, z = normal.tolist()
    sine_squared = x * x + y * y
    if sine_squared == 0.0:
        return np.diag((1.0, z, z))
    k = 1.0 / (1.0 + z) if z > 0.0 else (1.0 - z) / sine_squared  # equal; neither cancels digits
    return np.array(((1.0 - k * x * x, -k * x * y, x), (-k * x * y, 1.0 - k * y * y, y), (-x, -y, z)))


def translation(x: float, y: float, z: float) -> Matrix:
    """Return a translation, metres."""
    matrix = np.eye(4)
    matrix[:3, 3] = (x, y, z)
    return matrix


def scaling(x: float, y: float, z: float) -> Matrix:
    """Return a scale along the axes."""
    return np.diag((x, y, z, 1.0))


def origin_amid(positions: NDArray[Any]) -> tuple[float, float, float]:
    """Return a point amid positions, (N, 3), if float32 would tear their shape, as that of a survey; else (0, 0, 0)."""
    nowhere = 0.0, 0.0, 0.0
    if positions.dtype.char == "f" or not positions.size:  # float32
        return nowhere
    if positions.size <= _FEW and max(map(abs, positions.ravel().tolist())) <= _FAR[0]:
        return nowhere
    largest = max(float(positions.max()), -float(positions.min()))
    if np.isnan(largest):  # these are slower
        largest = max(np.fmax.reduce(positions, axis=None), -np.fmin.reduce(positions, axis=None))
    if largest <= _FAR[0]:
        return nowhere
    columns = np.array(positions.T, np.float64, order="C")  # ten times as fast as reductions along axis 0
    columns[np.isinf(columns)] = np.nan
    low, high = np.fmin.reduce(columns, axis=1), np.fmax.reduce(columns, axis=1)
    largest = max(high.max(), -low.min())
    if not _FAR[0] < largest < _FAR[1] or np.spacing(np.float32(largest)) <= _COARSEST_STEP * (high - low).max():
        return nowhere
    x, y, z = np.rint(0.5 * (low + high)).tolist()
    return x, y, z
