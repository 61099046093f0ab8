"""Depth peeling: layers of transparent surfaces, nearest first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList

if TYPE_CHECKING:  # the rasterizer imports the callers of this module
    from renderers.visibility_buffer import Rasterizer, Visibility

MAX_LAYERS: Final = 32
"""Default limit of transparent surfaces behind one another in a pixel. Deeper ones are not rendered.

Each layer costs one pass over the transparent instances, and a hostile scene could stack millions. Behind 32 layers of
opacity 0.2, less than a thousandth of the light is left."""


def peeled(
    rasterizer: Rasterizer,
    scene: DrawList,
    camera: Camera,
    select: NDArray[np.bool_],
    cull_back: NDArray[np.bool_] | None,
    behind: Visibility,
    max_layers: int = MAX_LAYERS,
) -> Iterator[Visibility]:
    """Yield the layers of the selected instances in front of ``behind``, nearest first.

    To stop peeling a pixel, set its id in a layer to -1. Taking the next layer closes the one before.

    Args:
        select, cull_back: as in ``Rasterizer.visibility``.
    """
    beyond: Visibility | None = None
    try:
        for _ in range(max_layers):
            layer = rasterizer.visibility(
                scene, camera, select=select, cull_back=cull_back, beyond=beyond, before=behind
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
