"""Shading: computes the colour image from the visible triangles, lines and points, for all looks.

Usage::

    shading = prepare(scene.instances, look.name)           # does not depend on the camera
    paint(rasterizer, scene, shading, camera, look, color)  # looks phong, plain, pbr and gltf
    studio.passes.paint(...)                                # look studio

Each row of a visibility buffer goes through the same steps:

1. ``spans``: neighbouring pixels that see one primitive, and segments of spans that see one instance.
2. ``span_setup``: weighted sums of vertex attributes at the start of each span, and their change per pixel (SPANS of
   ``layout``); ``interpolation``: the sums at eight pixels at a time (PIXELS), for a part of at most PART pixels.
3. ``material``: base colour, normal map and the other maps, read by ``sampling`` (``mip_levels``, ``texels``), into
   further rows of PIXELS.
4. ``headlight.lighting`` or ``studio.lighting``: light (``brdf``).
5. ``headlight.output_merge`` or ``studio.tone_mapping``: translucent layers, background; ``packed_rows``: bytes.

Tables: ``scene`` (draw list), ``materials``, ``texture_table``, ``mipmaps``, ``textures`` (decoded images) and
``mesh_buffers`` (with ``mikktspace`` tangents). Rows and bands are independent: any number of threads gives the same
bytes.

To add a material property: a field of MATERIAL, set in ``materials``; rows of PIXELS if it varies between pixels; and
its use in the lighting. A value per image is a field of the look's job, set by its ``passes``. Kernels that shade
pixels do not call the C library's math functions, whose results differ between machines. Their device functions take
pointers instead of arrays, and their loops over pixels overrun by up to seven.
"""

from __future__ import annotations

from renderers.shading.headlight.passes import HeadlightJob, paint, solid_pixels
from renderers.shading.scene import ShadingScene, prepare
from renderers.shading.texture_table import Parallel

__all__ = [
    "HeadlightJob",
    "Parallel",
    "ShadingScene",
    "paint",
    "prepare",
    "solid_pixels",
]
