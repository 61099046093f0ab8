"""JPEG encoder for browser views and previews, not for measurements."""

import cv2
import numpy as np
from numpy.typing import NDArray


def jpeg_rgb(image: NDArray[np.uint8], *, quality: int = 85) -> bytes:
    """Return a baseline JPEG, 4:2:0, of an (H, W, 3) uint8 RGB image. ``quality`` is 1 to 100."""
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
        raise ValueError(f"expected (H, W, 3) uint8, got {image.shape} {image.dtype.name}")
    bgr = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2BGR)
    ok, encoded = cv2.imencode(".jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, int(quality)))
    if not ok:
        raise ValueError(f"a {image.shape[1]}x{image.shape[0]} image cannot be a JPEG (65535 pixels a side at most)")
    return bytes(encoded)
