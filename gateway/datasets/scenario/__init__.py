"""Scenarios: a TOML file from which scenes are drawn by a seed. See ``docs/scenarios.md``.

``file`` declares the file and ``catalogue`` lists the files that it names. ``drawing`` draws the ``choices`` of a
scene: ``placement`` puts objects on surfaces, or ``physics`` drops them, and ``camera_paths`` places cameras. ``build``
makes the scene from its choices alone, which ``scene.json`` records, with ``models``, ``materials``, ``surfaces``,
``tracks`` and ``scenery`` (lights, background and sensor).
"""
