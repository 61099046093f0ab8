"""Image pairs from which depth is measured, and the reduction of images to the resolution of the depth images."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.stereo.model import StereoModel
from renderers.stereo.sensor.camera_image import SensorImage
from renderers.stereo.sensor.exposure import Exposure

Level = TypeVar("Level", np.uint8, np.uint16)
FINE: Final = 16
"""Units per grey level of fine images: means of blocks have fractions of a level."""


@dataclass(frozen=True, slots=True, eq=False)
class ImagePair:
    """Grey images at full resolution, from which depth is measured."""

    left: SensorImage
    right: SensorImage
    exposure: Exposure
    """Exposure of both images, which determines their noise."""

    def reduced(self, model: StereoModel, divisor: int) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
        """Return both images at 1/``divisor`` of the resolution, (H, W) uint16 each, units of 1/``FINE`` level."""
        k = model.intrinsics(divisor)
        left, right = (fine_means(image.image, divisor, k.height, k.width) for image in (self.left, self.right))
        return left, right

    def noise_sigma(self, noise_factor: float, averaged_images: int, divisor: int) -> float:
        """Return the standard deviation of the noise at mid grey in the ``reduced`` images, grey levels."""
        return self.exposure.mid_grey_noise * noise_factor / math.sqrt(averaged_images * divisor**2)


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
