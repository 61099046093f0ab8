"""Configuration and limits of the render endpoint."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from gateway.gltf.limits import GltfLimits
from renderers.interface import LookName, SampleCount


@dataclass(frozen=True, slots=True)
class RenderConfig:
    """Settings of ``POST /render``."""

    path: str = "/render"
    """URL path. The default of Drake's client is ``render`` below its base URL."""

    look: Literal["auto", "phong", "pbr", "gltf"] = "auto"
    """Shading model. ``auto`` selects by ``asset.generator`` what RenderEngineVtk itself uses for the scene."""
    samples: SampleCount = 1
    """Samples per pixel of colour images (MSAA); more than one replaces FXAA."""
    default_look: LookName = "gltf"
    """Shading model with ``auto`` for scenes from other generators than VTK and Drake's merger."""
    background: tuple[int, int, int] = (204, 229, 255)
    """RGB of the background of colour images; the default of Drake's engines."""
    antialias: Literal["fxaa", "none"] = "fxaa"
    """Antialiasing of colour images. RenderEngineVtk uses FXAA: with it 0.0 to 0.5 % of the values differ from VTK's
    images, without it 0.2 to 3.4 %. RenderEngineGl has no antialiasing."""
    depth_format: Literal["tiff32f", "png16"] = "tiff32f"
    """``tiff32f``: 32-bit float TIFF in metres. ``png16``: 16-bit PNG in millimetres, 0 too close, 65535 too far."""

    max_body_bytes: int = 256 << 20
    """Body of one request. Scenes of Drake's users have 20 to 30 MB with textures, rarely more than 100 MB."""
    max_inflight_bytes: int = 2 << 30
    """All bodies that are being received, waiting or being rendered, so that many large uploads cannot exhaust the
    memory; further data gets 503."""
    receive_timeout: float = 60.0
    """Seconds without a byte before an upload is rejected (408): a stalled client must not hold memory."""
    arrival_seconds: float = 5.0
    """Time for which an arriving body reserves a place in the queue: a scene of 25 MB takes 2 s at 100 Mbit/s. Slower
    ones may find the queue full when they are complete: slow clients must not keep others out."""
    max_parts: int = 64
    """Parts of the form; the protocol has 17."""
    max_part_headers: int = 16
    """Headers per part; Drake's client sends two."""
    max_header_bytes: int = 4096
    """Header line of a part, which has a file name and some parameters. Also the request's Content-Type, since parsing
    one of 64 kB takes 50 ms."""
    max_field_bytes: int = 1024
    """Text field; the longest one of the protocol is a hash of 64 characters."""
    max_pixels: int = 4096 * 4096
    """width * height: rendering an image of this size takes about 200 MB."""
    max_side: int = 16384
    """Width or height in pixels: up to here float32 raster coordinates are exact, with 10 bits for subpixels."""
    gltf: GltfLimits = field(default_factory=GltfLimits)
    """Limits on the content of the scene: nodes, vertices, decoded pixels."""

    mesh_cache_bytes: int = 512 << 20
    """Cache of decoded geometry: Drake sends the whole scene for every image."""
    scene_cache_bytes: int = 256 << 20
    """Cache of whole scenes, by the size of their glTF, for cameras and objects that do not move."""
    scene_cache_count: int = 64
    """Scenes in that cache."""

    keep_failures: Path | None = None
    """Folder for failed requests, for replay; None: they are not stored."""
    keep_failures_count: int = 100
    """Requests in that folder; the oldest are deleted first."""
    keep_failures_bytes: int = 1 << 30
    """Bytes in that folder; the oldest requests are deleted first, and larger ones are not stored."""
