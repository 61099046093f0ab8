"""A synthetic rc_visard: image sets over gRPC, parameters over REST.

``service`` owns all objects of a camera. Rooms, lowest first:

* ``device``: configuration at start (``camera_config``, from a ``profile``), parameters that clients change over REST,
  and their values for one frame (``stream_settings``).
* ``imaging``: the scene at an instant (``scene_view``), rendered images and depth (``rendered_images``), depth by
  matching images (``matched_depth``), and recorded pairs in place of the scene.
* ``stream``: ``frame_scheduler`` captures frames while clients stream, ``frame`` makes each image of a frame once,
  ``frame_publisher`` passes image sets to ``subscriptions``, and ``grpc_server`` sends them.
* ``routes``: REST interface of the device, camera images on request, ground truth, fault injection.
"""
