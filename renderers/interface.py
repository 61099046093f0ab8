"""Interface between the gateway and renderers. The CPU rasterizer is the reference implementation."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Flag, auto
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList
from renderers.light_rig import STUDIO, CameraLight, Rig

Parallel = Callable[[int, Callable[[int], object]], None]
"""``parallel(units, work)`` calls work(0) .. work(units - 1) from several threads and raises the first error."""
LookName = Literal["phong", "pbr", "gltf", "plain", "studio"]
SampleCount = Literal[1, 4, 8]
VTK_LOOKS: Final[tuple[LookName, ...]] = ("phong", "pbr")
"""Looks that reproduce RenderEngineVtk, even where it deviates from the glTF specification."""


class Output(Flag):
    """Images that a call requests."""

    COLOR = auto()
    DEPTH = auto()
    LABEL = auto()
    INSTANCE = auto()
    NORMAL = auto()
    LAMP_SHARE = auto()
    KEY_FACTOR = auto()
    LIGHT = auto()
    ROOTS = auto()


@dataclass(frozen=True, slots=True)
class Look:
    """Shading of the colour image. The other outputs only depend on it in what is cut out of them: nothing in the looks
    of RenderEngineVtk, and otherwise surfaces of the alpha mode MASK where their alpha is below the cutoff."""

    name: LookName = "phong"
    """Name of the look:

    - ``phong``: as RenderEngineVtk without glTF meshes. One headlight with Lambert shading, textures as stored, no
      gamma. Blending, texture filters and mirrored instances are as in VTK.
    - ``pbr``: as RenderEngineVtk with glTF meshes. Metallic-roughness in linear light, gamma 1/2.2. Blending, texture
      filters and mirrored instances are as in VTK.
    - ``gltf``: light and gamma of ``pbr``, materials as in the glTF specification.
    - ``plain``: for Director and the browser view. As ``phong``, but linear colour factors and vertex colours are
      encoded as sRGB, so that a surface that faces the camera has exactly the published colour.
    - ``studio``: for presentation. All glTF materials under the lights of ``rig``, with shadows, reflections and tone
      mapping.
    """
    background: tuple[int, int, int] = (204, 229, 255)
    """RGB of the background as stored in the image. The default is Drake's."""
    samples: SampleCount = 1
    """Samples per pixel of the colour image. The other outputs always have one, since their values cannot be mixed."""
    rig: Rig = STUDIO
    """Lights of the look ``studio``. The other looks have one headlight."""
    camera_light: CameraLight | None = None
    """Light of a camera's images in the look ``gltf``; None: the headlight along the optical axis."""
    alpha_threshold: float = 0.0
    """Alpha from 0 to 1 below which blended surfaces are left out of the outputs other than colour, except in the looks
    of RenderEngineVtk. 0: none are left out, however transparent."""
    area_filter: bool = False
    """True: textures are averaged over each pixel's area, as a sensor does, in place of OpenGL's filters. It needs a
    texture that is filtered by scale, or the look ``gltf``; the look ``studio`` ignores it."""


@dataclass(slots=True, eq=False)
class Frame:
    """Images of one call, row 0 at the top."""

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
    lamp_share: NDArray[np.float32] | None = None
    """(H, W + 8) float32, cosine of the lamp of ``Look.camera_light`` divided by all its light, of opaque surfaces; 1
    on unlit ones, on the background and in other looks. Needs a colour image with one sample per pixel."""
    key_factor: NDArray[np.float32] | None = None
    """(H, W + 8) float32, factor of at most 4 by which ``CameraLight.key`` brightens opaque surfaces; 1 on points, on
    lines and on the background. Needs a colour image with one sample per pixel."""
    light: NDArray[np.float32] | None = None
    """(H, W + 8) float32, all light of ``CameraLight`` but ``key`` on the surfaces, otherwise as ``key_factor``."""
    roots: NDArray[np.uint32] | None = None
    """(H, W + 8) uint32, the colour image in finer steps, for a sensor: square roots of linear light, red and green in
    11 bits each, from the lowest one on, and blue in 10; all bits set: white. In place of ``color``, with one sample
    per pixel, not in the look ``studio``."""


class Renderer(Protocol):
    """Draws a draw list as a camera sees it. Thread-safe. Releases the GIL while drawing."""

    def render(self, scene: DrawList, camera: Camera, outputs: Output, look: Look = ...) -> Frame:
        """Draw under the current ``stop.StopFlag``.

        Raises:
            ImageError: a texture that colour or a cut-out needs cannot be decoded.
            Exception: the flag was set. The error is the one that it was set with, raised within about 0.1 s.
        """
        ...

    def parallel(self, units: int, work: Callable[[int], object]) -> None:
        """Call ``work(0) .. work(units - 1)`` in any order, from the calling thread and from idle helper threads.

        ``work`` should spend its time in kernels, which release the GIL. The first exception of the calls is raised
        again after all of them have ended.
        """
        ...
