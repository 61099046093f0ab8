"""The scene graph that all interfaces share. It has no protocol, no transport and no event loop.

* ``geometry``, ``transforms``: shapes and matrices as values.
* ``tree``: a persistent tree of nodes with shapes and transforms. ``live``: the live tree and its feed of changes.
* ``timeline``: states over time, as an interface. ``history``: those of the live tree, with ``packed_changes``.
* ``live_page``: view settings of the page in the browser. ``clicks``: clicks in it, for the clients that want them.
* ``live_scene``: the live tree with its draw lists, earlier states and stereo camera, for images and files of it.
* ``flatten``: converts a tree to the renderer's draw list, with ``meshing`` of shapes and ``labels`` of paths.
* ``cameras``: parses cameras from text. ``viewpoints``, ``mount``, ``bounds``: place them in a scene.
"""
