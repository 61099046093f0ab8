"""Stereo camera algorithms as pure functions on arrays. ``model`` is the geometry of the camera.

Rooms:

* ``sensor``: camera images (``camera_image``) with their exposure, noise and fixed pattern.
* ``lens``: motion blur, the colour camera.
* ``light``: the random-dot projector and the key light. ``realism`` has the names of the parts of realistic images.
* ``depth``: exact disparity (``depth_images``), or that of a matcher (``matching`` with ``residual_shift`` and
  ``match_confidence``). ``filters`` is the device's post-processing.
* ``mesh``: triangle meshes from depth images.

Formulas are those of the rc_visard's manual unless a docstring says otherwise.
"""
