"""The looks ``phong``, ``plain``, ``pbr`` and ``gltf``: one light at the camera, as in Drake's RenderEngineVtk.

``passes`` renders an image, ``shade_rows`` is the kernel, ``lighting`` has the shading models, and ``output_merge``
writes pixels and blends translucent layers. Colours are blended as stored in the image, as in VTK.
"""
