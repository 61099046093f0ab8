"""The stereo camera's images as JPEG, for ``image_routes``. They are captured on request, once for all browsers.

Depth, disparity and confidence are mapped to colours.
"""

import asyncio
import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.viewer.messages import ImageName
from gateway.adapters.viewer.sources import StereoImages
from gateway.runtime.workers.shared_results import SharedResults
from renderers.encode import jpeg_rgb

MAX_ENCODED_IMAGES: Final = 16
"""Maximum number of encoded images that are kept: four images in four sizes each. The page requests two sizes."""


@dataclass(frozen=True, slots=True)
class Capture:
    """One set of images of the stereo camera."""

    number: int
    """Number of the capture since start, from 1."""
    images: StereoImages


class SensorImages:
    """The newest images of the stereo camera. Not thread-safe: used in the event loop only."""

    def __init__(self, capture: Callable[[], Awaitable[StereoImages]], max_age: float) -> None:
        """``max_age``: seconds after which ``fresh_capture`` replaces the images."""
        self._source = capture
        self._max_age = max_age
        self._captures: SharedResults[int, Capture] = SharedResults(1)
        self._jpegs: SharedResults[tuple[int, ImageName, int], bytes] = SharedResults(MAX_ENCODED_IMAGES)
        self._newest: Capture | None = None
        self._next_number = 1
        self._expiry_time = -math.inf
        """Time at which the newest capture becomes too old, in seconds of the event loop's clock."""

    async def fresh_capture(self) -> Capture:
        """Return the newest capture; replace it if it is older than ``max_age``. Raises the camera's own errors."""
        if self._newest is not None and asyncio.get_running_loop().time() < self._expiry_time:
            return self._newest
        return await self._captures.get(self._next_number, self._capture_now)  # one capture for all who wait for it

    async def last_capture(self) -> Capture:
        """Return the newest capture, of any age. Capture now only if there is none."""
        return self._newest or await self.fresh_capture()

    async def jpeg(self, capture: Capture, name: ImageName, width: int | None) -> bytes:
        """Return an image of a capture as JPEG. ``width``: maximum width in pixels; None: no maximum."""
        pixels: NDArray[Any] = getattr(capture.images, name)
        width = min(width or pixels.shape[1], pixels.shape[1])
        return await self._jpegs.get(
            (capture.number, name, width), lambda: asyncio.to_thread(encode_image, name, pixels, width)
        )

    async def _capture_now(self) -> Capture:
        """Capture a set of images now, and store it as the newest."""
        images = await self._source()
        capture = self._newest = Capture(self._next_number, images)
        self._next_number += 1
        self._expiry_time = asyncio.get_running_loop().time() + self._max_age
        return capture


def encode_image(name: ImageName, pixels: NDArray[Any], width: int) -> bytes:
    """Encode an image of ``StereoImages`` as JPEG, at most a width. Disparity and confidence are mapped to colours."""
    if name == "disparity":
        rgb = disparity_to_rgb(pixels)
    elif name == "confidence":
        rgb = confidence_to_rgb(pixels)
    else:
        rgb = gray_to_rgb(pixels)
    return jpeg_rgb(np.ascontiguousarray(shrink_to_width(rgb, width)))


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
