"""What an operator can set about the render endpoint; every bound states its reason."""

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
    """Of the endpoint; Drake's client default is ``render`` below its base URL."""

    look: Literal["auto", "phong", "pbr"] = "auto"
    samples: SampleCount = 1
    """Samples a pixel of colour; with more than one there is no FXAA."""
    """``auto`` follows ``asset.generator``: what RenderEngineVtk itself would have used for the scene."""
    default_look: LookName = "pbr"
    """With ``auto``, for scenes that neither VTK nor Drake's merger wrote: glTF's own material model."""
    background: tuple[int, int, int] = (204, 229, 255)
    """RGB of colour pictures where nothing is; the default of Drake's engines."""
    antialias: Literal["fxaa", "none"] = "fxaa"
    """Of colour pictures. RenderEngineVtk has FXAA on, and with it the pictures differ from its own in 0.0 to 0.5 % of
    the values instead of 0.2 to 3.4; RenderEngineGl has none."""
    depth_format: Literal["tiff32f", "png16"] = "tiff32f"
    """``tiff32f``: 32-bit float TIFF in metres; ``png16``: 16-bit PNG in millimetres, 0 too close, 65535 too far."""

    max_body_bytes: int = 256 << 20
    """Of one request. Real scenes of Drake's users are 20 to 30 MB (textures included), rarely above 100 MB."""
    max_inflight_bytes: int = 2 << 30
    """Of all bodies that are being received, waiting or rendered, so that many large uploads at once cannot exhaust
    the memory; beyond it new data is answered with 503."""
    receive_timeout: float = 60.0
    """Seconds without a byte after which an upload is given up (408): a client that stalls must not hold memory."""
    arrival_seconds: float = 5.0
    """For a body to arrive while its request holds a place in the queue: a scene of 25 MB takes 2 s on 100 Mbit/s. A
    slower one goes on, but may find the queue full when it is there: clients that trickle must not keep others out."""
    max_parts: int = 64
    """Of the form; the protocol knows 17."""
    max_part_headers: int = 16
    """Per part; the client sends two."""
    max_header_bytes: int = 4096
    """Of one header line of a part: a file name and some parameters. Of the request's Content-Type, too: taking one of
    64 kB apart takes 50 ms."""
    max_field_bytes: int = 1024
    """Of a text field; the longest one of the protocol is a hash of 64 characters."""
    max_pixels: int = 4096 * 4096
    """width * height: a picture of this size takes about 200 MB while it is made."""
    max_side: int = 16384
    """Pixels of width or height: the raster's coordinates are exact in float32 up to here with 10 bits to spare."""
    gltf: GltfLimits = field(default_factory=GltfLimits)
    """Bounds on the scene's content: nodes, vertices, decoded pixels …"""

    mesh_cache_bytes: int = 512 << 20
    """Of decoded geometry kept across requests: Drake sends the whole scene with every picture."""
    scene_cache_bytes: int = 256 << 20
    """Of whole scenes (by the size of their glTF) kept across requests, for cameras and objects that stand still."""
    scene_cache_count: int = 64
    """Scenes kept across requests, however small."""

    keep_failures: Path | None = None
    """Folder that rejected requests are stored in, for replay; None: they are not kept."""
    keep_failures_count: int = 100
    """Requests kept; the oldest go first."""
    keep_failures_bytes: int = 1 << 30
    """Bytes kept; the oldest go first, one that is larger is not kept at all."""
