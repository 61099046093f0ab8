"""Convert depth, disparity and confidence to RGB images, and scale images down, for the images of the browser view."""

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

_DEPTH_PERCENTILE: Final = 95.0
"""Percentile of the depths at the far end of the colormap. With the maximum, a floor that extends to the horizon would
leave few colours for the objects."""
_DISPARITY_PERCENTILES: Final = (1.0, 99.0)
"""Percentiles of the disparities at the far and near end of the colormap. Single outliers have no effect on them."""


def depth_to_rgb(depth: NDArray[Any]) -> NDArray[np.uint8]:
    """Map depth, (H, W), to colours, (H, W, 3), from near (red) to far (blue); black where there is no surface.

    Metres as float32, infinity for no surface; or millimetres as uint16, 65535 for no surface.
    """
    values = depth.astype(np.float32)
    valid = np.isfinite(values) & (values > 0.0)
    if depth.dtype == np.uint16:
        valid &= depth < 65535
    if not valid.any():
        return np.zeros((*values.shape, 3), np.uint8)
    near, far = float(values[valid].min()), float(np.percentile(values[valid], _DEPTH_PERCENTILE))
    # negated, because the near end of the colormap is its high end
    return _apply_colormap(-values, -far, -near, cv2.COLORMAP_TURBO, valid)


def disparity_to_rgb(disparity: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Map disparity, (H, W) in any unit, to colours, (H, W, 3): near is red, far is blue. 0 is invalid and black."""
    valid = disparity > 0
    far, near = np.percentile(disparity[valid], _DISPARITY_PERCENTILES) if valid.any() else (0.0, 1.0)
    return _apply_colormap(disparity, float(far), float(near), cv2.COLORMAP_TURBO, valid)


def confidence_to_rgb(confidence: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Map confidence, (H, W) in 1/255, to colours, (H, W, 3). 0 is invalid and black."""
    return _apply_colormap(confidence, 0.0, 255.0, cv2.COLORMAP_VIRIDIS, confidence > 0)


def gray_to_rgb(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a grey image, (H, W), as (H, W, 3). Return an image that has channels unchanged."""
    return pixels if pixels.ndim == 3 else np.repeat(pixels[:, :, None], 3, axis=2)


def shrink_to_width(rgb: NDArray[np.uint8], width: int | None, *, interpolate: bool = True) -> NDArray[np.uint8]:
    """Scale an image, (H, W, 3), down to a maximum width (None: no maximum); the aspect ratio is kept.

    ``interpolate`` False: take the nearest pixel, as the mean of two labels is a third label.
    """
    if width is None or width >= rgb.shape[1]:
        return rgb
    height = max(1, round(rgb.shape[0] * width / rgb.shape[1]))
    method = cv2.INTER_AREA if interpolate else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(rgb, (width, height), interpolation=method), np.uint8)


def _apply_colormap(
    values: NDArray[Any], low: float, high: float, colormap: int, valid: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """Map values, (H, W), from ``low`` on to RGB by OpenCV's colormap; pixels that are not ``valid`` become black."""
    scaled = (values.astype(np.float32) - np.float32(low)) * np.float32(255.0 / max(high - low, 1e-6))
    levels = np.nan_to_num(scaled, posinf=0.0, neginf=0.0).clip(0, 255).astype(np.uint8)
    bgr = np.asarray(cv2.applyColorMap(levels, colormap), np.uint8)
    bgr[~valid] = 0
    return np.ascontiguousarray(bgr[:, :, ::-1])
