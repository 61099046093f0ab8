"""What an operator can set about the scene over HTTP; every bound states its reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from renderers.interface import LookName, SampleCount
from renderers.light_rig import STUDIO, Rig


@dataclass(frozen=True, slots=True)
class SceneApiConfig:
    """Settings of ``/scene``, ``/scene.glb`` and ``/scene/render``."""

    width: int = 1280
    height: int = 720
    """Pixels, where a request names none."""
    look: LookName = "studio"
    """Where a request names none."""
    samples: SampleCount = 4
    """A pixel of the studio look, where a request names none; the other looks have one, and FXAA."""
    rig: Rig = STUDIO
    """What lights the studio look."""
    background: tuple[int, int, int] = (204, 229, 255)
    """RGB of colour pictures where nothing is; the same as the render endpoint's."""
    antialias: Literal["fxaa", "none"] = "fxaa"
    """Of colour pictures with one sample a pixel in looks other than studio."""
    max_pixels: int = 4096 * 4096
    """width * height: a picture of this size takes about 200 MB while it is made."""
    max_side: int = 16384
    """Pixels of width or height: the rasterizer's limit."""
    max_export_bytes: int = 512 << 20
    """Of ``/scene.glb``: the file is made in memory, and browsers give up at about this size."""
    max_nodes: int = 200_000
    """Listed by ``GET /scene``; 300 bytes of JSON each. Further ones are counted, not listed."""
