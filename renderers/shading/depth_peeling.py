"""Layers of transparent surfaces, in the order in which they are blended front to back.

The looks that follow glTF order transparent surfaces by distance (depth peeling). RenderEngineVtk blends them in the
order in which it draws them: instance by instance, primitive by primitive. This is the order of primitive ids.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList
from renderers.visibility_buffer import BAND_ROWS, Rasterizer, Visibility, band_count

MAX_LAYERS: Final = 32
"""Default maximum number of transparent surfaces behind one another in a pixel. Further ones are not rendered.

Each layer costs one pass over the transparent instances, and a hostile scene could stack millions. Behind 32 layers of
opacity 0.2, less than a thousandth of the light is left."""


def for_bands(rasterizer: Rasterizer, height: int, work: Callable[[int, int], object]) -> None:
    """Call ``work(row_begin, row_end)`` for all bands of an image, in parallel."""
    rasterizer.parallel(band_count(height), lambda band: work(band * BAND_ROWS, min((band + 1) * BAND_ROWS, height)))


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
    """Yield the layers of the selected instances that ``behind`` does not hide, nearest first.

    To stop peeling a pixel, set its id in a layer to -1.

    Args:
        select, cull_back: as in ``Rasterizer.visibility``.
        in_drawing_order: yield the surfaces that are drawn last first, instead of the nearest.
    """
    previous: Visibility | None = None
    for _ in range(max_layers):
        bounds: dict[str, Any] = {"behind": previous}
        if in_drawing_order:
            bounds = {"id_limits": None if previous is None else previous.ids, "latest": True}
        layer = rasterizer.visibility(scene, camera, select=select, cull_back=cull_back, in_front_of=behind, **bounds)
        previous = layer
        if not (layer.ids >= 0).any():
            break
        yield layer


SolidPixels = Callable[[Visibility, Camera], NDArray[np.bool_]]
"""Function that returns a mask of the pixels where a layer is not cut out, (H, W)."""


def draw_cut_outs(
    rasterizer: Rasterizer,
    scene: DrawList,
    camera: Camera,
    cut_out: NDArray[np.bool_],
    visible: Visibility,
    solid_pixels: SolidPixels,
    max_layers: int = MAX_LAYERS,
) -> None:
    """Draw the solid parts of the instances ``cut_out`` into a layer of the other instances."""
    for layer in peeled(rasterizer, scene, camera, cut_out, None, visible, max_layers):
        is_solid = solid_pixels(layer, camera)
        np.copyto(visible.ids, layer.ids, where=is_solid)
        np.copyto(visible.inv_z, layer.inv_z, where=is_solid)
        layer.ids[is_solid] = -1  # surfaces behind are hidden


def surfaces_in_drawing_order(
    rasterizer: Rasterizer,
    scene: DrawList,
    camera: Camera,
    select: NDArray[np.bool_],
    cull_back: NDArray[np.bool_] | None,
    nearest: Visibility,
    transmittance: NDArray[np.float32],
) -> Iterator[Visibility]:
    """Yield the surfaces that each pixel shows while instances are drawn one after the other, from last to first.

    VTK blends a surface that it does not treat as transparent with the pixel's colour so far. From then on the surface
    hides everything behind it. A surface of alpha 0 is not drawn and hides nothing. Opaque instances are drawn first.

    Args:
        select: the instances that are blended. cull_back: as in ``Rasterizer.visibility``.
        nearest: the visible surfaces, opaque ones included, which are the first layer.
        transmittance: (H, W), share of the light from behind the layers so far. The caller updates it for every layer
            before requesting the next. Where a layer leaves it unchanged, the layer's alpha is 0.
    """
    layer = nearest
    id_limits = np.full(nearest.ids.shape, np.iinfo(np.int32).max, np.int32)
    for _ in range(MAX_LAYERS):
        transmittance_before = transmittance.copy()
        yield layer
        is_undrawn = (layer.ids >= 0) & (transmittance == transmittance_before)
        id_limits = np.where(is_undrawn, id_limits, layer.ids)
        id_limits[transmittance <= 0.0] = -1
        if not (id_limits >= 0).any():
            break
        # Where a surface is not drawn, the next one is behind it. Elsewhere the next one may be at any distance.
        behind = replace(
            layer, ids=np.where(is_undrawn, layer.ids, 0), inv_z=np.where(is_undrawn, layer.inv_z, np.float32(np.inf))
        )
        layer = rasterizer.visibility(
            scene, camera, select=select, cull_back=cull_back, behind=behind, id_limits=id_limits
        )
