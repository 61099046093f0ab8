"""Drake's LCM visualizer channels. Shows messages of ``DrakeVisualizer`` and contact visualizers in the live tree.

- ``service``: receives messages from the LCM transports and passes them to ``viewer``, in a worker thread if they are
  big. ``gateway.wiring`` creates it.
- ``viewer``: the channels without I/O. ``read`` decodes a message, in any thread; ``apply`` then edits the live tree.
- ``channels``: what a channel has, by its name.
- ``wire``: Drake's LCM types as values, and their decoders. Definitions: ``lcmtypes/lcmt_*.lcm``.
- ``robots``: links of rigid bodies. ``link_paths`` names them in the tree. ``shapes`` reads their geometries and
  deformable bodies, and the triangles in both.
- ``contacts``, ``point_clouds``, ``frames``: the other messages. ``arrows`` makes arrows and axes.
- ``config``: limits.

A *family* is a node below ``drake`` with the geometry of one of Drake's roles: ``illustration`` and ``proximity``, or
that of its ``InertiaVisualizer``, ``inertia``. Users show and hide families as a whole.
"""
