"""JPEG for people's eyes (browser views, previews); never for measurements."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray


def jpeg_rgb(image: NDArray[np.uint8], *, quality: int = 85) -> bytes:
    """(H, W, 3) uint8 RGB -> baseline JPEG, 4:2:0. ``quality``: 1 .. 100."""
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
        raise ValueError(f"expected (H, W, 3) uint8, got {image.shape} {image.dtype.name}")
    bgr = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2BGR)
    ok, encoded = cv2.imencode(".jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, int(quality)))
    if not ok:
        raise ValueError(f"a {image.shape[1]}x{image.shape[0]} picture cannot be a JPEG (65535 pixels a side at most)")
    return bytes(encoded)
