"""The stereo camera as pure functions on arrays: sensor, depth, errors, filters, matching and meshes.

Sources of the formulae: rc_visard's manual (disparity to depth, meaning of error and confidence, accuracy table); what
is our own choice says so where it is made.
"""
