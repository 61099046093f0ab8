"""Record the live scene and a stereo camera to MCAP files, for Foxglove and ROS 2.

- ``view_frames``: frames of the gateway's view, and joints in them; ``scene_mirror``: the live scene from these frames,
  with ``mirror_geometry``.
- ``values``: what is recorded, without a format; ``camera_values``: from the camera's image sets.
- ``foxglove_messages``, ``ros2_messages``: convert values to messages; ``topics``: their topics,
  and both formats as one class.
- ``mcap_file``: writes files; ``sources``: threads that receive; ``recorder``: joins all.
"""
