"""Stereo camera algorithms as pure functions on arrays. ``model`` is the geometry of the camera.

Rooms:

* ``sensor``: camera images (``camera_image``) with their exposure, noise and fixed pattern.
* ``lens``: motion blur, the colour camera.
* ``light``: the random-dot projector and the key light. ``realism`` has the names of the parts of realistic images.
* ``depth``: exact disparity (``depth_images``), or that of a matcher (``matching`` with ``residual_shift`` and
  ``match_confidence``). ``filters`` is the device's post-processing.
* ``mesh``: triangle meshes from depth images.

Formulas are those of the rc_visard's manual unless a docstring says otherwise. Where nothing else is said,

* images are (H, W). Disparities are pixels, or as uint16 units of 1/16 pixel; 0: unknown. Depths are metres along the
  optical axis, +inf: background. Grey images of uint16, which are rectified, have units of 1/16 level;
* ``focal_length``, ``cx`` and ``cy`` are the focal length and the principal point, pixels from the left and top edge;
  ``focal_times_baseline`` is a disparity times its depth, pixels times metres;
* ``divisor`` is the width of the camera images divided by that of the images at hand, and ``noise_sigma`` the standard
  deviation of their noise by grey level, (256,), grey levels, above 0;
* kernels write their last arguments.
"""
