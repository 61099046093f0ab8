"""From visible records to the colour picture.

Usage::

    shading = prepare(scene.instances, look.name)          # tables of the draw list; keep while it is drawn
    paint(rasterizer, scene, shading, camera, look, color)  # as many layers as need be

``prepare`` decodes the images that the look needs (once per ``Image``) and does not depend on the camera. The rest is
nogil kernels over independent bands of rows: any number of threads gives the same bytes. ``warmup`` compiles all
kernels into Numba's cache.

How a pixel is made: its record gives the element; the element's three vertices in the optical frame give the exact
perspective-correct barycentric coordinates; a run of pixels that see one element is resolved at once
(``resolve.resolve_run``), a segment of pixels that see one instance is shaded at once (``kernels.shade_rows``).
"""

from __future__ import annotations

from renderers.shading.materials import look_material
from renderers.shading.paint import MAX_LAYERS, paint
from renderers.shading.scene import ShadingScene, prepare
from renderers.shading.textures import texels_of
from renderers.shading.warm import warmup

__all__ = [
    "MAX_LAYERS",
    "ShadingScene",
    "look_material",
    "paint",
    "prepare",
    "texels_of",
    "warmup",
]
