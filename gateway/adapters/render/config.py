"""Configuration and limits of the render endpoint."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from gateway.files.gltf.gltf_errors import GltfLimits
from gateway.scene.draw.style import Style


@dataclass(frozen=True, slots=True)
class RenderConfig:
    """Settings of ``POST /render``."""

    path: str = "/render"
    """URL path. Drake's client posts to ``render`` below its base URL by default."""

    style: Style = field(default_factory=lambda: Style(samples=1))
    """Shading. ``style.look`` is the name of a look, or ``auto``: the one that RenderEngineVtk would use for a scene of
    Drake's client, and ``gltf`` for scenes of other programs. A request's form may name another."""
    depth_format: Literal["tiff", "png"] = "tiff"
    """``tiff``: 32-bit float TIFF in metres. ``png``: 16-bit PNG in millimetres, 0 too close, 65535 too far."""

    max_body_bytes: int = 256 << 20
    """Size of one request's body. Scenes of Drake's users have 20 to 30 MB with textures, rarely more than 100 MB."""
    max_inflight_bytes: int = 2 << 30
    """Total size of the bodies that are being received, waiting or being rendered, so that many large uploads cannot
    exhaust the memory. Uploads beyond it get 503."""
    receive_timeout: float = 60.0
    """Time in seconds without a byte before an upload is rejected (408): a stalled client must not hold memory."""
    arrival_seconds: float = 5.0
    """Seconds for which an upload holds its place in the queue: 25 MB take 2 s at 100 Mbit/s. A slower one queues again
    when it is complete, or gets 503 if the queue is full then, so that slow clients do not keep others out."""
    max_parts: int = 64
    """Parts of the form; the protocol has 17 fields."""
    max_part_headers: int = 16
    """Headers per part; Drake's client sends two."""
    max_header_bytes: int = 4096
    """Size of a part's header line, which has a file name and some parameters. The request's Content-Type has the same
    limit, since parsing one of 64 kB takes 50 ms."""
    max_field_bytes: int = 1024
    """Size of a text field; the longest one of the protocol is a hash of 64 characters."""
    max_pixels: int = 4096 * 4096
    """width * height: rendering an image of this size takes about 200 MB."""
    max_side: int = 16384
    """Width or height in pixels: float32 raster coordinates up to here are exact, with 10 bits for subpixels."""
    gltf: GltfLimits = field(default_factory=GltfLimits)
    """Limits on the content of the scene: nodes, vertices, decoded pixels."""

    scene_cache_count: int = 64
    """Number of scenes in the cache of whole scenes, for cameras and objects that do not move."""

    recent_count: int = 24
    """Number of finished requests that are kept for the browser view, with their images."""
    recent_bytes: int = 64 << 20
    """Maximum size of these images. Beyond it, the oldest ones are dropped."""

    strict: bool = False
    """True: a scene with a warning is refused."""
    keep_failures: Path | None = None
    """Folder in which failed requests are stored for replay; None: they are not stored."""
    keep_failures_count: int = 100
    """Number of requests in that folder; the oldest are deleted first."""
    keep_failures_bytes: int = 1 << 30
    """Total size of the bodies in that folder; the oldest requests are deleted first. A single larger body is not
    stored."""
