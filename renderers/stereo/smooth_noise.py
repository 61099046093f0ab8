"""Spatially correlated noise: errors of a window matcher change little from one pixel to the next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.pending import wait_until_compiled
from renderers.stereo.noise import NORMAL_TABLE, random64

_WHITE_UNITS = 256
"""Standard deviation of the white noise, an integer: sums of integers are the same on every processor."""
_WHITE_NOISE = np.rint(NORMAL_TABLE * _WHITE_UNITS).astype(np.int32)


def smooth_noise(height: int, width: int, box: int, key: np.uint64) -> NDArray[np.float32]:
    """Return Gaussian noise of variance 1, (H, W) float32.

    White noise is averaged twice over boxes in each direction. The autocorrelation at distance ``box`` is about 0.25.

    Args:
        height: rows.
        width: columns.
        box: side of a box, pixels, up to 32.
        key: random key (``noise.frame_key``).
    """
    wait_until_compiled("stereo")
    noise = np.empty((height, width), np.float32)
    weight_square = (2 * box**2 + 1) * box / 3  # sum of the squared weights 1, 2, …, box, …, 2, 1
    _smooth_noise(np.uint64(key), box, 1.0 / (_WHITE_UNITS * weight_square), _WHITE_NOISE, noise)
    return noise


@kernel("void(uint64, int64, float64, int32[::1], float32[:,::1])")
def _smooth_noise(key, box, scale, white_noise, noise):
    """Write the noise.

    Args:
        key: random key.
        box: side of a box, pixels.
        scale: factor of the sums, for a variance of 1.
        white_noise: (4096,) int32, quantiles of the normal distribution.
        noise: (H, W) float32, output.
    """
    height, width = noise.shape
    reach = 2 * (box - 1)
    factor = np.float32(scale)
    white = np.empty(width + reach, np.int32)
    once = np.empty(width + reach, np.int32)
    # Running sums down each column: of the rows below, then of those sums. Each ring has the last `box` rows.
    rows, row_sums = np.zeros((box, width), np.int32), np.zeros((box, width), np.int32)
    first_sum, second_sum = np.zeros(width, np.int32), np.zeros(width, np.int32)
    for row in range(height + reach):
        bits = np.uint64(0)
        for column in range(width + reach):
            if column & 3 == 0:
                bits = random64(key, row * (width + reach) + column)
            white[column] = white_noise[bits & np.uint64(4095)]
            bits >>= np.uint64(16)
        total = np.int32(0)
        for column in range(width + reach):
            total += white[column]
            if column >= box:
                total -= white[column - box]
            once[column] = total
        slot = row % box
        total = np.int32(0)
        for column in range(box - 1, width + reach):
            total += once[column]
            if column >= 2 * box - 1:
                total -= once[column - box]
            if column >= reach:
                first_sum[column - reach] += total - rows[slot, column - reach]
                rows[slot, column - reach] = total
        for column in range(width):
            second_sum[column] += first_sum[column] - row_sums[slot, column]
            row_sums[slot, column] = first_sum[column]
        if row >= reach:
            for column in range(width):
                noise[row - reach, column] = np.float32(second_sum[column]) * factor
