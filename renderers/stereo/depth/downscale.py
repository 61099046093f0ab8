"""Reduction of an image to the means of square blocks, for depth, the colours of meshes and recorded images."""

from __future__ import annotations

from typing import Final, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

Level = TypeVar("Level", np.uint8, np.uint16)
FINE: Final = 16
"""Units per grey level of fine images: means of blocks have fractions of a level."""


def block_means(image: NDArray[Level], side: int, rows: int, columns: int) -> NDArray[Level]:
    """Return the mean of each block of pixels, (rows, columns) or (rows, columns, 3) of the image's type.

    Blocks that reach beyond the image repeat its last row and column. Pixels beyond the last block are ignored.

    Args:
        image: (H, W) or (H, W, 3), uint8 or uint16.
        side: side of a block, pixels.
        rows: number of rows of blocks.
        columns: number of columns of blocks.
    """
    height, width = rows * side, columns * side
    padding_below, padding_right = max(height - image.shape[0], 0), max(width - image.shape[1], 0)
    if padding_below or padding_right:
        padded = cv2.copyMakeBorder(image, 0, padding_below, 0, padding_right, cv2.BORDER_REPLICATE)
        image = np.asarray(padded, image.dtype)
    image = np.ascontiguousarray(image[:height, :width])
    if side == 1:
        return image
    return np.asarray(cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA), image.dtype)


def fine_means(image: NDArray[np.uint8], side: int, rows: int, columns: int) -> NDArray[np.uint16]:
    """Return ``block_means`` of a grey image in units of 1/``FINE`` level, (rows, columns) uint16."""
    return block_means(np.multiply(image, FINE, dtype=np.uint16), side, rows, columns)


def grey_levels(fine: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Return a fine image rounded to grey levels, (H, W) uint8."""
    return (fine + np.uint16(FINE // 2) >> 4).astype(np.uint8)
