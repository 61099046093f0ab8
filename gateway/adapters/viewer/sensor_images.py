"""The stereo camera's images as JPEG, for ``image_routes``. They are captured on request, once for all browsers."""

import asyncio
import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.viewer.colormaps import confidence_to_rgb, disparity_to_rgb, gray_to_rgb, shrink_to_width
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
