"""Layers of an image with transparent surfaces, from the front to the back of what is blended.

The looks of glTF blend transparent surfaces by their distance (depth peeling). RenderEngineVtk blends everything in the
order in which it draws: that of the instances and their primitives, which is the order of primitive ids.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList

if TYPE_CHECKING:  # the rasterizer imports the callers of this module
    from renderers.visibility_buffer import Rasterizer, Visibility

MAX_LAYERS: Final = 32
"""Default limit of transparent surfaces behind one another in a pixel. Further ones are not rendered.

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
    *,
    in_drawing_order: bool = False,
) -> Iterator[Visibility]:
    """Yield the layers of the selected instances in front of ``behind``, nearest first.

    To stop peeling a pixel, set its id in a layer to -1. Taking the next layer closes the one before.

    Args:
        select, cull_back: as in ``Rasterizer.visibility``.
        in_drawing_order: yield what is drawn last first, instead of what is nearest.
    """
    last: Visibility | None = None
    try:
        for _ in range(max_layers):
            if in_drawing_order:
                earlier = last.ids if last is not None else None
                layer = rasterizer.visibility(
                    scene, camera, select=select, cull_back=cull_back, before=behind, earlier=earlier, latest=True
                )
            else:
                layer = rasterizer.visibility(
                    scene, camera, select=select, cull_back=cull_back, beyond=last, before=behind
                )
            if last is not None:
                last.close()
            last = layer
            if not (layer.ids >= 0).any():
                break
            yield layer
    finally:
        if last is not None:
            last.close()


def overdrawn(
    rasterizer: Rasterizer,
    scene: DrawList,
    camera: Camera,
    select: NDArray[np.bool_],
    cull_back: NDArray[np.bool_] | None,
    nearest: Visibility,
    transmittance: NDArray[np.float32],
) -> Iterator[Visibility]:
    """Yield the nearest surfaces, then in each pixel what was the nearest when they were drawn, and so on.

    VTK blends a surface that is not taken for transparent with what is in its pixel already. Later it hides what is
    drawn behind it, unless its alpha is 0: then it is not drawn.

    Args:
        select, cull_back: as in ``Rasterizer.visibility``.
        nearest: the first layer. The caller closes it.
        transmittance: (H, W), updated by the caller with every layer before it takes the next. A layer that leaves it
            unchanged has an alpha of 0.
    """
    layer = nearest
    earlier = np.full(nearest.ids.shape, np.iinfo(np.int32).max, np.int32)
    for _ in range(MAX_LAYERS):
        transmittance_before = transmittance.copy()
        yield layer
        is_undrawn = (layer.ids >= 0) & (transmittance == transmittance_before)
        earlier = np.where(is_undrawn, earlier, layer.ids)
        earlier[transmittance <= 0.0] = -1
        if not (earlier >= 0).any():
            break
        # Where a surface is not drawn, the next one is behind it; elsewhere it may be at any distance.
        beyond = replace(
            layer,
            ids=np.where(is_undrawn, layer.ids, 0),
            inv_z=np.where(is_undrawn, layer.inv_z, np.float32(np.inf)),
            _release=None,
        )
        if layer is not nearest:
            layer.close()
        layer = rasterizer.visibility(scene, camera, select=select, cull_back=cull_back, beyond=beyond, earlier=earlier)
    if layer is not nearest:
        layer.close()
