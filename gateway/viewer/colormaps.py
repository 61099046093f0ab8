"""Depth, disparity and confidence as RGB images, and smaller copies of images."""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

_DEPTH_PERCENTILE: Final = 95.0
"""Percentile of the depths at the far end of the colormap, so that a floor to the horizon does not take it all."""
_DISPARITY_PERCENTILES: Final = (1.0, 99.0)
"""Percentiles of the disparities at the ends of the colormap, so that single outliers have no effect."""


def depth_to_rgb(depth: NDArray[Any]) -> NDArray[np.uint8]:
    """Map depth to colours from near (red) to far (blue); pixels without a surface are black.

    Args:
        depth: (H, W), float32 metres with infinity for no surface, or uint16 millimetres with 65535.

    Returns:
        (H, W, 3) uint8.
    """
    values = depth.astype(np.float32)
    valid = np.isfinite(values) & (values > 0.0)
    if depth.dtype == np.uint16:
        valid &= depth < 65535
    if not valid.any():
        return np.zeros((*values.shape, 3), np.uint8)
    near, far = float(values[valid].min()), float(np.percentile(values[valid], _DEPTH_PERCENTILE))
    return _apply_colormap(-values, -far, -near, cv2.COLORMAP_TURBO, valid)


def disparity_to_rgb(disparity: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Map disparity to colours from near (red) to far (blue); 0 is invalid and black. (H, W) -> (H, W, 3)."""
    valid = disparity > 0
    far, near = np.percentile(disparity[valid], _DISPARITY_PERCENTILES) if valid.any() else (0.0, 1.0)
    return _apply_colormap(disparity, float(far), float(near), cv2.COLORMAP_TURBO, valid)


def confidence_to_rgb(confidence: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Map confidence to colours; 0 is invalid and black. (H, W) -> (H, W, 3)."""
    return _apply_colormap(confidence, 0.0, 255.0, cv2.COLORMAP_VIRIDIS, confidence > 0)


def gray_to_rgb(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return (H, W) as (H, W, 3); three channels stay as they are."""
    return pixels if pixels.ndim == 3 else np.repeat(pixels[:, :, None], 3, axis=2)


def shrink_to_width(rgb: NDArray[np.uint8], width: int | None, *, interpolate: bool = True) -> NDArray[np.uint8]:
    """Scale an image down to ``width`` pixels, keeping its aspect ratio; a narrower image stays as it is.

    Args:
        interpolate: False picks the nearest pixel. Label images need that: the mean of two labels is another label.
    """
    if width is None or width >= rgb.shape[1]:
        return rgb
    height = max(1, round(rgb.shape[0] * width / rgb.shape[1]))
    method = cv2.INTER_AREA if interpolate else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(rgb, (width, height), interpolation=method), np.uint8)


def _apply_colormap(
    values: NDArray[Any], low: float, high: float, colormap: int, valid: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """Map ``low`` .. ``high`` to the colormap; (H, W) -> (H, W, 3) RGB, invalid pixels black."""
    scaled = (values.astype(np.float32) - np.float32(low)) * np.float32(255.0 / max(high - low, 1e-6))
    levels = np.nan_to_num(scaled, posinf=0.0, neginf=0.0).clip(0, 255).astype(np.uint8)
    bgr = np.asarray(cv2.applyColorMap(levels, colormap), np.uint8)
    bgr[~valid] = 0
    return np.ascontiguousarray(bgr[:, :, ::-1])
