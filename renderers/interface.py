"""The port between what wants pictures and what draws them; the CPU rasterizer is its reference implementation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Flag, auto
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList
from renderers.light_rig import STUDIO, Rig

LookName = Literal["phong", "pbr", "plain", "studio"]
SampleCount = Literal[1, 4, 8]


class Output(Flag):
    """Which pictures a call wants; what is not wanted costs nothing."""

    COLOR = auto()
    DEPTH = auto()
    LABEL = auto()
    INSTANCE = auto()
    NORMAL = auto()


@dataclass(frozen=True, slots=True)
class Look:
    """How colour is made from geometry; depth and label do not depend on it."""

    name: LookName = "phong"
    """``phong``: RenderEngineVtk's look without glTF meshes: headlight, ``255 * base * max(0, n.z)``, textures as
    stored, no gamma. ``pbr``: its look with glTF meshes: metallic-roughness, linear, gamma 1/2.2. ``plain``:
    Director's and the browser view's: as ``phong``, but the linear colour factors are first encoded as sRGB, so that
    a surface that faces the camera has the very colour that was published. ``studio``: for people: all of glTF's
    materials under ``rig``, with shadows, reflections and a tone curve."""
    background: tuple[int, int, int] = (204, 229, 255)
    """RGB as stored in the picture; Drake's default."""
    samples: SampleCount = 1
    """Samples of visibility a pixel, of colour only: depth and labels are never mixed."""
    rig: Rig = STUDIO
    """What lights the ``studio`` look; the others have one head light."""


@dataclass(slots=True, eq=False)
class Frame:
    """The pictures of one call, row 0 at the top. Arrays are pooled: copy or encode them, then ``close``."""

    color: NDArray[np.uint8] | None = None
    """(H, W, 3) uint8 RGB."""
    depth: NDArray[np.float32] | None = None
    """(H, W) float32, metres along the optical axis; +inf where nothing is within near .. far."""
    label: NDArray[np.uint32] | None = None
    """(H, W) uint32, label of the instance in the low 24 bits, LABEL_NONE where nothing is."""
    instance: NDArray[np.int32] | None = None
    """(H, W) int32, instance_id; -1 where nothing is."""
    normal: NDArray[np.float32] | None = None
    """(H, W, 3) float32, unit normal in the camera's optical frame, facing the camera; 0 where nothing is."""
    _release: Callable[[], None] | None = field(default=None, repr=False)

    def close(self) -> None:
        """Hand the arrays back to the pool; they must not be used afterwards. Calling it again does nothing."""
        release, self._release = self._release, None
        self.color = self.depth = self.label = self.instance = self.normal = None
        if release is not None:
            release()

    def __enter__(self) -> Frame:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class Renderer(Protocol):
    """Draws a draw list as a camera sees it. Thread-safe; releases the GIL while it works."""

    def render(self, scene: DrawList, camera: Camera, outputs: Output, look: Look = ...) -> Frame:
        """Draw under the current ``stop.StopFlag``.

        Raises:
            ImageError: a texture that colour needs cannot be decoded.
            Exception: the flag was set; the error that it was set with, within about 0.1 s.
        """
        ...
