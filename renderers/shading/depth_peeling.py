"""Translucent surfaces one behind the other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList

if TYPE_CHECKING:  # the rasterizer imports the callers of this module
    from renderers.shading.scene import ShadingScene
    from renderers.visibility_buffer import Rasterizer, Visibility

MAX_LAYERS: Final = 32
"""Default bound of translucent and cut-out surfaces drawn behind one another in a pixel, nearest first: each costs one
more pass over the translucent instances, and a hostile scene could stack millions. Behind 32 layers of opacity 0.2
less than a thousandth of the light is left; what lies deeper is not drawn."""


def peeled(
    rasterizer: Rasterizer,
    scene: DrawList,
    tables: ShadingScene,
    camera: Camera,
    cull_back: NDArray[np.bool_] | None,
    behind: Visibility,
    max_layers: int = MAX_LAYERS,
) -> Iterator[Visibility]:
    """The surfaces in front of ``behind`` that may let something be seen through them, nearest first.

    A pixel of a layer whose record is set to -1 before the next layer is asked for sees no further. A layer is closed
    by whoever asks for the next one.

    Args:
        tables: prepared from the scene; its ``transparent`` instances are peeled.
        cull_back: as in ``Rasterizer.visibility``.
    """
    beyond: Visibility | None = None
    try:
        for _ in range(max_layers):
            layer = rasterizer.visibility(
                scene, camera, select=tables.transparent, cull_back=cull_back, beyond=beyond, before=behind
            )
            if beyond is not None:
                beyond.close()
            beyond = layer
            if not (layer.ids >= 0).any():
                break
            yield layer
    finally:
        if beyond is not None:
            beyond.close()
