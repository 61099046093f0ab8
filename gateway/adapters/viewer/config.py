"""Limits and defaults of the browser view. ``gateway.wiring`` creates the configuration."""

from dataclasses import dataclass, field
from importlib.resources import files
from typing import Final

from gateway.scene.draw.style import Style
from renderers.interface import LookName

STATIC: Final = files("gateway.adapters.viewer") / "static"
"""Folder with the files of the page, built from ``web``."""


@dataclass(frozen=True, slots=True)
class ViewerConfig:
    """Configuration of the browser view; fixed while the gateway runs."""

    max_update_rate: float = 90.0
    """Maximum number of updates per second. It exceeds 60, so that every change of a 60 Hz publisher is shown."""
    max_browsers: int = 64
    """Maximum number of connected browsers. Each takes the memory of a socket buffer and of up to one update."""
    max_node_ids: int = 1_000_000
    """Maximum number of node paths that have an id. Each takes about 300 bytes. Beyond it, all ids are dropped, and
    every browser receives the whole scene again."""
    status_seconds: float = 1.0
    """Interval between updates of the status bar."""
    ack_timeout_seconds: float = 10.0
    """Maximum time until a page acknowledges an update. Until then the gateway keeps the page's snapshot, so that the
    next update contains only the differences. Then it releases the snapshot, because a page that hangs must not keep
    deleted geometry in the gateway's memory. The next update is then the whole scene."""
    capture_seconds: float = 0.4
    """Minimum interval between captures of the stereo camera. A capture renders four images, for all browsers."""
    style: Style = field(default_factory=Style)
    """Shading of images that the gateway renders; ``look``, ``stream_look`` or a request name the look."""
    look: LookName = "studio"
    """Default look of single images."""
    stream_look: LookName = "plain"
    """Default look of MJPEG streams. ``plain`` takes a fraction of ``studio``'s time."""
    width: int = 960
    """Default width in pixels."""
    height: int = 640
    """Default height in pixels."""
    max_side: int = 4096
    """Maximum width and maximum height in pixels. No common screen has more."""
    max_pixels: int = 4096 * 2160
    """Maximum number of pixels of an image."""
    max_streams: int = 8
    """Maximum number of MJPEG clients. Clients share images if their camera, size, quality and look are equal."""
    max_stream_rate: float = 30.0
    """Maximum frame rate of an MJPEG stream, Hz."""
