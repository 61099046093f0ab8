"""The last requests of the render endpoint and their images, which the page lists."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

import cv2
import numpy as np

from gateway.runtime.render_record import RenderRecord
from gateway.viewer.colormaps import depth_to_rgb, gray_to_rgb, shrink_to_width
from gateway.viewer.messages import RenderEntry
from renderers.encode import png_rgb


class RecentRenders:
    """The newest requests, limited in number and in bytes of images. Not thread-safe: used in the event loop only."""

    def __init__(self, max_count: int, max_bytes: int, clock: Callable[[], float] = time.time) -> None:
        self._entries: deque[tuple[RenderEntry, RenderRecord | None]] = deque(maxlen=max_count)
        """Requests, oldest first, as the page lists them, and with their image unless it was dropped."""
        self._max_bytes = max_bytes
        self._clock = clock
        self.count = 0
        """Number of requests since start."""

    def add(self, summary: RenderRecord) -> None:
        """Add a finished request. Drop the oldest images if all exceed the limit."""
        self.count += 1
        entry = RenderEntry(
            id=self.count,
            when=self._clock(),
            status=summary.status,
            milliseconds=round(summary.seconds * 1e3, 2),
            queued=round(summary.queue_seconds * 1e3, 2),
            what=summary.image_text,
            scene=summary.scene_text,
            image=bool(summary.body),
            error=summary.error,
            warnings=summary.warnings,
        )
        self._entries.append((entry, summary if summary.body else None))
        image_bytes = 0
        for index in range(len(self._entries) - 1, -1, -1):
            entry, image = self._entries[index]
            image_bytes += len(image.body) if image is not None else 0
            if image_bytes > self._max_bytes:
                entry.image = False
                self._entries[index] = entry, None

    def listing(self) -> list[RenderEntry]:
        """Return the requests, newest first."""
        return [entry for entry, _ in reversed(self._entries)]

    def find(self, number: int) -> RenderRecord | None:
        """Return a request with its image, or None if the request or the image is no longer kept."""
        return next((image for entry, image in self._entries if entry.id == number), None)


def encode_preview(summary: RenderRecord, width: int | None) -> bytes:
    """Return a request's image as a PNG that browsers can display. Depth is mapped to colours.

    Args:
        summary: the request.
        width: maximum width in pixels; None: no maximum.
    Raises:
        ValueError: the image cannot be decoded.
    """
    if summary.media_type == "image/png" and width is None and summary.kind != "depth":
        return summary.body
    pixels = cv2.imdecode(np.frombuffer(summary.body, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise ValueError(f"an image of type {summary.media_type} cannot be displayed")
    if summary.kind == "depth":
        rgb = depth_to_rgb(np.asarray(pixels))
    else:
        bgr = gray_to_rgb(np.asarray(pixels, np.uint8))  # OpenCV's order; a fourth channel is alpha
        rgb = np.ascontiguousarray(bgr[:, :, 2::-1])
    return png_rgb(shrink_to_width(rgb, width, interpolate=summary.kind != "label"))
