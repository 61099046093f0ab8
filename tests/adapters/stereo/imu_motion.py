"""Known motions of a camera, sampled as poses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Motion = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]
"""Takes (N,) seconds, returns (N, 3) positions and (N, 3) rotation vectors X_world_left."""


def matrices(motion: Motion, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the poses at some times: (N, 4, 4) float64."""
    positions, vectors = motion(times)
    poses = np.zeros((len(times), 4, 4))
    poses[:, :3, :3], poses[:, :3, 3], poses[:, 3, 3] = rotations(vectors), positions, 1.0
    return poses


def rotations(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation matrices of rotation vectors, (N, 3, 3) float64 (Rodrigues)."""
    angles = np.linalg.norm(vectors, axis=1)[:, None, None]
    axes = vectors / np.where(angles[:, :, 0] > 0, angles[:, :, 0], 1.0)
    K = np.zeros((len(vectors), 3, 3))
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -axes[:, 2], axes[:, 1], -axes[:, 0]
    K -= K.transpose(0, 2, 1)
    R: NDArray[np.float64] = np.eye(3) + np.sin(angles) * K + (1.0 - np.cos(angles)) * (K @ K)
    return R


def rest(t: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Stand still with the optical axis horizontal: -y of the camera is up."""
    return np.tile((1.0, -2.0, 0.5), (len(t), 1)), np.tile((-0.5 * np.pi, 0.0, 0.0), (len(t), 1))


def spin(t: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotate at 1.5 rad/s about the camera's own z, which is the world's z."""
    return np.zeros((len(t), 3)), t[:, None] * np.array((0.0, 0.0, 1.5))


def circle(t: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Move on a horizontal circle of 0.3 m at 2 rad/s, turning with it: the centre is always in -x of the camera."""
    angle = 2.0 * t
    positions = 0.3 * np.stack((np.cos(angle), np.sin(angle), np.zeros(len(t))), axis=1)
    return positions, angle[:, None] * np.array((0.0, 0.0, 1.0))


def wave(t: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Move as a hand with a camera: some decimetres and half a radian, about a second per period, on all axes."""
    phases = t[:, None] * np.array((5.0, 6.1, 4.3)) + np.array((0.0, 1.0, 2.0))
    return 0.2 * np.sin(phases), 0.25 * np.cos(phases[:, ::-1])
