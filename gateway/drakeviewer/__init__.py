"""Drake's LCM visualizer channels: what Drake's ``DrakeVisualizer`` and contact visualizers publish, in the live tree.

- ``service``: receives messages from the LCM transports and passes them to ``viewer``, in a worker thread if they are
  big. ``gateway.wiring`` creates it.
- ``viewer``: the channels without I/O. A message is read (thread-safe, no tree), and then applied to the live tree.
- ``messages``, ``wire``: Drake's LCM types as values, and their decoders. Definitions: ``lcmtypes/lcmt_*.lcm``.
- ``robots``: links of rigid bodies. ``link_paths`` names them in the tree; ``geometry`` and ``memory_meshes`` read
  their shapes.
- ``deformables``, ``contacts``, ``point_clouds``, ``frames``: the other things that Drake shows.
- ``config``: limits.
"""
