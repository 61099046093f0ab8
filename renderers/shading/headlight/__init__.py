"""The looks ``phong``, ``plain`` and ``pbr``: one light at the camera, as in Drake's RenderEngineVtk.

``passes`` renders an image, ``shade_rows`` is the kernel, ``lighting`` has the shading models, and ``output_merge``
writes pixels and blends translucent layers. Colours are mixed as stored, as VTK does.
"""
