"""Compile every kernel of the stereo camera into the cache, or load it from there."""

from __future__ import annotations

import numpy as np

from renderers.stereo.errors import ErrorModel, add_errors
from renderers.stereo.exposure import Exposure
from renderers.stereo.filters import Filters, apply_filters
from renderers.stereo.matching import match_pair
from renderers.stereo.mesh import MeshOptions, disparity_mesh
from renderers.stereo.model import Intrinsics
from renderers.stereo.noise import NoiseStream, frame_key
from renderers.stereo.projector import projected_dots
from renderers.stereo.sensor import sensor_image
from renderers.stereo.truth import DepthRange, true_disparity


def warm_up() -> None:
    """Call every kernel once. Blocks: compiling takes about ten seconds, loading less than one."""
    k = Intrinsics(64, 48, 50.0, 32.0, 24.0)
    key = frame_key(0, 0, NoiseStream.DISPARITY)
    depth = np.full((k.height, k.width), 2.0, np.float32)
    depth[10:14, 20:24] = np.inf
    dots = projected_dots(depth, k.focal_length, k.cx, k.cy, 0.1, depth)
    rendered = np.full((k.height, k.width, 3), 90, np.uint8)
    sensor_image(rendered, Exposure(), key, color=True)
    sensor_image(rendered, Exposure(), key, color=False)
    image = sensor_image(rendered, Exposure(), key, color=False, dots=dots, dot_light=1.0).image
    match_pair(image, image, 16, 0.3)
    measured = add_errors(true_disparity(depth, depth, 50.0 * 0.16, DepthRange(0.4, 100.0)), ErrorModel(0.25), key)
    apply_filters(measured, Filters(), 50.0 * 0.16, 2)
    disparity_mesh(measured.disparity, k, 0.16, MeshOptions(watertight=True, textured=True), image)
