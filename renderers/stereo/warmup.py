"""Calls every kernel of the stereo camera once, so that each is compiled into the cache or loaded from it."""

from __future__ import annotations

import numpy as np

from renderers.stereo.errors import ErrorModel, Measured, measure
from renderers.stereo.exposure import Exposure
from renderers.stereo.filters import Filters, apply_filters
from renderers.stereo.matching import match
from renderers.stereo.mesh import MeshOptions, disparity_mesh
from renderers.stereo.model import Intrinsics
from renderers.stereo.noise import Stream, frame_key
from renderers.stereo.projector import dots_on
from renderers.stereo.sensor import take
from renderers.stereo.truth import DepthRange, true_disparity


def warm_up() -> None:
    """Blocks until every kernel is loaded; compiling takes about half a minute, loading less than a second."""
    k = Intrinsics(64, 48, 50.0, 32.0, 24.0)
    key = frame_key(0, 0, Stream.DISPARITY)
    depth = np.full((k.height, k.width), 2.0, np.float32)
    depth[10:14, 20:24] = np.inf
    dots = dots_on(depth, k.focal_length, k.cx, k.cy, 0.1, depth)
    picture = np.full((k.height, k.width, 3), 90, np.uint8)
    image = take(picture, Exposure(), key, color=False, dots=dots, dot_light=1.0).image
    for color in (False, True):
        for light in (None, dots):
            take(picture, Exposure(), key, color=color, dots=light, dot_light=1.0)
    match(image, image, 16, 0.3)
    true = true_disparity(depth, depth, 50.0 * 0.16, DepthRange(0.4, 100.0))
    measured: Measured = measure(true, ErrorModel(0.25), key)
    apply_filters(measured, Filters(), 50.0 * 0.16, 2)
    for watertight in (False, True):
        disparity_mesh(measured.disparity, k, 0.16, MeshOptions(watertight=watertight, textured=True), image)
