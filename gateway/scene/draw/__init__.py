"""Draw lists and cameras of a tree.

- ``flatten``: converts a tree to the renderer's draw list, with ``meshing`` of shapes.
- ``live_scene``: the live tree with its draw lists, earlier states and stereo camera, for images and files of it.
- ``cameras``: parses cameras from text. ``viewpoints``, ``mount``, ``bounds``: place them in a scene.
"""
