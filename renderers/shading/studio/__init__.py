"""The look ``studio``: images for people.

All of glTF 2.0's metallic-roughness materials with mip-mapped textures and KHR_materials_unlit, _ior, _specular and
_emissive_strength; punctual lights with filtered shadow maps; image-based light; a tone curve.

``passes`` renders an image and ``shade_rows`` are its kernels. ``material`` fills rows of surfaces (``layout``, R_) for
``lighting``: ``lights`` with ``shadows`` and ``shadow_sampling``, and ``environment_map`` with ``octahedral``.
``tone_mapping`` finishes rows. ``renderers.light_rig`` says what lights an image.
"""
