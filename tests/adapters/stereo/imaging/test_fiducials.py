"""Ranges of fiducials in camera images against ideal images of the same pose, with OpenCV's detectors."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import pytest

from renderers.raster import CpuRenderer
from renderers.stereo.realism import RealismPart
from tests.adapters.stereo.imaging.fiducials import PATTERNS, TEXELS, View, circles, pattern_errors, tag_texture

CELL: Final = 0.01
"""Side of a cell, metres."""
POSES: Final = {
    "frontal": ((0.0, 0.0, 0.02), 1.0),
    "tilted": ((0.5, 0.3, 0.2), 1.0),
    "oblique": ((0.1, -0.9, 0.7), 0.8),
}
"""Rotation vector and distance in metres; tags of 8 cells are 60 to 90 pixels wide."""


@pytest.mark.slow
@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize(
    ("name", "parts"),
    [(cv2.aruco.DICT_APRILTAG_36h11, ()), (cv2.aruco.DICT_APRILTAG_36h11, ("lens-blur",)), (cv2.aruco.DICT_4X4_50, ())],
)
def test_ranges_of_tags_are_those_of_ideal_images(
    renderer: CpuRenderer, name: int, pose: str, parts: tuple[RealismPart, ...]
) -> None:
    texture, whole = tag_texture(name), 10 * CELL
    side = whole * (1.0 - 2 * TEXELS / len(texture))
    measured, ideal = View(texture, (whole, whole), *POSES[pose], parts).tag_ranges(name, side, renderer)
    assert measured == pytest.approx(ideal, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("pose", POSES)
def test_ranges_of_circle_grids_are_those_of_ideal_images(renderer: CpuRenderer, pose: str) -> None:
    view = View(circles(), (11 * CELL, 9 * CELL), *POSES[pose])
    measured, ideal = view.grid_ranges(2 * CELL, renderer)
    assert measured == pytest.approx(ideal, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("pattern", PATTERNS)
def test_ranges_do_not_depend_on_sub_pixel_placements(renderer: CpuRenderer, pattern: str) -> None:
    errors = pattern_errors(pattern, 1.2, ("lens-blur",), renderer)
    assert abs(errors.mean()) < 0.05
    assert np.abs(errors).max() < 0.1
