"""Shading: computes the colour image from the visible triangles, lines and points, for all looks.

Usage::

    shading = prepare(scene.instances, look.name)           # does not depend on the camera
    paint(rasterizer, scene, shading, camera, look, color)  # looks phong, plain, pbr and gltf
    studio.passes.paint(...)                                # look studio

Each row of a visibility buffer goes through the same steps, called by ``headlight.shade_rows`` or
``studio.shade_rows``:

1. ``spans`` cuts it into spans (pixels that see one primitive), segments (spans of one instance) and parts (at most
   MAX_PART_PIXELS of a segment, shaded at a time).
2. ``span_setup`` fills PartSpans: weighted sums of vertex attributes at the start of each span, and their changes
   per pixel. ``interpolation`` turns them into PartPixels, eight pixels at a time.
3. ``material``: base colour, normal map and the other maps, read by ``sampling`` (``level_of_detail``, ``texels``,
   ``area_filter``), into further rows of PartPixels.
4. ``headlight.lighting`` or ``studio.lighting``: light (``brdf``).
5. ``headlight.output_merge`` or ``studio.tone_mapping``: translucent layers, background; ``packed_rows``: bytes.

The kernels of the looks call ``span_setup.set_up_part_kernel`` and ``sampling.sample_texture`` by address, for each
part: these two are compiled once for all looks.

Tables: ``scene`` (draw list), ``materials``, ``texture_table``, ``mipmaps``, ``textures`` (decoded images) and
``mesh_buffers`` (with ``mikktspace`` tangents). Rows and bands are independent: any number of threads gives the same
bytes.

Parameters of device functions that mean the same everywhere have no line of their own:

- ``context`` is a ShadingContext, ``inputs`` ShadingInputs, ``job`` those of a look; ``part_spans``, ``pixels``,
  ``material``, ``texture``, ``surfaces``, ``lighting``: the struct of this name.
- ``count``: number of pixels of the part that is shaded. ``pixel``: index of the first of eight pixels, in the part.
- ``x``, ``begin``, ``end``: indices in the row of pixels. ``y``: row of the image. ``column``: column of the image.
  Pixel x of a row is in column x, unless ShadingContext has ``columns``.
- ``span``: index of a span in the row; ``slot``: index in PartSpans, and so in the part, of the first of eight spans.
- ``rows``: pointer to rows of PartSpans or PartPixels. ``packed_row``: pointer to int32, see ``packed_rows``.
- ``with_alpha``: False: the fourth channel is not needed.

Values of eight pixels are f32x8 if nothing is said, points and directions three of them in the optical frame (metres);
colours are RGB, 0 .. 1. Ranges are those of ``docs/rasterizer.md``.

To add a material property: a field of ShadingMaterial, set in ``materials``; rows of PartPixels if it varies
between pixels; and its use in the lighting. A value per image is a field of the look's job, set by its ``passes``.
Kernels that shade pixels do not call the C library's math functions, whose results differ between machines. Their
device functions take pointers instead of arrays, and their loops over pixels overrun by up to seven.
"""

from renderers.shading.headlight.passes import HeadlightJob, paint, solid_pixels
from renderers.shading.scene import ShadingScene, prepare

__all__ = ["HeadlightJob", "ShadingScene", "paint", "prepare", "solid_pixels"]
