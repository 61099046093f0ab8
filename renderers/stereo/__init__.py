"""Stereo camera algorithms as pure functions on arrays.

Modules, in the order in which a frame uses them:

* ``model``: geometry of the camera.
* ``exposure``, ``sensor`` and ``projector``: camera images, and the light of the random-dot projector in them.
* ``realism`` names the parts of realistic images: ``key_light``, ``optics``, ``fixed_pattern``, ``motion_blur`` and
  ``projector_pattern``.
* ``truth``: exact disparity. ``errors``: what a matcher would have measured instead. ``matching``: what ours measures
  in two camera images. Both need ``pixel_classes`` and the ``matcher_statistics`` of each class; ``smooth_noise`` is
  the noise of errors.
* ``filters``: the device's post-processing of depth images.
* ``mesh`` and ``ply``: triangle meshes from depth images.

``trajectory`` makes a smooth path from timed poses, and ``imu`` says what an inertial measurement unit measures on it.

Formulas are those of the rc_visard's manual unless a docstring says otherwise.
"""
