"""Triangle meshes from disparity images, in the left camera's optical frame."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.stereo.depth.matching import block_means
from renderers.stereo.mesh import mesh_kernels as kernels
from renderers.stereo.model import DISPARITY_SCALE, Intrinsics

MAX_STEP = math.ceil(2.0 / DISPARITY_SCALE)
"""Maximum disparity step between the corners of a connected cell, units of 1/16 pixel (the vendor's GenICam
library)."""
MAX_SLOPE = 0.25 / DISPARITY_SCALE
"""Further step for each pixel by which bins are larger than one, units of 1/16 pixel. The disparity of a plane changes
by at most baseline / distance per pixel: one that passes the camera at four baselines stays whole."""
FOOTPRINT = 2.0 * 1.4
"""Vertex property ``scan_size`` divided by the width of a pixel at the point (as in the vendor's cvkit)."""

_TYPES = {np.dtype("<f4"): "float32", np.dtype("u1"): "uint8"}
"""Names of types in PLY files."""
_FACE = np.dtype([("count", "u1"), ("indices", "<u4", (3,))])
"""Packed triangle: 3, then three vertex indices."""


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


def smallest_bin_size(width: int, height: int, max_points: int) -> int:
    """Return the smallest side of square bins, pixels, with at most ``max_points`` bins; 1 if ``max_points`` is 0."""
    side = 1
    while max_points > 0 and -(-width // side) * -(-height // side) > max_points:
        side += 1
    return side


def disparity_mesh(
    disparity: NDArray[np.uint16],
    intrinsics: Intrinsics,
    baseline: float,
    options: MeshOptions,
    left: NDArray[np.uint8] | None = None,
) -> tuple[bytes, memoryview, memoryview]:
    """Return header, vertices and faces of a binary PLY file.

    Args:
        intrinsics: intrinsics of the disparity image.
        left: (H', W') or (H', W', 3) left image, required if textured. Each point gets the mean of the pixels that its
            bin covers.
    """
    height, width = disparity.shape
    bin_size = smallest_bin_size(width, height, options.max_points)
    bins = (-(-height // bin_size), -(-width // bin_size))
    # Disparity and pixel position of every bin's point; disparity 0: no point.
    bin_disparity, bin_u, bin_v = (np.empty(bins, np.float32) for _ in range(3))
    kernels.bin_points(disparity, bin_size, options.min_depth, bin_disparity, bin_u, bin_v)
    if options.watertight:
        kernels.fill_empty_bins(bin_disparity)
    vertex_index = np.full(bins, -1, np.int32)
    triangles = np.empty((2 * max(bins[0] - 1, 0) * max(bins[1] - 1, 0), 3), np.uint32)
    max_step = np.inf if options.watertight else MAX_STEP + MAX_SLOPE * (bin_size - 1)
    count = kernels.make_triangles(bin_disparity, bin_u, bin_v, max_step, vertex_index, triangles)
    triangles = triangles[:count]
    points = np.empty((np.count_nonzero(vertex_index >= 0), 4), np.float32)
    baseline_units = baseline / DISPARITY_SCALE
    kernels.make_points(
        bin_disparity, bin_u, bin_v, float(intrinsics.focal_length), float(intrinsics.cx), float(intrinsics.cy),
        baseline_units, FOOTPRINT * bin_size * baseline_units, vertex_index, points,
    )  # fmt: skip
    kernels.number_corners(triangles, vertex_index)
    vertices = np.empty(len(points), _vertex_dtype(textured=options.textured))
    for column, name in enumerate(("x", "y", "z", "scan_size")):
        vertices[name] = points[:, column]
    if options.textured:
        if left is None:
            raise ValueError("a textured mesh needs the left image")
        colors = _bin_colors(left, width, height, bin_size)[vertex_index >= 0]
        for channel, name in enumerate(("red", "green", "blue")):
            vertices[f"diffuse_{name}"] = vertices[name] = colors[:, channel]
    faces = np.empty(len(triangles), _FACE)
    faces["count"] = 3
    faces["indices"] = triangles
    return _ply_parts(vertices, faces)


def _bin_colors(left: NDArray[np.uint8], width: int, height: int, bin_size: int) -> NDArray[np.uint8]:
    """Return the left image averaged over each bin of a disparity image of this size, (rows, columns, 3) uint8."""
    left_pixels_per_bin = -(-left.shape[1] // width) * bin_size
    colors = block_means(left, left_pixels_per_bin, rows=-(-height // bin_size), columns=-(-width // bin_size))
    return colors if colors.ndim == 3 else np.repeat(colors[:, :, None], 3, axis=2)


def _vertex_dtype(*, textured: bool) -> np.dtype[np.void]:
    """Return the packed vertex type: x, y, z and scan_size, and if ``textured`` the colours.

    They are there twice: as diffuse_red, diffuse_green, diffuse_blue, which the vendor's programs read, and as red,
    green, blue, which trimesh, Open3D and most others read.
    """
    fields: list[tuple[str, str]] = [(name, "<f4") for name in ("x", "y", "z", "scan_size")]
    if textured:
        fields += [(prefix + name, "u1") for prefix in ("diffuse_", "") for name in ("red", "green", "blue")]
    return np.dtype(fields)


def _ply_parts(vertices: NDArray[np.void], faces: NDArray[np.void]) -> tuple[bytes, memoryview, memoryview]:
    """Return header, vertices and faces, whose concatenation is a PLY file in the vendor's layout."""
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment Created with Scenegate",
        "comment Origin 0 0 0",
        "comment Camera [1 0 0; 0 1 0; 0 0 1] [0 0 0]",
        f"element vertex {len(vertices)}",
    ]
    names = vertices.dtype.names or ()
    lines += [f"property {_TYPES[vertices.dtype[name]]} {name}" for name in names]
    lines += [f"element face {len(faces)}", "property list uint8 uint32 vertex_indices", "end_header", ""]
    header = "\n".join(lines).encode("ascii")
    return header, _bytes_of(vertices), _bytes_of(faces)


def _bytes_of(records: NDArray[np.void]) -> memoryview:
    return records.view(np.uint8).reshape(-1).data if len(records) else memoryview(b"")
