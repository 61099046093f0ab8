"""Limits of the HTTP interface to the live scene, and defaults of its query parameters."""

from __future__ import annotations

from dataclasses import dataclass

from renderers.interface import LookName, SampleCount
from renderers.light_rig import STUDIO, Rig


@dataclass(frozen=True, slots=True)
class SceneApiConfig:
    """Configuration of ``/scene``, ``/scene.glb`` and ``/scene/render``."""

    width: int = 1280
    """Default width in pixels."""
    height: int = 720
    """Default height in pixels."""
    look: LookName = "studio"
    """Default look."""
    samples: SampleCount = 4
    """Default number of samples per pixel of the studio look. The default of the other looks is 1, with FXAA."""
    rig: Rig = STUDIO
    """Lights of the studio look."""
    background: tuple[int, int, int] = (204, 229, 255)
    """RGB background of colour images, 0 .. 255; the same as the render endpoint's."""
    alpha_threshold: float = 0.0
    """As ``Look.alpha_threshold``."""
    max_pixels: int = 4096 * 4096
    """Maximum number of pixels of an image; one of this size takes about 200 MB while it is rendered."""
    max_side: int = 16384
    """Maximum width and height in pixels: the rasterizer's limit."""
    max_export_bytes: int = 512 << 20
    """Maximum size of ``/scene.glb``: the file is built in memory, and browsers cannot load much larger ones."""
    max_nodes: int = 200_000
    """Maximum number of nodes in the response of ``GET /scene``, 300 bytes each. Further nodes are only counted."""
