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
"""Units: a cell whose corners differ by more is not connected (the vendor's GenICam library)."""
FOOTPRINT = 2.0 * 1.4
"""``scan_size`` in widths of a pixel at the point (the vendor's cvkit)."""


@dataclass(frozen=True, slots=True)
class MeshOptions:
    """What a client asked for."""

    max_points: int = 0
    """0: no limit."""
    min_depth: bool = False
    """A bin gives its nearest point; False: the average of its points."""
    watertight: bool = False
    """Every pixel gets a point and every cell is connected."""
    textured: bool = False
    """Points carry colours of the left image."""
    rgb: bool = False
    """Repeat the colours under the names red, green and blue."""


def bin_size(width: int, height: int, max_points: int) -> int:
    """The smallest n with at most ``max_points`` bins of n x n pixels; 1 without a limit."""
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
    """A PLY file of the surface: header, vertices, faces.

    Args:
        disparity: (H, W) uint16, 1/16 pixel, 0: invalid.
        intrinsics: of the disparity image.
        baseline: metres.
        options: see ``MeshOptions``.
        left: (H', W') or (H', W', 3) uint8, needed when textured; each point gets the mean of the pixels that its
            disparity pixel covers.
    """
    wait_until_compiled("stereo")
    height, width = disparity.shape
    n = bin_size(width, height, options.max_points)
    rows, columns = -(-height // n), -(-width // n)
    # Disparity in units and pixel position of every bin's point; 0: no point.
    d = np.empty((rows, columns), np.float32)
    u = np.empty((rows, columns), np.float32)
    v = np.empty((rows, columns), np.float32)
    kernels.bin_points(disparity, n, options.min_depth, d, u, v)
    if options.watertight:
        kernels.fill_all(d, u, v)
    index = np.full((rows, columns), -1, np.int32)
    count = kernels.number_points(d, index)
    vertices = np.empty(count, ply.vertex_dtype(textured=options.textured, rgb=options.rgb))
    points = np.empty((count, 4), np.float32)
    k, unit = intrinsics, DISPARITY_SCALE
    kernels.place_points(d, u, v, k.focal_length, k.cx, k.cy, baseline / unit, FOOTPRINT * n * baseline / unit, points)
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
    step = np.float32(np.inf) if options.watertight else np.float32(MAX_STEP)
    faces = np.empty(kernels.count_faces(d, index, step), ply.FACE)
    flat = np.empty((len(faces), 3), np.uint32)
    kernels.make_faces(d, index, step, flat)
    faces["count"] = 3
    faces["indices"] = flat
    return ply.ply_parts(vertices, faces)


def _colors(left: NDArray[np.uint8], width: int, height: int, n: int) -> NDArray[np.uint8]:
    """(rows, columns, 3) uint8: the left image averaged over what each bin covers."""
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
