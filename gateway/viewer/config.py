"""Bounds and pace of the browser view."""

from __future__ import annotations

from dataclasses import dataclass

from renderers.interface import LookName, SampleCount
from renderers.light_rig import STUDIO, Rig


@dataclass(frozen=True, slots=True)
class ViewerConfig:
    """What is fixed from start to end."""

    rate: float = 90.0
    """Updates per second at most. More than screens show, so that no step of a publisher at 60 Hz falls between two."""
    max_browsers: int = 64
    """Connections at a time; each costs a socket buffer and up to one update of memory."""
    max_paths: int = 1_000_000
    """Different paths that are numbered before browsers start over: about 300 bytes each."""
    status_seconds: float = 1.0
    """Between two looks at the state of the gateway for the status bar."""
    patience_seconds: float = 10.0
    """For a page to take an update in. Until then the gateway keeps the scene that the page has, to send no more than
    what changed; later it sends the structure anew, so that a page that hangs holds no geometry that was deleted."""
    sensor_seconds: float = 0.4
    """Between two takes of the stereo camera for all browsers together; a take renders four pictures."""
    max_renders: int = 24
    """Remembered render requests."""
    max_render_bytes: int = 64 << 20
    """Of their pictures; beyond it the oldest lose theirs."""
    background: tuple[int, int, int] = (204, 229, 255)
    """RGB where nothing is, in pictures of our own rasterizer."""
    look: LookName = "studio"
    """Of single pictures that ask for none."""
    samples: SampleCount = 4
    """A pixel of the studio look; the others have one."""
    rig: Rig = STUDIO
    """What lights the studio look."""
    stream_look: LookName = "plain"
    """Of MJPEG streams that ask for none: the same colours as the page shows, and a fraction of the time."""
    width: int = 960
    """Pixels of a picture that asks for no size."""
    height: int = 640
    max_side: int = 4096
    """Pixels; screens are no wider."""
    max_pixels: int = 4096 * 2160
    max_streams: int = 8
    """MJPEG clients at a time: each different camera or size costs a rendering per frame."""
    stream_rate: float = 30.0
    """Frames per second of an MJPEG stream at most."""
