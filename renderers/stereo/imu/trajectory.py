"""Smooth path of a camera from poses at single points in time.

Poses arrive 10 to 100 times per second, with a jitter of milliseconds. Two steps make a path of them that can be
differentiated twice:

1. ``interpolate``: cubic Hermite splines through the poses.
2. ``smooth_path``: a low-pass filter over ±``HALF_WIDTH`` seconds. It keeps polynomials up to the third degree, so that
   constant velocity and acceleration are exact.

The result is sampled at twice the IMU's rate, because an angular velocity needs the orientations half a period before
and after its sample.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

GRID_RATE: Final = 400
"""Samples of the path per second."""
MAX_STEP: Final = 0.1
"""Maximum time between two poses of a motion, seconds. After a longer pause the camera counts as at rest until
``MAX_STEP`` before the new pose. Poses at 10 Hz or more make a continuous motion."""
HALF_WIDTH: Final = 0.14
"""Half the width of the smoothing filter, seconds."""
SETTLING_TIME: Final = 2.0 * MAX_STEP + HALF_WIDTH
"""Age from which a point of the smooth path no longer depends on future poses, seconds. The filter needs the spline up
to ``HALF_WIDTH`` later. There, the spline needs the pose at the end of its piece, and that pose's tangent the next
one."""
START_UP: Final = MAX_STEP + HALF_WIDTH
"""Time after the first pose from which the smooth path does not depend on the poses before it, seconds."""

_TAPS: Final = round(HALF_WIDTH * GRID_RATE)
"""Number of the filter's coefficients on each side of the middle."""


def _low_pass() -> NDArray[np.float64]:
    """Return the coefficients of the low-pass filter, (2 * _TAPS + 1,) float64.

    A fourth-order kernel: the window (1 - x²)³ times a polynomial that makes its sum 1 and its second moment 0.
    """
    x = np.arange(-_TAPS, _TAPS + 1) / (_TAPS + 1)
    window = (1.0 - x * x) ** 3
    moments = [float((window * x**power).sum()) for power in (0, 2, 4)]
    a, b = np.linalg.solve([[moments[0], moments[1]], [moments[1], moments[2]]], [1.0, 0.0])
    coefficients: NDArray[np.float64] = window * (a + b * x * x)
    return coefficients


_LOW_PASS: Final = _low_pass()


def pose_vectors(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rigid transforms as positions and unit quaternions.

    Args:
        matrices: (K, 4, 4) float64, without scale.

    Returns:
        (K, 7) float64: x, y, z, qw, qx, qy, qz.
    """
    R = matrices[:, :3, :3]
    xx, yy, zz = R[:, 0, 0], R[:, 1, 1], R[:, 2, 2]
    wx, wy, wz = R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]
    xy, xz, yz = R[:, 0, 1] + R[:, 1, 0], R[:, 0, 2] + R[:, 2, 0], R[:, 1, 2] + R[:, 2, 1]
    # Row i of the products is the quaternion times four times its component i. The row of the largest component is
    # precise (Shepperd 1978).
    w_and_x = ((1 + xx + yy + zz, wx, wy, wz), (wx, 1 + xx - yy - zz, xy, xz))
    y_and_z = ((wy, xy, 1 - xx + yy - zz, yz), (wz, xz, yz, 1 - xx - yy + zz))
    products = np.moveaxis(np.array((*w_and_x, *y_and_z)), 2, 0)
    largest = np.argmax(np.einsum("kii->ki", products), axis=1)
    quaternions = products[np.arange(len(products)), largest]
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    return np.concatenate((matrices[:, :3, 3], quaternions), axis=1)


def align_signs(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses with quaternions negated where needed, so that each is the nearer one of q and -q to the one before.

    Args:
        poses: (K, 7) float64: x, y, z, qw, qx, qy, qz.
    """
    dots = (poses[1:, 3:] * poses[:-1, 3:]).sum(axis=1)
    signs = np.cumprod(np.concatenate(([1.0], np.where(dots < 0.0, -1.0, 1.0))))
    aligned = poses.copy()
    aligned[:, 3:] *= signs[:, None]
    return aligned


def interpolate(times: NDArray[np.float64], poses: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the spline through the poses at some times. The camera rests before the first and after the last pose.

    Args:
        times: (K,) float64, seconds, increasing.
        poses: (K, 7) float64: x, y, z, qw, qx, qy, qz with aligned signs.
        at: (N,) float64, seconds.

    Returns:
        (N, 7) float64; the quaternions are not normalised.
    """
    if len(times) == 1:
        return np.repeat(poses, len(at), axis=0)
    steps = np.diff(times)
    tangents = np.zeros_like(poses)
    # Chords between the neighbours: unlike tangents of a parabola, they do not overshoot where two poses are close in
    # time.
    chords = (poses[2:] - poses[:-2]) / (times[2:] - times[:-2])[:, None]
    moving = (steps[1:] <= MAX_STEP) & (steps[:-1] <= MAX_STEP)
    tangents[1:-1] = np.where(moving[:, None], chords, 0.0)
    piece = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    duration = np.minimum(steps[piece], MAX_STEP)
    u = np.clip(1.0 - (times[piece + 1] - at) / duration, 0.0, 1.0)[:, None]
    scale = duration[:, None]
    v = 1.0 - u
    interpolated: NDArray[np.float64] = (
        (1.0 + 2.0 * u) * v * v * poses[piece]
        + u * u * (3.0 - 2.0 * u) * poses[piece + 1]
        + u * v * (v * scale * tangents[piece] - u * scale * tangents[piece + 1])
    )
    return interpolated


def smooth_path(
    times: NDArray[np.float64], poses: NDArray[np.float64], start: float, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the smooth path at the times ``start``, ``start + 1 / GRID_RATE`` and so on.

    Args:
        times: (K,) float64, seconds, increasing.
        poses: (K, 7) float64: x, y, z, qw, qx, qy, qz.
        start: time of the first sample, seconds.
        count: number of samples.

    Returns:
        (count, 3) float64 positions and (count, 4) float64 unit quaternions.
    """
    at = start + np.arange(-_TAPS, count + _TAPS) / GRID_RATE
    raw = interpolate(times, align_signs(poses), at)
    windows = np.lib.stride_tricks.sliding_window_view(raw, 2 * _TAPS + 1, axis=0)
    smooth = windows @ _LOW_PASS
    quaternions = smooth[:, 3:] / np.linalg.norm(smooth[:, 3:], axis=1, keepdims=True)
    return smooth[:, :3], quaternions
