"""Anti-aliasing of the looks that shade whole visibility buffers, by samples on visibility."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.cpu.visibility import Rasterizer, Visibility
from renderers.drawlist import DrawList
from renderers.port import Look
from renderers.samples import distinct, mix, sample_cameras
from renderers.shading import ShadingScene, paint


class _Given:
    """A rasterizer that has seen already."""

    def __init__(self, rasterizer: Rasterizer, seen: Visibility) -> None:
        self._rasterizer = rasterizer
        self._seen = seen

    def visibility(
        self,
        scene: DrawList,
        camera: Camera,
        *,
        select: NDArray[np.bool_] | None = None,
        cull_back: NDArray[np.bool_] | None = None,
        beyond: Visibility | None = None,
        before: Visibility | None = None,
    ) -> Visibility:
        return self._seen

    def parallel(self, units: int, work: Callable[[int], object]) -> None:
        self._rasterizer.parallel(units, work)


def paint_sampled(
    rasterizer: Rasterizer,
    scene: DrawList,
    shading: ShadingScene,
    camera: Camera,
    look: Look,
    color: NDArray[np.uint8],
) -> None:
    """As ``renderers.shading.paint`` with ``look.samples`` samples a pixel, mixed as they are shown, as VTK
    mixes them.

    Opaque scenes are shaded once per pixel and element; a translucent one wholly at every sample position.
    """
    cameras = sample_cameras(camera, look.samples)
    if shading.translucent:
        total = np.zeros(color.shape, np.uint16)
        for each in cameras:
            paint(rasterizer, scene, shading, each, look, color)
            total += color
        color[:] = (total + look.samples // 2) // look.samples
        return
    cull = shading.cull_back if shading.cull_back.any() else None
    with ExitStack() as stack:
        views = [stack.enter_context(rasterizer.visibility(scene, each, cull_back=cull)) for each in cameras]
        layers, counts = distinct([view.ids for view in views])
        colors = np.empty((len(layers), *color.shape), np.uint8)
        for ids, out in zip(layers, colors, strict=True):
            layer = replace(views[0], ids=ids, _release=None)
            paint(_Given(rasterizer, layer), scene, shading, camera, look, out)
        mix(colors, counts, look.samples, look.background, color)
