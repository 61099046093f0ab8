"""A synthetic rc_visard: image sets over gRPC, parameters over REST.

Modules, in the order in which a frame passes them:

* ``service`` owns all objects of a camera. ``config`` is fixed at start, ``parameters`` change over REST.
* ``frame_scheduler`` captures frames while clients stream. ``frame_clock`` gives their due times and timestamps.
* ``frame`` makes each image of a frame once. ``images`` renders and exposes, ``depth`` measures depth, ``messages`` and
  ``wire`` serialise.
* ``frame_publisher`` passes the image sets to ``hub`` and the image events to ``events``. ``server`` sends both over
  gRPC.

``imu`` publishes the samples of ``imu_sampler`` to the clients of ``imu_hub``.

The REST routes are in ``node_routes``, ``system_routes``, ``upload``, ``truth``, ``imu_routes`` and ``fault_routes``;
``rest_common`` has what they share. ``pairs`` replaces the scene by recorded images.
"""
