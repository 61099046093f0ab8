"""Reads robot files (URDF, SDF, MJCF): links with their geometry, joints, and the poses of links for joint values.

``reader.read_robot`` reads any of them. ``urdf*`` and ``sdf*`` are our own parsers. ``mjcf*`` and xacro files need
packages that the extra ``scenegate[robots]`` installs.
"""
