"""The last requests of the render endpoint, for the page's list."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from gateway.viewer.colormaps import depth_to_rgb, gray_to_rgb, shrink_to_width
from gateway.viewer.sources import RenderSummary
from renderers.encode import png_rgb


@dataclass(slots=True)
class _Entry:
    number: int
    time: float
    summary: RenderSummary
    body: bytes
    """The image; empty if there is none or it was dropped."""


class RecentRenders:
    """The newest requests, limited in number and in bytes of images. Belongs to the event loop."""

    def __init__(self, max_count: int, max_bytes: int, clock: Callable[[], float] = time.time) -> None:
        self._entries: deque[_Entry] = deque(maxlen=max_count)
        self._max_bytes = max_bytes
        self._clock = clock
        self.count = 0
        """Number of requests since start."""

    def add(self, summary: RenderSummary) -> None:
        """Add a finished request; drop the oldest images beyond the limit."""
        self.count += 1
        self._entries.append(_Entry(self.count, self._clock(), summary, summary.body))
        nbytes = 0
        for entry in reversed(self._entries):
            nbytes += len(entry.body)
            if nbytes > self._max_bytes:
                entry.body = b""

    def listing(self) -> list[dict[str, Any]]:
        """Return the requests as JSON values, newest first."""
        return [
            {
                "id": entry.number,
                "when": entry.time,
                "status": entry.summary.status,
                "milliseconds": round(entry.summary.seconds * 1e3, 2),
                "queued": round(entry.summary.queue_seconds * 1e3, 2),
                "what": entry.summary.image_text,
                "scene": entry.summary.scene_text,
                "image": bool(entry.body),
                "error": entry.summary.error,
                "warnings": list(entry.summary.warnings),
            }
            for entry in reversed(self._entries)
        ]

    def find(self, number: int) -> tuple[RenderSummary, bytes] | None:
        """Return a request and its image; None if the request is unknown or its image was dropped."""
        for entry in self._entries:
            if entry.number == number and entry.body:
                return entry.summary, entry.body
        return None


def encode_preview(summary: RenderSummary, body: bytes, width: int | None) -> bytes:
    """Return a request's image as a PNG that browsers display, at most ``width`` pixels wide; depth is coloured.

    Raises:
        ValueError: The image cannot be decoded.
    """
    if summary.media_type == "image/png" and width is None and summary.kind != "depth":
        return body
    pixels = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise ValueError(f"an image of type {summary.media_type} cannot be displayed")
    if summary.kind == "depth":
        rgb = depth_to_rgb(np.asarray(pixels))
    else:
        rgb = np.ascontiguousarray(gray_to_rgb(np.asarray(pixels, np.uint8))[:, :, 2::-1])
    return png_rgb(shrink_to_width(rgb, width, interpolate=summary.kind != "label"))
