"""Triangle meshes from disparity images, in the left camera's optical frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.compiler.pending import wait_until_compiled
from renderers.stereo import mesh_kernels as kernels
from renderers.stereo import ply
from renderers.stereo.model import DISPARITY_SCALE, Intrinsics

MAX_STEP = math.ceil(2.0 / DISPARITY_SCALE)
"""Maximum disparity step between the corners of a connected cell, units of 1/16 pixel (the vendor's GenICam
library)."""
FOOTPRINT = 2.0 * 1.4
"""``scan_size`` divided by the width of a pixel at the point (the vendor's cvkit)."""


@dataclass(frozen=True, slots=True)
class MeshOptions:
    """Mesh options of a request."""

    max_points: int = 0
    """Maximum number of points; 0: no limit."""
    min_depth: bool = False
    """Take the nearest point of each bin instead of the average."""
    watertight: bool = False
    """Fill every hole and connect every cell."""
    textured: bool = False
    """Colour points from the left image."""
    rgb: bool = False
    """Repeat the colours under the names red, green and blue."""


def bin_size(width: int, height: int, max_points: int) -> int:
    """Return the smallest n with at most ``max_points`` bins of n x n pixels; 1 without a limit."""
    n = 1
    while max_points > 0 and -(-width // n) * -(-height // n) > max_points:
        n += 1
    return n


def disparity_mesh(
    disparity: NDArray[np.uint16],
    intrinsics: Intrinsics,
    baseline: float,
    options: MeshOptions,
    left: NDArray[np.uint8] | None = None,
) -> tuple[bytes, memoryview, memoryview]:
    """Return header, vertices and faces of a binary PLY file.

    Args:
        disparity: (H, W) uint16, units of 1/16 pixel, 0: invalid.
        intrinsics: intrinsics of the disparity image.
        baseline: metres.
        options: see ``MeshOptions``.
        left: (H', W') or (H', W', 3) uint8 left image, required if textured. Each point gets the mean of the pixels
            that its bin covers.
    """
    wait_until_compiled("stereo")
    height, width = disparity.shape
    n = bin_size(width, height, options.max_points)
    rows, columns = -(-height // n), -(-width // n)
    # Disparity and pixel position of every bin's point; disparity 0: no point.
    d = np.empty((rows, columns), np.float32)
    u = np.empty((rows, columns), np.float32)
    v = np.empty((rows, columns), np.float32)
    kernels.bin_points(disparity, n, options.min_depth, d, u, v)
    if options.watertight:
        kernels.fill_all(d, u, v)
    index = np.empty((rows, columns), np.int32)
    points = np.empty((np.count_nonzero(d), 4), np.float32)
    k, t = intrinsics, baseline / DISPARITY_SCALE
    kernels.make_points(d, u, v, k.focal_length, k.cx, k.cy, t, FOOTPRINT * n * t, index, points)
    vertices = np.empty(len(points), ply.vertex_dtype(textured=options.textured, rgb=options.rgb))
    for c, name in enumerate(("x", "y", "z", "scan_size")):
        vertices[name] = points[:, c]
    if options.textured:
        if left is None:
            raise ValueError("a textured mesh needs the left image")
        colors = _colors(left, width, height, n)[index >= 0]
        for c, name in enumerate(("red", "green", "blue")):
            vertices[f"diffuse_{name}"] = colors[:, c]
            if options.rgb:
                vertices[name] = colors[:, c]
    max_step = np.float32(np.inf) if options.watertight else np.float32(MAX_STEP)
    faces = np.empty(kernels.count_faces(d, max_step), ply.FACE)
    triangles = np.empty((len(faces), 3), np.uint32)
    kernels.make_faces(d, index, max_step, triangles)
    faces["count"] = 3
    faces["indices"] = triangles
    return ply.ply_parts(vertices, faces)


def _colors(left: NDArray[np.uint8], width: int, height: int, n: int) -> NDArray[np.uint8]:
    """Return the left image averaged over each bin, (rows, columns, 3) uint8."""
    factor = -(-left.shape[1] // width)
    size = factor * n
    columns, rows = -(-width // n), -(-height // n)
    right, below = max(columns * size - left.shape[1], 0), max(rows * size - left.shape[0], 0)
    if right or below:
        left = np.asarray(cv2.copyMakeBorder(left, 0, below, 0, right, cv2.BORDER_REPLICATE), np.uint8)
    left = np.ascontiguousarray(left[: rows * size, : columns * size])
    small = left if size == 1 else cv2.resize(left, (columns, rows), interpolation=cv2.INTER_AREA)
    small = np.asarray(small, np.uint8)
    return small if small.ndim == 3 else np.repeat(small[:, :, None], 3, axis=2)
