"""The last render requests, so that a Drake user sees what the server saw."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.viewer.sources import RenderNote
from renderers.encode import png_rgb

_FARTHEST: Final = 95.0
"""Percentile of the depths that the colours reach to: a floor that goes to the horizon must not flatten the rest."""


@dataclass(slots=True)
class _Kept:
    number: int
    when: float
    note: RenderNote
    body: bytes


class RecentRenders:
    """Bounded in number and bytes; lives on the event loop."""

    def __init__(self, most: int, most_bytes: int, clock: Callable[[], float] = time.time) -> None:
        self._kept: deque[_Kept] = deque(maxlen=most)
        self._most_bytes = most_bytes
        self._clock = clock
        self.count = 0
        """Requests answered since start."""

    def add(self, note: RenderNote) -> None:
        """Remembers a request that was answered."""
        self.count += 1
        self._kept.append(_Kept(self.count, self._clock(), note, note.body))
        size = 0
        for kept in reversed(self._kept):
            size += len(kept.body)
            if size > self._most_bytes:
                kept.body = b""

    def listing(self) -> list[dict[str, Any]]:
        """Newest first; plain JSON values."""
        return [
            {
                "id": kept.number,
                "when": kept.when,
                "status": kept.note.status,
                "milliseconds": round(kept.note.seconds * 1e3, 2),
                "queued": round(kept.note.queued * 1e3, 2),
                "what": kept.note.what,
                "scene": kept.note.scene,
                "picture": bool(kept.body),
                "error": kept.note.error,
            }
            for kept in reversed(self._kept)
        ]

    def find(self, number: int) -> tuple[RenderNote, bytes] | None:
        """A request and its picture, unless they are forgotten."""
        for kept in self._kept:
            if kept.number == number and kept.body:
                return kept.note, kept.body
        return None


def shown(note: RenderNote, body: bytes, width: int | None) -> bytes:
    """A picture as a PNG that browsers show; depth is coloured from near (red) to far (blue), black where nothing is.

    Raises:
        ValueError: the picture cannot be read.
    """
    if note.media_type == "image/png" and width is None and note.kind != "depth":
        return body
    pixels = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise ValueError(f"a picture of type {note.media_type} cannot be shown")
    rgb = _depth_colors(np.asarray(pixels)) if note.kind == "depth" else _rgb(np.asarray(pixels))
    if width is not None and width < rgb.shape[1]:
        height = max(1, round(rgb.shape[0] * width / rgb.shape[1]))
        # Labels are numbers: between two of them there is a third one, not a mixture.
        how = cv2.INTER_NEAREST if note.kind == "label" else cv2.INTER_AREA
        rgb = np.asarray(cv2.resize(rgb, (width, height), interpolation=how), np.uint8)
    return png_rgb(rgb)


def _rgb(pixels: NDArray[Any]) -> NDArray[np.uint8]:
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[:, :, None], 3, axis=2)
    return np.ascontiguousarray(pixels[:, :, 2::-1].astype(np.uint8))


def _depth_colors(depth: NDArray[Any]) -> NDArray[np.uint8]:
    """(H, W) metres or millimetres -> (H, W, 3)."""
    values = depth.astype(np.float32)
    far = 65535.0 if depth.dtype == np.uint16 else np.inf
    valid = np.isfinite(values) & (values > 0.0) & (values < far)
    rgb = np.zeros((*values.shape, 3), np.uint8)
    if valid.any():
        low, high = float(values[valid].min()), float(np.percentile(values[valid], _FARTHEST))
        scaled = np.nan_to_num((high - values) * np.float32(255.0 / max(high - low, 1e-6)), posinf=0.0, neginf=0.0)
        colored = np.asarray(cv2.applyColorMap(scaled.clip(0, 255).astype(np.uint8), cv2.COLORMAP_TURBO))
        rgb[valid] = colored[valid][:, ::-1]
    return rgb
