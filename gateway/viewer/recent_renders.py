"""The last requests of the render endpoint and their images, which the page lists."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from gateway.viewer.colormaps import depth_to_rgb, gray_to_rgb, shrink_to_width
from gateway.viewer.messages import RenderEntry
from gateway.viewer.sources import RenderSummary
from renderers.encode import png_rgb


@dataclass(slots=True)
class _Entry:
    """A request in the list."""

    number: int
    """Number of the request since start, from 1."""
    time: float
    """Time of the response, in seconds since 1970."""
    summary: RenderSummary
    encoded_image: bytes
    """The image as it was sent; empty if there is none or it was dropped."""


class RecentRenders:
    """The newest requests, limited in number and in bytes of images. Not thread-safe: used in the event loop only."""

    def __init__(self, max_count: int, max_bytes: int, clock: Callable[[], float] = time.time) -> None:
        self._entries: deque[_Entry] = deque(maxlen=max_count)
        self._max_bytes = max_bytes
        self._clock = clock
        self.count = 0
        """Number of requests since start."""

    def add(self, summary: RenderSummary) -> None:
        """Add a finished request. Drop the oldest images if all exceed the limit."""
        self.count += 1
        self._entries.append(_Entry(self.count, self._clock(), summary, summary.body))
        image_bytes = 0
        for entry in reversed(self._entries):
            image_bytes += len(entry.encoded_image)
            if image_bytes > self._max_bytes:
                entry.encoded_image = b""

    def listing(self) -> list[RenderEntry]:
        """Return the requests, newest first."""
        return [
            RenderEntry(
                id=entry.number,
                when=entry.time,
                status=entry.summary.status,
                milliseconds=round(entry.summary.seconds * 1e3, 2),
                queued=round(entry.summary.queue_seconds * 1e3, 2),
                what=entry.summary.image_text,
                scene=entry.summary.scene_text,
                image=bool(entry.encoded_image),
                error=entry.summary.error,
                warnings=entry.summary.warnings,
            )
            for entry in reversed(self._entries)
        ]

    def find(self, number: int) -> tuple[RenderSummary, bytes] | None:
        """Return a request and its encoded image, or None if the request or the image is no longer kept."""
        for entry in self._entries:
            if entry.number == number and entry.encoded_image:
                return entry.summary, entry.encoded_image
        return None


def encode_preview(summary: RenderSummary, encoded_image: bytes, width: int | None) -> bytes:
    """Return a request's image as a PNG that browsers can display. Depth is mapped to colours.

    Args:
        summary: the request.
        encoded_image: its image as it was sent.
        width: maximum width in pixels; None: no maximum.
    Raises:
        ValueError: the image cannot be decoded.
    """
    if summary.media_type == "image/png" and width is None and summary.kind != "depth":
        return encoded_image
    pixels = cv2.imdecode(np.frombuffer(encoded_image, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise ValueError(f"an image of type {summary.media_type} cannot be displayed")
    if summary.kind == "depth":
        rgb = depth_to_rgb(np.asarray(pixels))
    else:
        bgr = gray_to_rgb(np.asarray(pixels, np.uint8))  # OpenCV's order; a fourth channel is alpha
        rgb = np.ascontiguousarray(bgr[:, :, 2::-1])
    return png_rgb(shrink_to_width(rgb, width, interpolate=summary.kind != "label"))
