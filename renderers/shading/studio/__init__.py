"""The ``studio`` look: pictures for people.

All of glTF 2.0's metallic-roughness materials with mip-mapped textures, MikkTSpace tangents, KHR_materials_unlit,
_ior, _specular and _emissive_strength; punctual lights with filtered shadow maps; light from the surroundings
(``rig.Surroundings``); Khronos' PBR Neutral tone curve. Drake's looks live in ``renderers.shading`` and share nothing
with this room but visibility and records of vertices, so that no feature here can change a pixel of theirs.

``paint.paint`` draws a picture, ``tables.prepare`` what of it does not depend on the camera, ``rig.Rig`` says what
lights it. What pixels see is put eight at a time into rows (``surface``, ``layout``) and lit (``lighting``,
``reflection``, ``shadowing``): a new feature is a column of a table or a row, and some lines there.
"""
