"""A synthetic rc_visard: image sets over gRPC, parameters over REST.

A frame's way, in the order of the files:

* ``service`` owns everything below; ``config`` is fixed at start, ``parameters`` change over REST.
* ``frame_scheduler`` captures frames while clients stream, at the times and timestamps of ``frame_clock``.
* ``frame`` makes each image of a frame once: ``images`` renders and exposes, ``depth`` measures, ``messages`` and
  ``wire`` serialise.
* ``hub`` delivers image sets to clients, ``events`` image events; ``server`` is the gRPC server.

REST: ``node_routes``, ``system_routes``, ``upload``, ``truth`` and ``fault_routes``, on the base of ``rest_common``.
``pairs`` replaces the scene by recorded images.
"""
