"""The last requests of the render endpoint and their images, which the page lists."""

from collections.abc import Sequence

import cv2
import numpy as np

from gateway.adapters.viewer.colormaps import depth_to_rgb, gray_to_rgb, shrink_to_width
from gateway.adapters.viewer.messages import RenderEntry
from gateway.runtime.logs.render_record import RenderRecord
from renderers.encode import png_rgb


def render_entries(renders: Sequence[RenderRecord]) -> list[RenderEntry]:
    """Return requests, oldest first, as the page lists them: newest first."""
    return [
        RenderEntry(
            id=record.number,
            when=record.end_time,
            status=record.status,
            milliseconds=round(record.seconds * 1e3, 2),
            queued=round(record.queue_seconds * 1e3, 2),
            what=record.image_text,
            scene=record.scene_text,
            image=bool(record.body),
            error=record.error,
            warnings=record.warnings,
        )
        for record in reversed(renders)
    ]


def encode_preview(record: RenderRecord, width: int | None) -> bytes:
    """Return a request's image as a PNG, at most a width (None: any). Depth is mapped to colours. Raises ValueError."""
    if record.media_type == "image/png" and width is None and record.kind != "depth":
        return record.body
    pixels = cv2.imdecode(np.frombuffer(record.body, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise ValueError(f"an image of type {record.media_type} cannot be displayed")
    if record.kind == "depth":
        rgb = depth_to_rgb(np.asarray(pixels))
    else:
        bgr = gray_to_rgb(np.asarray(pixels, np.uint8))  # OpenCV's order; a fourth channel is alpha
        rgb = np.ascontiguousarray(bgr[:, :, 2::-1])
    return png_rgb(shrink_to_width(rgb, width, interpolate=record.kind != "label"))
