"""Spatially correlated Gaussian noise, for errors that change little from one pixel to the next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.pending import wait_until_compiled
from renderers.stereo.noise import NORMAL_TABLE, random64

_WHITE_UNITS = 256
"""Standard deviation of the integer white noise. Sums of integers are the same on every CPU."""
_WHITE_NOISE = np.rint(NORMAL_TABLE * _WHITE_UNITS).astype(np.int32)
"""(4096,) int32, quantiles of the normal distribution; 12 random bits select one."""


def smooth_noise(height: int, width: int, box: int, key: np.uint64) -> NDArray[np.float32]:
    """Return Gaussian noise of variance 1, (H, W) float32.

    White noise is averaged twice over a box in each direction. The autocorrelation at distance ``box`` is about 0.25.

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
    """Write smooth noise of variance 1.

    Args:
        key: random key.
        box: side of a box, pixels.
        scale: factor of the sums of white noise, for a variance of 1.
        white_noise: (4096,) int32, ``_WHITE_NOISE``.
        noise: (H, W) float32, output.
    """
    height, width = noise.shape
    reach = 2 * (box - 1)
    factor = np.float32(scale)
    white = np.empty(width + reach, np.int32)
    box_sums = np.empty(width + reach, np.int32)
    # Each row is summed twice over `box` columns, then each column twice over `box` rows. The rings keep the inputs of
    # the two column sums for the last `box` rows, which leave the running sums again.
    first_ring, second_ring = np.zeros((box, width), np.int32), np.zeros((box, width), np.int32)
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
            box_sums[column] = total
        ring_row = row % box
        total = np.int32(0)
        for column in range(box - 1, width + reach):
            total += box_sums[column]
            if column >= 2 * box - 1:
                total -= box_sums[column - box]
            if column >= reach:
                first_sum[column - reach] += total - first_ring[ring_row, column - reach]
                first_ring[ring_row, column - reach] = total
        for column in range(width):
            second_sum[column] += first_sum[column] - second_ring[ring_row, column]
            second_ring[ring_row, column] = first_sum[column]
        if row >= reach:
            for column in range(width):
                noise[row - reach, column] = np.float32(second_sum[column]) * factor
