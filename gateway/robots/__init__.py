"""Reads robot files (URDF and MJCF): links with their geometry, joints, and the poses of links for joint values.

``reader.read_robot`` reads a file of either format. ``urdf*`` is our reader of URDF; ``mjcf*`` needs the package
``mujoco``, which the extra ``scenegate[robots]`` installs.
"""
