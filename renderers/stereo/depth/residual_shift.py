"""Sub-pixel shift between the windows of a pair that remains at given disparities.

One step of Lucas and Kanade (1981). Over a window, the shift is the least-squares solution of
``left(x) - right(x - d) = -gradient(x) * shift``::

    shift = -sum(gradient * difference) / (sum(gradient²) + prior)

It follows from the texture, the projector's dots, the sub-pixel phase and the image noise.
"""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F64, I64, Array1, Array2, Array3, f32, i32

PRIOR_SHIFT: Final = 0.5
"""Standard deviation of the shift before the images are compared, pixels. It decides how much gradients count against
the noise. With a third, three times a matcher's errors on a plane, the mean shift near weak texture is too small."""
SHARPNESS: Final = -0.6
"""Parameter of the cubic interpolation between pixels (Keys 1981). Catmull-Rom has -0.5, OpenCV -0.75. Between them,
the mean shift does not depend on the sub-pixel phase."""
PHASE_COUNT: Final = 64
"""Sub-pixel positions of the interpolation."""
MAX_RADIUS: Final = 5
"""Maximum radius of a window, pixels: the sums of larger ones exceed 32 bits."""
_MEAN_WINDOW: Final = 9
"""Side of the window of ``without_local_mean``, pixels. With larger ones, matches and normals are worse."""
_MAX_LEVEL: Final = 255 * 16
_WEIGHT_BITS: Final = 8


def _interpolation_weights() -> NDArray[np.int32]:
    """Return the weights of four neighbours for each sub-pixel position, (``PHASE_COUNT``, 4) int32, units of 1/256."""
    distance = np.abs(np.arange(PHASE_COUNT)[:, None] / PHASE_COUNT - np.arange(-1, 3))
    a = SHARPNESS
    near = ((a + 2.0) * distance - (a + 3.0)) * distance**2 + 1.0
    far = ((distance - 5.0) * distance + 8.0) * distance * a - 4.0 * a
    weights: NDArray[np.int32] = np.rint(np.where(distance <= 1.0, near, far) * (1 << _WEIGHT_BITS)).astype(np.int32)
    weights[:, 1] += (1 << _WEIGHT_BITS) - weights.sum(axis=1)
    return weights


_WEIGHTS: Final = _interpolation_weights()


def without_local_mean(image: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Return each pixel relative to the mean of its window, plus white, (H, W) uint16, 1/16 level.

    Vignetting, and highlights that move with the viewpoint, make one camera see a surface a few grey levels brighter
    than the other one. In weak texture, that is more than the texture.
    """
    mean = cv2.boxFilter(image, -1, (_MEAN_WINDOW, _MEAN_WINDOW))
    return np.asarray(cv2.subtract(image + np.uint16(_MAX_LEVEL), mean), np.uint16)


def residual_shift(
    left: NDArray[np.uint16], right: NDArray[np.uint16], disparity: NDArray[np.float32], radius: int, noise_sigma: float
) -> NDArray[np.float32]:
    """Return the shift to add to each disparity, (H, W) float32, pixels; 0 where the disparity is unknown.

    Args:
        left, right: ``without_local_mean``.
        radius: pixels on each side of a window's centre, up to ``MAX_RADIUS``.
    """
    # Both images have the noise. Gradients have units of 1/32 level per pixel.
    prior = 2.0 * noise_sigma**2 * (32.0 / PRIOR_SHIFT) ** 2
    shift = np.empty(left.shape, np.float32)
    _residual_shift(left, right, disparity, radius, prior, _WEIGHTS, shift)
    return shift


@kernel
def _residual_shift(
    left: Array2[np.uint16],
    right: Array2[np.uint16],
    disparity: Array2[np.float32],
    radius: I64,
    prior: F64,
    weights: Array2[np.int32],
    shift: Array2[np.float32],
) -> None:
    """Write the result of ``residual_shift``. All sums are of integers: their results do not depend on the order.

    Args:
        prior: weight of a shift of 0 per pixel of the window, squared units of the gradient.
        weights: (``PHASE_COUNT``, 4), ``_interpolation_weights``.
    """
    height, width = left.shape
    window = 2 * radius + 1
    padded = width + 2 * radius
    # Ring of the last rows of products, squares and counts, and their sums down each column. Padding beyond the image
    # is 0.
    ring, sums = np.zeros((window, 3, padded), np.int32), np.zeros((3, padded), np.int32)
    window_sums = np.empty((3, width), np.int32)
    for row in range(radius):
        _replace_row(left, right, disparity, row, radius, weights, ring, sums)
    # With rows from -radius in place of the first loop, LLVM takes arrays for overlapping, and is slower.
    for center in range(height):
        _replace_row(left, right, disparity, center + radius, radius, weights, ring, sums)
        _write_row(disparity[center], prior, window, sums, window_sums, shift[center])


@device_function
def _replace_row(
    left: Array2[np.uint16],
    right: Array2[np.uint16],
    disparity: Array2[np.float32],
    row: I64,
    radius: I64,
    weights: Array2[np.int32],
    ring: Array3[np.int32],
    sums: Array2[np.int32],
) -> None:
    """Replace the oldest row of the ring by a row of the images, or by 0 below them.

    Args:
        ring: (2 ``radius`` + 1, 3, W + 2 ``radius``), products, squares and counts of the last rows.
        sums: (3, W + 2 ``radius``), their sums down each column.
    """
    oldest = ring[row % len(ring)]
    product, square, count = oldest[0], oldest[1], oldest[2]
    product_sums, square_sums, count_sums = sums[0], sums[1], sums[2]
    for x in range(len(product)):
        product_sums[x] -= product[x]
        square_sums[x] -= square[x]
        count_sums[x] -= count[x]
        product[x], square[x], count[x] = 0, 0, 0
    if row < len(left):
        _multiply_rows(left[row], right[row], disparity[row], radius, weights, product, square, count)
        for x in range(len(product)):
            product_sums[x] += product[x]
            square_sums[x] += square[x]
            count_sums[x] += count[x]


@inlined
def _write_row(
    disparity: Array1[np.float32],
    prior: F64,
    window: I64,
    sums: Array2[np.int32],
    window_sums: Array2[np.int32],
    shift: Array1[np.float32],
) -> None:
    """Write the shift of the pixels of one row from the sums down the columns of their windows.

    Args:
        sums: (3, W + ``window`` - 1): gradient times difference, squared gradient, pixels with a known disparity.
        window_sums: (3, W), working memory: the sums over windows.
    """
    product_sums, square_sums, count_sums = sums[0], sums[1], sums[2]
    products, squares, counts = window_sums[0], window_sums[1], window_sums[2]
    product_sum, square_sum, pixels = i32(0), i32(0), i32(0)
    for x in range(window - 1):
        product_sum += product_sums[x]
        square_sum += square_sums[x]
        pixels += count_sums[x]
    for column in range(len(disparity)):
        product_sum += product_sums[column + window - 1]
        square_sum += square_sums[column + window - 1]
        pixels += count_sums[column + window - 1]
        products[column], squares[column], counts[column] = product_sum, square_sum, pixels
        product_sum -= product_sums[column]
        square_sum -= square_sums[column]
        pixels -= count_sums[column]
    # A loop of its own, so that the compiler uses vector instructions: half the time of this function.
    for column in range(len(disparity)):
        prior_sum = f32(prior) * f32(max(counts[column], i32(1)))
        # Differences have units of 1/16 level, gradients of 1/32 level per pixel.
        value = f32(-2.0) * f32(products[column])
        value /= f32(squares[column]) + prior_sum
        shift[column] = value if disparity[column] > f32(0.0) else f32(0.0)


@device_function
def _multiply_rows(
    left: Array1[np.uint16],
    right: Array1[np.uint16],
    disparity: Array1[np.float32],
    radius: I64,
    weights: Array2[np.int32],
    product: Array1[np.int32],
    square: Array1[np.int32],
    count: Array1[np.int32],
) -> None:
    """Write the products of gradient and difference of one row, with ``radius`` columns of padding on each side.

    ``product`` is gradient times difference, ``square`` the squared gradient, and ``count`` 1 where the disparity is
    known.
    """
    last = len(left) - 1
    for column in range(len(left)):
        position = column * PHASE_COUNT - int(disparity[column] * f32(PHASE_COUNT) + f32(0.5))
        if disparity[column] <= f32(0.0) or position < 0:
            continue
        whole, weight = position // PHASE_COUNT, weights[position & (PHASE_COUNT - 1)]
        level = weight[0] * i32(right[max(whole - 1, 0)]) + weight[1] * i32(right[whole])
        level += weight[2] * i32(right[min(whole + 1, last)]) + weight[3] * i32(right[min(whole + 2, last)])
        difference = i32(left[column]) - (level + (1 << (_WEIGHT_BITS - 1)) >> _WEIGHT_BITS)
        difference = min(max(difference, -_MAX_LEVEL), _MAX_LEVEL)
        gradient = i32(left[min(column + 1, last)]) - i32(left[max(column - 1, 0)])
        product[column + radius] = gradient * difference
        square[column + radius] = gradient * gradient
        count[column + radius] = 1
