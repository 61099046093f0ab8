"""Two maps of the sphere of directions: equirectangular images, and octahedral tables for kernels.

An octahedral map (Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 2014) has
no poles, and sampling it needs no angles.
"""

import math

import numpy as np
from numpy.typing import NDArray


def equirect_directions(height: int, width: int) -> NDArray[np.float64]:
    """Return the unit directions, Z up, of the pixel centres of an equirectangular image, (H, W, 3) float64.

    The image is seen from inside the sphere: the top row is up, the middle column is +X, and columns to its right turn
    clockwise as seen from above.
    """
    phi = math.pi * (1.0 - 2.0 * (np.arange(width) + 0.5) / width)
    theta = math.pi * (np.arange(height) + 0.5) / height
    sine = np.sin(theta)[:, None]
    z = np.broadcast_to(np.cos(theta)[:, None], (height, width))
    return np.stack((sine * np.cos(phi), sine * np.sin(phi), z), -1)


def octahedral_directions(size: int) -> NDArray[np.float64]:
    """Return the unit directions of the texel centres of an octahedral table, (size, size, 3) float64."""
    centers = 2.0 * (np.arange(size) + 0.5) / size - 1.0
    x, y = np.meshgrid(centers, centers)
    z = 1.0 - np.abs(x) - np.abs(y)
    fold = np.maximum(-z, 0.0)
    x = x - np.where(x >= 0.0, fold, -fold)
    y = y - np.where(y >= 0.0, fold, -fold)
    directions = np.stack((x, y, z), -1)
    unit: NDArray[np.float64] = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    return unit


def with_border(table: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return an octahedral table (N, N, C) with a border of one texel for bilinear sampling, (N + 2, N + 2, C).

    Beyond each edge lie the texels of the same edge in reverse order.
    """
    bordered: NDArray[np.float32] = np.pad(table, ((1, 1), (1, 1), (0, 0)))
    bordered[0, 1:-1], bordered[-1, 1:-1] = table[0, ::-1], table[-1, ::-1]
    bordered[1:-1, 0], bordered[1:-1, -1] = table[::-1, 0], table[::-1, -1]
    bordered[0, 0], bordered[0, -1] = table[-1, -1], table[-1, 0]
    bordered[-1, 0], bordered[-1, -1] = table[0, -1], table[0, 0]
    return bordered
