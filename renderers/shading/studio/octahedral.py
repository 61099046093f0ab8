"""The two maps of the sphere: equirectangular images, and octahedral tables for kernels.

The octahedral map (Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 2014)
has no poles, and sampling it takes no angles.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def equirect_directions(height: int, width: int) -> NDArray[np.float64]:
    """Return the unit directions, Z up, of the pixel centres of an equirectangular image, (H, W, 3) float64.

    The top row is up. The middle column looks along +X, and columns to the right turn clockwise seen from above: the
    image is seen from its inside.
    """
    phi = math.pi * (1.0 - 2.0 * (np.arange(width) + 0.5) / width)
    theta = math.pi * (np.arange(height) + 0.5) / height
    sine = np.sin(theta)[:, None]
    z = np.broadcast_to(np.cos(theta)[:, None], (height, width))
    return np.stack((sine * np.cos(phi), sine * np.sin(phi), z), -1)


def octahedral_directions(size: int) -> NDArray[np.float64]:
    """Return the unit directions of the texel centres of an octahedral table, (size, size, 3) float64."""
    t = 2.0 * (np.arange(size) + 0.5) / size - 1.0
    x, y = np.meshgrid(t, t)
    z = 1.0 - np.abs(x) - np.abs(y)
    fold = np.maximum(-z, 0.0)
    x = x - np.where(x >= 0.0, fold, -fold)
    y = y - np.where(y >= 0.0, fold, -fold)
    d = np.stack((x, y, z), -1)
    result: NDArray[np.float64] = d / np.linalg.norm(d, axis=-1, keepdims=True)
    return result


def with_border(table: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return an octahedral table with a border for bilinear sampling, (N + 2, N + 2, C).

    Beyond an edge lies the same edge, reversed.
    """
    out: NDArray[np.float32] = np.pad(table, ((1, 1), (1, 1), (0, 0)))
    out[0, 1:-1], out[-1, 1:-1] = table[0, ::-1], table[-1, ::-1]
    out[1:-1, 0], out[1:-1, -1] = table[::-1, 0], table[::-1, -1]
    out[0, 0], out[0, -1], out[-1, 0], out[-1, -1] = table[-1, -1], table[-1, 0], table[0, -1], table[0, 0]
    return out
