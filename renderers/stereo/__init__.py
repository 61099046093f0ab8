"""Stereo camera algorithms as pure functions on arrays.

In the order of a frame: ``model`` (geometry), ``exposure`` and ``sensor`` (images), ``projector`` (its light),
``truth`` and ``errors`` or ``matching`` (depth), ``filters`` (the device's post-processing), ``mesh``.

Formulae are those of the rc_visard's manual unless a docstring says otherwise.
"""
