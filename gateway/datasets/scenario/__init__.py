"""Scenarios: a TOML file from which scenes are drawn by a seed. See ``docs/scenarios.md``.

``file`` reads its ``tables``, and ``catalogue`` lists the files that it names. ``drawing`` draws the ``choices`` of a
scene: an ``arrangement`` puts objects on surfaces (``placement``) or drops them (``physics``), and ``camera_paths`` has
cameras. ``build`` makes the scene from its choices alone, which ``scene.json`` records, with ``models``,
``drawn_materials``, ``surfaces``, ``tracks`` and ``scenery`` (lights, background and sensor).
"""
