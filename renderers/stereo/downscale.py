"""Reduction of an image to the means of square blocks, for the colours of meshes and for recorded images."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray


def block_means(image: NDArray[np.uint8], side: int, rows: int, columns: int) -> NDArray[np.uint8]:
    """Return the mean of each block of pixels, (rows, columns) or (rows, columns, 3) uint8.

    Blocks that reach beyond the image repeat its last row and column. Pixels beyond the last block are ignored.

    Args:
        image: (H, W) or (H, W, 3) uint8.
        side: side of a block, pixels.
        rows: number of rows of blocks.
        columns: number of columns of blocks.
    """
    height, width = rows * side, columns * side
    padding_below, padding_right = max(height - image.shape[0], 0), max(width - image.shape[1], 0)
    if padding_below or padding_right:
        padded = cv2.copyMakeBorder(image, 0, padding_below, 0, padding_right, cv2.BORDER_REPLICATE)
        image = np.asarray(padded, np.uint8)
    image = np.ascontiguousarray(image[:height, :width])
    if side == 1:
        return image
    return np.asarray(cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)
