"""Stereo camera algorithms as pure functions on arrays.

Modules, in the order in which a frame uses them:

* ``model``: geometry of the camera.
* ``exposure``, ``sensor`` and ``projector``: camera images, and the light of the random-dot projector in them.
* ``truth`` and ``errors``: depth images from rendered depth. ``matching``: depth images from two camera images.
* ``filters``: the device's post-processing of depth images.
* ``mesh`` and ``ply``: triangle meshes from depth images.

``trajectory`` makes a smooth path from timed poses, and ``imu`` says what an inertial measurement unit measures on it.

Formulas are those of the rc_visard's manual unless a docstring says otherwise.
"""
