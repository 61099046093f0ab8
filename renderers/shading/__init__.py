"""From visible records to the colour picture.

Usage::

    shading = prepare(scene.instances, look.name)          # tables of the draw list; keep while it is drawn
    paint(rasterizer, scene, shading, camera, look, color)  # as many layers as need be

``prepare`` decodes the images that the look needs (once per ``Image``) and does not depend on the camera. The rest is
nogil kernels over independent bands of rows: any number of threads gives the same bytes. ``warmup`` compiles all
kernels into Numba's cache.

How a pixel is made: its record gives the element. Runs of pixels that see one element are resolved (``resolve``): the
exact perspective-correct barycentric coordinates spread the vertex records (``vertices``) along the row. Segments of
pixels that see one instance are shaded (``surface``) eight pixels at a time, at most ``kernels.PART`` at once. Segments
of one colour under the head light take a shorter way: ``plain``, or where triangles are as large as pixels, ``tiny``.

**To add a feature** (a light, a map, a probe), write a function in a file of its own over a segment's columns::

    @inner
    def fog(job, mf, rows, stride, begin, end):
        for x in range(begin, end, vec.LANES):
            vec.store(rows, A_FOG * stride + x, ...)  # from vec.load(rows, A_... * stride + x) of eight pixels

``rows`` points to rows of attributes (``layout``, A_): what an element has is there when ``surface.shade`` is called
(which lists the steps); a new row for the result is added there, too. Loops may run over ``end`` by up to seven
pixels: the next segment overwrites them, and coordinates are made safe by the sampler. What is the same for the whole
segment is decided outside of the loop or by a branch on a value that does not change in it. A small function of eight
pixels (f32x8 in, f32x8 out) that is called within a light's loop carries ``forceinline=True``. What a material needs is
a column of ``materials`` (MI_, MF_); what a picture needs is a value of the job (S_), filled by ``paint``. No libm
calls, no arrays below the entry points: ``simd`` and ``pointers`` have what is needed.
"""

from __future__ import annotations

from renderers.shading.materials import look_material
from renderers.shading.passes import Painter, paint
from renderers.shading.scene import ShadingScene, prepare
from renderers.shading.textures import Parallel, texels_of
from renderers.shading.warmup import warmup

__all__ = [
    "Painter",
    "Parallel",
    "ShadingScene",
    "look_material",
    "paint",
    "prepare",
    "texels_of",
    "warmup",
]
