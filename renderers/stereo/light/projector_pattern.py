"""Realistic pattern of the random-dot projector: round dots with soft edges, of different brightness, with speckle.

Each cell of a grid may have a dot, in one of its texels. Under the dots lie blobs of 4 x 4 cells, which remain visible
at low resolution. Speckle is interference on the observer's side, so it differs between the cameras. Here it is fixed
to the dots, as on a surface that does not move. All arithmetic is on integers: the pattern is the same on every CPU.
"""

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

TEXELS_PER_CELL: Final = 2
"""Side of a cell, texels: the mean distance of neighbouring places of dots."""
SPECKLE_CONTRAST: Final = 0.15
"""Standard deviation of the speckle, relative to the light of a dot. Our choice: a laser's contrast of 1, divided by
the roots of the number of independent grains in a pixel and of the number of the laser's modes."""
_SIDE: Final = 1024
"""Side of the finest level, texels: a period of 512 cells, 1.4 focal lengths, beyond any disparity."""
_DOT_SHARE: Final = 118
"""Share of the cells that have a dot, units of 1/256."""
_BLOB_SHARE: Final = 102
"""Share of the blocks of 4 x 4 cells that have a blob, units of 1/256."""
_DOT_LIGHT: Final = 150
"""Light of the brightest dots in their centre, units of 1/255."""
_BLOB_LIGHT: Final = 120
"""Light within a blob, units of 1/255."""
_DOT_FILTERS: Final = 1
"""Number of filters [1 2 1] / 4 in each direction that make a dot of one texel round: a standard deviation of 0.7
texels, 1 pixel at full resolution of the 4 mm lens."""
_BLOB_FILTERS: Final = 6
"""Number of such filters for blobs: a standard deviation of 1.7 texels."""


@cache
def soft_pattern_levels(*, right: bool) -> tuple[NDArray[np.uint8], ...]:
    """Return the pattern as a camera sees it, as a mip chain: (1024, 1024), (512, 512), … uint8; 255 is full light."""
    random = np.random.Generator(np.random.Philox(161))
    cells = _SIDE // TEXELS_PER_CELL
    random_bytes = random.integers(0, 256, (4, cells, cells), np.uint8).astype(np.int64)
    # From 0.69 of the full light to all of it.
    brightness = np.where(random_bytes[0] < _DOT_SHARE, 176 + random_bytes[1] * 80 // 256, 0)
    # Each dot is in one of the four texels of its cell.
    rows, columns = np.mgrid[0:cells, 0:cells] * TEXELS_PER_CELL
    dots = np.zeros((_SIDE, _SIDE), np.int64)
    dots[rows + (random_bytes[2] & 1), columns + (random_bytes[3] & 1)] = brightness
    # The filter leaves a quarter of a dot's light in its centre.
    dots = _blurred(dots, _DOT_FILTERS) * (_DOT_LIGHT * 4) // 256
    blobs = random.integers(0, 256, (cells // 4, cells // 4), np.uint8) < _BLOB_SHARE
    side = 4 * TEXELS_PER_CELL
    blob_light = np.where(blobs, _BLOB_LIGHT, 0).repeat(side, axis=0).repeat(side, axis=1)
    light = np.minimum(dots, _DOT_LIGHT) + _blurred(blob_light, _BLOB_FILTERS)
    level = np.clip(light * (_speckle(right) + 1024) // 1024, 0, 255)
    levels = []
    while level.shape[0] >= 16:
        levels.append(level.astype(np.uint8))
        level = (level[::2, ::2] + level[1::2, ::2] + level[::2, 1::2] + level[1::2, 1::2] + 2) // 4
    return tuple(levels)


def _speckle(right: bool) -> NDArray[np.int64]:
    """Return the relative deviation of the light from its mean, (1024, 1024) int64, units of 1/1024."""
    random = np.random.Generator(np.random.Philox(162 + right))
    # A sum of four bytes has the mean 510 and the standard deviation 147.8.
    total = random.integers(0, 256, (4, _SIDE, _SIDE), np.uint8).sum(axis=0, dtype=np.int64) - 510
    deviation: NDArray[np.int64] = total * round(SPECKLE_CONTRAST * 1024 * 256 / 147.8) // 256
    return deviation


def _blurred(values: NDArray[np.int64], times: int) -> NDArray[np.int64]:
    """Return values after ``times`` filters [1 2 1] / 4 along rows and as many along columns, with periodic edges."""
    values = values * 256
    for _ in range(times):
        for axis in (0, 1):
            values = (2 * values + np.roll(values, 1, axis) + np.roll(values, -1, axis) + 2) // 4
    return (values + 128) // 256
