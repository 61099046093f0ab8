"""Kernels of ``disparity_mesh``. Disparities are in units of 1/16 pixel, 0: no point.

A point of a bin has a disparity, ``bin_disparity``, and a position in the image, ``bin_u`` from the left and ``bin_v``
from the top, pixels: (rows, columns) each.
"""

import numpy as np

from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F32, F64, I64, Array1, Array2, f32


@kernel
def bin_points(
    disparity: Array2[np.uint16],
    bin_size: I64,
    nearest: bool,
    bin_disparity: Array2[np.float32],
    bin_u: Array2[np.float32],
    bin_v: Array2[np.float32],
) -> None:
    """Write disparity and pixel position of each bin's point.

    The point is the nearest pixel of the bin or the mean of its valid pixels. The mean over pixels of a plane lies on
    the plane, because the disparity of a plane is affine in the pixel position.
    """
    height, width = disparity.shape
    rows, columns = bin_disparity.shape
    for row in range(rows):
        for column in range(columns):
            disparity_sum, count, x_sum, y_sum = 0, 0, 0, 0
            for y in range(row * bin_size, min((row + 1) * bin_size, height)):
                for x in range(column * bin_size, min((column + 1) * bin_size, width)):
                    d = int(disparity[y, x])
                    if d == 0:
                        continue
                    if not nearest:
                        disparity_sum += d
                        x_sum += x
                        y_sum += y
                        count += 1
                    elif d > disparity_sum:
                        disparity_sum, x_sum, y_sum, count = d, x, y, 1
            if count == 0:
                bin_disparity[row, column] = 0.0
                bin_u[row, column] = (column + 0.5) * bin_size
                bin_v[row, column] = (row + 0.5) * bin_size
            else:
                bin_disparity[row, column] = disparity_sum / count
                bin_u[row, column] = x_sum / count + 0.5
                bin_v[row, column] = y_sum / count + 0.5


@kernel
def fill_empty_bins(bin_disparity: Array2[np.float32]) -> None:
    """Fill every empty bin of ``bin_disparity``, (rows, columns).

    An empty bin gets the farther of the next filled bins to its left and right, because the background continues behind
    the edge of an object. An empty row repeats the last filled row above it, or the first filled row if none is above.
    """
    rows, columns = bin_disparity.shape
    first_filled, last_filled = -1, -1
    for row in range(rows):
        left = f32(0.0)
        column = 0
        while column < columns:
            if bin_disparity[row, column] > 0.0:
                left = bin_disparity[row, column]
                column += 1
                continue
            start = column
            while column < columns and bin_disparity[row, column] == 0.0:
                column += 1
            right = bin_disparity[row, column] if column < columns else f32(0.0)
            farther = min(left, right) if left > 0.0 and right > 0.0 else max(left, right)
            for empty_column in range(start, column):
                bin_disparity[row, empty_column] = farther
        if bin_disparity[row, 0] > 0.0:
            if first_filled < 0:
                first_filled = row
            last_filled = row
        elif last_filled >= 0:
            _copy_row(bin_disparity, last_filled, row)
    for row in range(first_filled):
        _copy_row(bin_disparity, first_filled, row)


@inlined
def _copy_row(values: Array2[np.float32], source: I64, target: I64) -> None:
    """Copy row ``source`` to row ``target``, in a loop: a slice assignment would also compile error handling."""
    for column in range(values.shape[1]):
        values[target, column] = values[source, column]


@kernel
def make_points(
    bin_disparity: Array2[np.float32],
    bin_u: Array2[np.float32],
    bin_v: Array2[np.float32],
    focal_length: F64,
    cx: F64,
    cy: F64,
    baseline_units: F64,
    footprint_units: F64,
    vertex_index: Array2[np.int32],
    points: Array2[np.float32],
) -> None:
    """Write the 3D point and footprint of every bin that is a corner of a triangle, and number these bins.

    The manual's formula: P = ((u - cx) t / d, (v - cy) t / d, f t / d), with focal length f and baseline t.

    Args:
        baseline_units: baseline times the disparity units per pixel, metres.
        footprint_units: footprint of a point times its disparity, metres.
        vertex_index: -1 where no triangle has a corner; numbers of the others are written.
        points: (N, 4), output: x, y, z and footprint, metres.
    """
    count = 0
    for row in range(bin_disparity.shape[0]):
        for column in range(bin_disparity.shape[1]):
            if vertex_index[row, column] < 0:
                continue
            d = bin_disparity[row, column]
            vertex_index[row, column] = count
            metres_per_pixel = baseline_units / d
            points[count, 0] = (bin_u[row, column] - cx) * metres_per_pixel
            points[count, 1] = (bin_v[row, column] - cy) * metres_per_pixel
            points[count, 2] = focal_length * metres_per_pixel
            points[count, 3] = footprint_units / d
            count += 1


@inlined
def _connected_corners(bin_disparity: Array2[np.float32], row: I64, column: I64, max_step: F32) -> I64:
    """Return the number of valid corners of the cell below and right of a bin; 0: the cell is not connected."""
    lowest, highest, valid = f32(np.inf), f32(0.0), 0
    for d in (
        bin_disparity[row, column],
        bin_disparity[row, column + 1],
        bin_disparity[row + 1, column + 1],
        bin_disparity[row + 1, column],
    ):
        if d > 0.0:
            valid += 1
            lowest = min(lowest, d)
            highest = max(highest, d)
    return valid if valid >= 3 and highest - lowest <= max_step else 0


@kernel
def make_triangles(
    bin_disparity: Array2[np.float32],
    bin_u: Array2[np.float32],
    bin_v: Array2[np.float32],
    max_step: F32,
    vertex_index: Array2[np.int32],
    triangles: Array2[np.uint32],
) -> I64:
    """Write the triangles as numbers of bins, and return their number.

    They are counter-clockwise seen from the camera, in the vendor's order (i-1,k-1), (i-1,k), (i,k), (i,k-1). A cell
    with four points is divided along the diagonal that lies in it: mean positions of bins can make it concave.

    Args:
        max_step: maximum difference of the disparities in a cell.
        vertex_index: output: 0 at each corner of a triangle.
        triangles: (N, 3), output, with room for two triangles for each cell.
    """
    columns = bin_disparity.shape[1]
    d, u, v, vertices = bin_disparity.reshape(-1), bin_u.reshape(-1), bin_v.reshape(-1), vertex_index.reshape(-1)
    count = 0
    for row in range(bin_disparity.shape[0] - 1):
        for column in range(columns - 1):
            valid = _connected_corners(bin_disparity, row, column, max_step)
            if valid == 0:
                continue
            upper_left = row * columns + column
            a, b, c, e = upper_left, upper_left + columns, upper_left + columns + 1, upper_left + 1
            if valid == 4 and (not _faces_camera(u, v, a, b, c) or not _faces_camera(u, v, c, e, a)):
                a, b, c, e = b, c, e, a
            # The first triangle lacks the corner e, the second b. With three points there is one triangle.
            for first, second, third, is_whole in (
                (a, b, c, d[e] == 0.0 or valid == 4),
                (c, e, a, d[b] == 0.0 or valid == 4),
                (a, b, e, d[c] == 0.0),
                (b, c, e, d[a] == 0.0),
            ):
                if is_whole and _faces_camera(u, v, first, second, third):
                    triangles[count, 0], triangles[count, 1], triangles[count, 2] = first, second, third
                    vertices[first] = vertices[second] = vertices[third] = 0
                    count += 1
    return count


@inlined
def _faces_camera(u: Array1[np.float32], v: Array1[np.float32], first: I64, second: I64, third: I64) -> bool:
    """Return True if three bins are counter-clockwise in the image, whose v axis points down."""
    across = (u[second] - u[first]) * (v[third] - v[first])
    return across < (v[second] - v[first]) * (u[third] - u[first])


@kernel
def number_corners(triangles: Array2[np.uint32], vertex_index: Array2[np.int32]) -> None:
    """Replace the numbers of bins in ``triangles``, (N, 3), by those of their vertices."""
    vertices = vertex_index.reshape(-1)
    for row in range(triangles.shape[0]):
        for corner in range(3):
            triangles[row, corner] = vertices[triangles[row, corner]]
