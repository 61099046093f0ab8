"""The scene graph that all interfaces share. It has no protocol, no transport and no event loop.

``geometry``, ``transforms``: shapes and matrices as values. ``tree``: a persistent tree of nodes with shapes and
transforms; ``live``: the one live tree and its feed of changes. ``flatten``: a tree as the renderer's draw list, with
``meshing`` of shapes and ``labels`` of paths. ``cameras``, ``viewpoints``, ``mount``, ``bounds``: cameras in words, and
their poses in a scene.
"""
