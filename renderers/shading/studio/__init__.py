"""The look ``studio``: images for presentation, with shadows, reflections and tone mapping.

It supports glTF 2.0's metallic-roughness materials with mip-mapped textures; KHR_materials_unlit, _ior, _specular and
_emissive_strength; punctual lights with filtered shadow maps; image-based light; tone curves.

``passes`` renders an image. ``shadows`` renders its shadow maps; ``environment_map`` filters its environment (an
``environment_image``) into ``octahedral`` tables. The kernels in ``shade_rows`` gather surfaces (``material``), light
them (``lighting``, with ``lights`` and ``shadow_sampling``), and encode rows (``tone_mapping``). ``layout`` has the
tables and structs that kernels and callers share. ``renderers.light_rig`` describes the light of an image.
"""
