"""Drake's LCM visualizer channels: what Drake's ``DrakeVisualizer`` and contact visualizers publish, in the live tree.

- ``service``: receives messages from the LCM transports and passes them to ``viewer``, in a worker thread if they are
  big. ``gateway.wiring`` creates it.
- ``viewer``: the channels without I/O. ``read`` decodes a message, in any thread; ``apply`` then edits the live tree.
- ``messages``, ``wire``: Drake's LCM types as values, and their decoders. Definitions: ``lcmtypes/lcmt_*.lcm``.
- ``robots``: links of rigid bodies. ``link_paths`` names them in the tree. ``geometry`` reads their shapes, with
  ``meshes`` for triangles sent as numbers and ``memory_meshes`` for mesh files sent as JSON.
- ``deformables``, ``contacts``, ``point_clouds``, ``frames``: what else Drake publishes. ``arrows`` makes arrows and
  axes.
- ``config``: limits.

A *family* is a node below ``drake`` with the geometry of one of Drake's roles: ``illustration`` and ``proximity``, or
that of its ``InertiaVisualizer``, ``inertia``. Users show and hide families as a whole.
"""
