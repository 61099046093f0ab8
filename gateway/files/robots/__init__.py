"""Reads robot files (URDF, SDF, MJCF) as parts of the scene.

``reader.read_robot`` reads any of them. ``scenegate.robots`` parses URDF and SDF. ``mjcf*`` and xacro files need
packages that the extra ``scenegate[robots]`` installs.
"""
