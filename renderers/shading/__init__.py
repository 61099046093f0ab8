"""Shading: from visible primitives to a colour image. Triangles, lines and points; all looks.

Usage::

    shading = prepare(scene.instances, look.name)           # independent of the camera; keep it
    paint(rasterizer, scene, shading, camera, look, color)  # looks phong, plain and pbr
    studio.passes.paint(...)                                # look studio

Each row of a visibility buffer goes through the same steps:

1. ``spans``: neighbouring pixels that see one primitive, and segments of spans that see one instance.
2. ``span_setup``: weighted sums of vertex attributes at the start of each span, and their change per pixel;
   ``interpolation``: the sums at eight pixels at a time, into rows of attributes (``layout``, A_), at most PART pixels.
3. ``material``: base colour, normal map and the other maps (``sampling``) into further rows.
4. ``headlight.lighting`` or ``studio.lighting``: light (``brdf``).
5. ``headlight.output_merge`` or ``studio.tone_mapping``: translucent layers, background, bytes.

Tables: ``scene`` (draw list), ``materials``, ``texture_table``, ``mipmaps``, ``textures`` (decoded images) and
``vertices`` (with ``mikktspace`` tangents). Rows and bands are independent: any number of threads gives the same bytes.

To add a material property: a column of ``materials`` (MI_ or MF_), a row of attributes if it varies between pixels,
and its use in the lighting. A value per image is a column of the job (S_ or J_), filled by the look's ``passes``.
Kernels use no libm, and no array arguments below the entry points. Loops over pixels overrun by up to seven.
"""

from __future__ import annotations

from renderers.shading.headlight.passes import Painter, paint
from renderers.shading.materials import look_material
from renderers.shading.scene import ShadingScene, prepare
from renderers.shading.texture_table import Parallel
from renderers.shading.textures import texels_of

__all__ = [
    "Painter",
    "Parallel",
    "ShadingScene",
    "look_material",
    "paint",
    "prepare",
    "texels_of",
]
