"""The meaning of files: what can be drawn is read, and a warning says what cannot.

- ``robots``: URDF, SDF, MJCF, xacro. ``assets``: mesh files, scene files, light rigs. ``gltf``: glTF and GLB.
- ``parsers``: third-party parsers, which run in limited child processes.
"""
