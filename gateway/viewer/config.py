"""Limits and defaults of the browser view."""

from __future__ import annotations

from dataclasses import dataclass

from renderers.interface import LookName, SampleCount
from renderers.light_rig import STUDIO, Rig


@dataclass(frozen=True, slots=True)
class ViewerConfig:
    """Configuration of the browser view; fixed while the gateway runs."""

    max_update_rate: float = 90.0
    """Maximum number of updates per second. Above 60 Hz, so that no step of a 60 Hz publisher is skipped."""
    max_browsers: int = 64
    """Maximum number of connected browsers. Each takes a socket buffer and up to one update of memory."""
    max_node_ids: int = 1_000_000
    """Maximum number of numbered paths, about 300 bytes each. Beyond it all ids are dropped and every browser gets the
    whole scene again."""
    status_seconds: float = 1.0
    """Interval between updates of the status bar."""
    ack_timeout_seconds: float = 10.0
    """Time a page may take to process an update. Until then the gateway keeps the snapshot that the page has, so that
    the next update holds the differences only. After it the next update is the whole scene: a page that hangs must not
    keep deleted geometry in memory."""
    capture_seconds: float = 0.4
    """Minimum interval between captures of the stereo camera, shared by all browsers. A capture renders four images."""
    max_renders: int = 24
    """Maximum number of render requests in the list."""
    max_render_bytes: int = 64 << 20
    """Maximum size of their images together. Beyond it the oldest requests lose their images."""
    background: tuple[int, int, int] = (204, 229, 255)
    """RGB background of images that the gateway renders."""
    look: LookName = "studio"
    """Default look of single images."""
    samples: SampleCount = 4
    """Samples per pixel of the studio look; the other looks have one."""
    rig: Rig = STUDIO
    """Lights of the studio look."""
    stream_look: LookName = "plain"
    """Default look of MJPEG streams: the page's own colours, in a fraction of the time."""
    width: int = 960
    """Default width in pixels."""
    height: int = 640
    """Default height in pixels."""
    max_side: int = 4096
    """Maximum width and height in pixels; no common screen has more."""
    max_pixels: int = 4096 * 2160
    """Maximum number of pixels of an image."""
    max_streams: int = 8
    """Maximum number of MJPEG clients. Each combination of camera and size costs a rendering per frame."""
    max_stream_rate: float = 30.0
    """Maximum frame rate of an MJPEG stream, Hz."""
