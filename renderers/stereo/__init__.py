"""Stereo camera algorithms as pure functions on arrays.

Modules, in the order in which a frame uses them:

* ``model``: geometry of the camera.
* ``exposure``, ``sensor`` and ``projector``: camera images, and the light of the random-dot projector in them.
* ``realism``: names of the parts of realistic images. ``key_light``, ``optics``, ``fixed_pattern``, ``motion_blur``
  and ``projector_pattern`` make these parts.
* ``truth``: exact disparity. ``errors``: disparity with the errors of a matcher. ``matching``: disparity from a pair of
  images. Both of the latter need ``residual_shift``, ``pixel_classes`` and the ``matcher_statistics`` of each class.
* ``filters``: the device's post-processing of depth images.
* ``mesh`` and ``ply``: triangle meshes from depth images.

``trajectory`` makes a smooth path from timed poses, and ``imu`` the measurements of an inertial measurement unit on it.

Formulas are those of the rc_visard's manual unless a docstring says otherwise.
"""
