"""Motion blur: poses during the exposure, and the mean light of images that are rendered at them."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import I64, Array2, f32, i64

_ROTATION_TOLERANCE: Final = 1e-6
"""Maximum element of R R^T - I for which a matrix R counts as a rotation."""


def poses_at(X_world_before: NDArray[np.float64], X_world_now: NDArray[np.float64], time: float) -> NDArray[np.float64]:
    """Return the poses at a time, (N, 4, 4), for constant velocity and angular velocity. 0 is now, -1 before.

    Poses that differ in more than rotation and translation, for example in scale, are interpolated linearly. All poses
    share the NumPy calls: calls for each pose take 20 times as long.
    """
    result = X_world_now + time * (X_world_now - X_world_before)
    before, now = X_world_before[:, :3, :3], X_world_now[:, :3, :3]
    turned = np.flatnonzero((before != now).any(axis=(1, 2)) & (np.linalg.det(before) != 0.0))
    rotation = now[turned] @ np.linalg.inv(before[turned])
    error = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    # Twice the axis of the rotation times the sine of its angle, as a cross product matrix.
    cross = rotation - rotation.transpose(0, 2, 1)
    sine = 0.5 * np.sqrt(cross[:, 2, 1] ** 2 + cross[:, 0, 2] ** 2 + cross[:, 1, 0] ** 2)
    is_rotation = (error <= _ROTATION_TOLERANCE) & (sine >= 1e-12)
    turned, rotation, sine = turned[is_rotation], rotation[is_rotation], sine[is_rotation]
    angle = time * np.arctan2(sine, 0.5 * (rotation.trace(axis1=1, axis2=2) - 1.0))[:, None, None]
    cross = cross[is_rotation] / (2.0 * sine[:, None, None])
    partial_rotation = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    result[turned, :3, :3] = partial_rotation @ now[turned]
    return result


def write_mean_light(image: NDArray[np.uint32], column: int, row: int, others: Sequence[NDArray[np.uint32]]) -> None:
    """Replace a rectangle of an image by the mean light of this and other images of the rectangle, as ``Frame.roots``.

    ``column`` and ``row`` are those of its upper left pixel. There is at least one other image, of the rectangle's
    size.
    """
    height, width = others[0].shape
    part = image[row : row + height, column : column + width]
    images = np.stack((part, *others))
    _mean_light(images.reshape(len(images), -1))
    part[:] = images[0]


@inlined
def _mean_root(images: Array2[np.uint32], pixel: I64, shift: I64, steps: I64) -> I64:
    """Return the root of the mean light of a channel of a pixel, where it is in ``Frame.roots``."""
    squares = f32(0.0)
    for number in range(len(images)):
        root = f32(i64(images[number, pixel]) >> shift & steps)
        squares += root * root
    return i64(np.sqrt(squares / f32(len(images))) + f32(0.5)) << shift


@kernel
def _mean_light(images: Array2[np.uint32]) -> None:
    """Replace the first of some images, (N, pixels), by the mean of their light."""
    for pixel in range(images.shape[1]):
        red, green = _mean_root(images, pixel, 0, 2047), _mean_root(images, pixel, 11, 2047)
        images[0, pixel] = red | green | _mean_root(images, pixel, 22, 1023)
