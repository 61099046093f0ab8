"""The stereo camera's pictures as JPEG: taken once for all browsers, and only while somebody asks."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.viewer.shared_task import SharedTask
from gateway.viewer.sources import PICTURE_NAMES, PictureName, SensorPictures
from renderers.encode import jpeg_rgb

MAX_WIDTHS: Final = 4
"""Encoded sizes kept of one picture; the page asks for two."""
_SPREAD: Final = (1.0, 99.0)
"""Percentiles of the disparities that the colours span: single outliers must not flatten the rest."""


class Take:
    """One set of pictures."""

    def __init__(self, number: int, pictures: SensorPictures) -> None:
        self.number = number
        self._pictures = pictures
        self._encoded: dict[tuple[PictureName, int], bytes] = {}

    def describe(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {"number": self.number, "captions": dict(self._pictures.captions)}

    async def jpeg(self, name: PictureName, width: int | None) -> bytes:
        """A picture, made smaller to ``width`` pixels when it is wider."""
        pixels: NDArray[Any] = getattr(self._pictures, name)
        wanted = min(width or pixels.shape[1], pixels.shape[1])
        key = (name, wanted)
        if key not in self._encoded:
            data = await asyncio.to_thread(encode, name, pixels, wanted)
            if len(self._encoded) >= MAX_WIDTHS * len(PICTURE_NAMES):
                self._encoded.clear()
            self._encoded[key] = data
        return self._encoded[key]


class SensorView:
    """Gives the newest set, and takes another one when that is too old."""

    def __init__(self, take: Callable[[], Awaitable[SensorPictures]], seconds: float) -> None:
        self._take = take
        self._seconds = seconds
        self._number = 0
        self._newest: Take | None = None
        self._next = 0.0
        self._running: SharedTask[Take] | None = None

    async def newest(self) -> Take:
        """A set that is not older than the configured time; whoever asks meanwhile gets the same.

        Raises whatever the port raises.
        """
        loop = asyncio.get_running_loop()
        if self._newest is not None and loop.time() < self._next:
            return self._newest
        if self._running is None or self._running.task.done() or not self._running.usable:
            self._running = SharedTask(self._taken())
        return await self._running.result()

    async def last(self) -> Take:
        """The newest set that there is, however old; taken when there is none."""
        return self._newest or await self.newest()

    async def _taken(self) -> Take:
        pictures = await self._take()
        self._number += 1
        self._newest = Take(self._number, pictures)
        self._next = asyncio.get_running_loop().time() + self._seconds
        return self._newest


def encode(name: PictureName, pixels: NDArray[Any], width: int) -> bytes:
    """JPEG for people: disparity and confidence coloured, black where invalid."""
    if name == "disparity":
        valid = pixels > 0
        low, high = np.percentile(pixels[valid], _SPREAD) if valid.any() else (0.0, 1.0)
        rgb = _colored(pixels, float(low), float(high), cv2.COLORMAP_TURBO, valid)
    elif name == "confidence":
        rgb = _colored(pixels, 0.0, 255.0, cv2.COLORMAP_VIRIDIS, pixels > 0)
    else:
        rgb = pixels if pixels.ndim == 3 else np.repeat(pixels[:, :, None], 3, axis=2)
    if width < rgb.shape[1]:
        height = max(1, round(rgb.shape[0] * width / rgb.shape[1]))
        rgb = np.asarray(cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    return jpeg_rgb(rgb)


def _colored(values: NDArray[Any], low: float, high: float, colors: int, valid: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(H, W, 3) RGB; ``low`` .. ``high`` span the colour map."""
    scaled = (values.astype(np.float32) - low) * np.float32(255.0 / max(high - low, 1e-6))
    bgr = np.asarray(cv2.applyColorMap(scaled.clip(0, 255).astype(np.uint8), colors), np.uint8)
    bgr[~valid] = 0
    return np.ascontiguousarray(bgr[:, :, ::-1])
