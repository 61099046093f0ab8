"""Realistic pattern of the random-dot projector: round dots with soft edges, of different brightness, with speckle.

The dots lie beside the points of a grid, over blobs of four times their size, which remain visible at low resolution.
Speckle is interference on the observer's side, so it differs between the cameras. Here it is fixed to the dots, as on a
surface that does not move. All arithmetic is on integers, so that the pattern is the same on every CPU.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

TEXELS_PER_CELL: Final = 2
"""Texels of the pattern per cell, the mean distance of possible dots."""
SPECKLE_CONTRAST: Final = 0.15
"""Standard deviation of the speckle, relative to the light of a dot. Our choice: a laser's full contrast of 1 falls
with the root of the number of independent grains in a pixel and of the laser's modes."""
_SIDE: Final = 1024
"""Side of the finest level, texels: a period of 512 cells, 1.4 focal lengths, beyond any disparity."""
_DOT_SHARE: Final = 118
"""Cells of 256 that have a dot."""
_BLOB_SHARE: Final = 102
"""Blocks of 4 x 4 cells of 256 that have a blob."""
_DOT_LIGHT: Final = 150
"""Light of a dot in its centre."""
_BLOB_LIGHT: Final = 120
"""Light within a blob."""
_DOT_BLUR: Final = 1
"""Number of filters [1 2 1] / 4 in each direction that make a dot of one texel round: a standard deviation of 0.7
texels, 1 pixel at full resolution of the 4 mm lens."""
_BLOB_BLUR: Final = 6
"""Number of such filters for blobs: a standard deviation of 1.7 texels."""


@cache
def soft_pattern_levels(*, right: bool) -> tuple[NDArray[np.uint8], ...]:
    """Return the pattern as a camera sees it, as a mip chain: (1024, 1024), (512, 512), … uint8; 255 is full light."""
    random = np.random.Generator(np.random.Philox(161))
    cells = _SIDE // TEXELS_PER_CELL
    bytes_ = random.integers(0, 256, (4, cells, cells), np.uint8).astype(np.int64)
    brightness = np.where(bytes_[0] < _DOT_SHARE, 176 + bytes_[1] * 80 // 256, 0)  # 0.69 to 1 of the full light
    # A dot is in one of the cell's texels.
    rows, columns = np.mgrid[0:cells, 0:cells] * TEXELS_PER_CELL
    dots = np.zeros((_SIDE, _SIDE), np.int64)
    dots[rows + (bytes_[2] & 1), columns + (bytes_[3] & 1)] = brightness
    # A dot keeps a quarter of its light in its centre.
    dots = _blurred(dots, _DOT_BLUR) * (_DOT_LIGHT * 4) // 256
    blobs = random.integers(0, 256, (cells // 4, cells // 4), np.uint8) < _BLOB_SHARE
    side = 4 * TEXELS_PER_CELL
    blob_light = np.where(blobs, _BLOB_LIGHT, 0).repeat(side, axis=0).repeat(side, axis=1)
    light = np.minimum(dots, _DOT_LIGHT) + _blurred(blob_light, _BLOB_BLUR)
    level = np.clip(light * (_speckle(right) + 1024) // 1024, 0, 255)
    levels = []
    while level.shape[0] >= 16:
        levels.append(level.astype(np.uint8))
        level = (level[::2, ::2] + level[1::2, ::2] + level[::2, 1::2] + level[1::2, 1::2] + 2) // 4
    return tuple(levels)


def _speckle(right: bool) -> NDArray[np.int64]:
    """Return the relative deviation of the light from its mean, (1024, 1024) int64, units of 1/1024."""
    random = np.random.Generator(np.random.Philox(162 + right))
    total = random.integers(0, 256, (4, _SIDE, _SIDE), np.uint8).sum(axis=0, dtype=np.int64) - 510
    deviation: NDArray[np.int64] = (
        total * round(SPECKLE_CONTRAST * 1024 * 256 / 147.8) // 256
    )  # 147.8: standard deviation of the sum
    return deviation


def _blurred(values: NDArray[np.int64], times: int) -> NDArray[np.int64]:
    """Return values, filtered by [1 2 1] / 4 along rows and along columns, ``times`` each; periodic."""
    values = values * 256
    for _ in range(times):
        for axis in (0, 1):
            values = (2 * values + np.roll(values, 1, axis) + np.roll(values, -1, axis) + 2) // 4
    return (values + 128) // 256
