"""Limits of the HTTP interface to the live scene, and defaults of its query parameters."""

from dataclasses import dataclass, field

from gateway.scene.draw.style import Style
from renderers.interface import LookName


@dataclass(frozen=True, slots=True)
class SceneApiConfig:
    """Configuration of ``/scene``, ``/scene.glb`` and ``/scene/render``."""

    width: int = 1280
    """Default width in pixels."""
    height: int = 720
    """Default height in pixels."""
    look: LookName = "studio"
    """Default look."""
    style: Style = field(default_factory=Style)
    """Shading; ``look`` or a request name the look."""
    max_pixels: int = 4096 * 4096
    """Maximum number of pixels of an image; one of this size takes about 200 MB while it is rendered."""
    max_side: int = 16384
    """Maximum width and height in pixels: the rasterizer's limit."""
    max_export_bytes: int = 512 << 20
    """Maximum size of ``/scene.glb``: the file is built in memory, and browsers cannot load much larger ones."""
    max_nodes: int = 200_000
    """Maximum number of nodes in the response of ``GET /scene``, 300 bytes each. Further nodes are only counted."""
