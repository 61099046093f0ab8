"""Interface between the gateway and renderers. The CPU rasterizer is the reference implementation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Flag, auto
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList
from renderers.light_rig import STUDIO, Rig

LookName = Literal["phong", "pbr", "gltf", "plain", "studio"]
SampleCount = Literal[1, 4, 8]
VTK_LOOKS: Final[tuple[LookName, ...]] = ("phong", "pbr")
"""Looks that draw what RenderEngineVtk draws, where that deviates from the glTF specification, too."""


class Output(Flag):
    """Images that a call requests."""

    COLOR = auto()
    DEPTH = auto()
    LABEL = auto()
    INSTANCE = auto()
    NORMAL = auto()


@dataclass(frozen=True, slots=True)
class Look:
    """Shading of the colour image; depth and labels do not depend on it."""

    name: LookName = "phong"
    """``phong``: as RenderEngineVtk without glTF meshes: headlight, ``255 * base * max(0, n.z)``, textures as stored,
    no gamma. ``pbr``: as RenderEngineVtk with glTF meshes: metallic-roughness, linear light, gamma 1/2.2. Both blend,
    filter and mirror as VTK does. ``gltf``: light and gamma of ``pbr``, materials as the glTF specification says.
    ``plain``: for Director and the browser view: as ``phong``, but linear colour factors are first encoded as sRGB, so
    that a surface that faces the camera has exactly the published colour. ``studio``: for presentation: all glTF
    materials under ``rig``, with shadows, reflections and tone mapping."""
    background: tuple[int, int, int] = (204, 229, 255)
    """RGB as stored in the image; Drake's default."""
    samples: SampleCount = 1
    """Samples per pixel of the colour image. Depth and labels always have one: they are never mixed."""
    rig: Rig = STUDIO
    """Lights of the ``studio`` look; the others have one headlight."""


@dataclass(slots=True, eq=False)
class Frame:
    """Images of one call, row 0 at the top. Arrays are pooled: copy or encode them, then ``close``."""

    color: NDArray[np.uint8] | None = None
    """(H, W, 3) uint8 RGB."""
    depth: NDArray[np.float32] | None = None
    """(H, W) float32, metres along the optical axis; +inf without a surface between near and far."""
    label: NDArray[np.uint32] | None = None
    """(H, W) uint32, label of the instance in the low 24 bits; LABEL_NONE without a surface."""
    instance: NDArray[np.int32] | None = None
    """(H, W) int32, instance_id; -1 without a surface."""
    normal: NDArray[np.float32] | None = None
    """(H, W, 3) float32, unit normal in the camera's optical frame, facing the camera; 0 without a surface."""
    _release: Callable[[], None] | None = field(default=None, repr=False)

    def close(self) -> None:
        """Return the arrays to their pool; they must not be used afterwards. Calling it again does nothing."""
        release, self._release = self._release, None
        self.color = self.depth = self.label = self.instance = self.normal = None
        if release is not None:
            release()

    def __enter__(self) -> Frame:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class Renderer(Protocol):
    """Draws a draw list as a camera sees it. Thread-safe. Releases the GIL while drawing."""

    def render(self, scene: DrawList, camera: Camera, outputs: Output, look: Look = ...) -> Frame:
        """Draw under the current ``stop.StopFlag``.

        Raises:
            ImageError: a texture that colour needs cannot be decoded.
            Exception: the flag was set. The error is the one that it was set with, raised within about 0.1 s.
        """
        ...
