"""The stereo camera's images as JPEG, captured once for all browsers and only on request."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.viewer.colormaps import confidence_to_rgb, disparity_to_rgb, gray_to_rgb, shrink_to_width
from gateway.viewer.shared_results import SharedResults
from gateway.viewer.sources import ImageName, StereoImages
from renderers.encode import jpeg_rgb

MAX_ENCODED_IMAGES: Final = 16
"""Maximum number of encoded images that are kept: four images in four sizes; the page requests two sizes."""


@dataclass(frozen=True, slots=True)
class Capture:
    """A numbered set of images."""

    number: int
    images: StereoImages

    def describe(self) -> dict[str, Any]:
        """Return number and captions as JSON values."""
        return {"number": self.number, "captions": dict(self.images.captions)}


class SensorImages:
    """The newest images of the stereo camera; a request replaces those that are older than ``max_age`` seconds."""

    def __init__(self, capture: Callable[[], Awaitable[StereoImages]], max_age: float) -> None:
        self._capture_images = capture
        self._max_age = max_age
        self._captures: SharedResults[int, Capture] = SharedResults(1)
        self._jpegs: SharedResults[tuple[int, ImageName, int], bytes] = SharedResults(MAX_ENCODED_IMAGES)
        self._newest: Capture | None = None
        self._next_number = 1
        self._expires = -math.inf
        """Loop time at which the newest capture is too old."""

    async def capture(self) -> Capture:
        """Return a capture of at most ``max_age`` seconds.

        Raises:
            Exception: The stereo camera raised it.
        """
        if self._newest is not None and asyncio.get_running_loop().time() < self._expires:
            return self._newest
        return await self._captures.get(self._next_number, self._capture)

    async def last(self) -> Capture:
        """Return the newest capture, however old; capture now if there is none."""
        return self._newest or await self.capture()

    async def jpeg(self, capture: Capture, name: ImageName, width: int | None) -> bytes:
        """Return an image of a capture as JPEG, at most ``width`` pixels wide."""
        pixels: NDArray[Any] = getattr(capture.images, name)
        width = min(width or pixels.shape[1], pixels.shape[1])
        return await self._jpegs.get(
            (capture.number, name, width), lambda: asyncio.to_thread(encode_image, name, pixels, width)
        )

    async def _capture(self) -> Capture:
        images = await self._capture_images()
        capture = self._newest = Capture(self._next_number, images)
        self._next_number += 1
        self._expires = asyncio.get_running_loop().time() + self._max_age
        return capture


def encode_image(name: ImageName, pixels: NDArray[Any], width: int) -> bytes:
    """Encode an image of the stereo camera as JPEG; disparity and confidence are coloured."""
    if name == "disparity":
        rgb = disparity_to_rgb(pixels)
    elif name == "confidence":
        rgb = confidence_to_rgb(pixels)
    else:
        rgb = gray_to_rgb(pixels)
    return jpeg_rgb(np.ascontiguousarray(shrink_to_width(rgb, width)))
