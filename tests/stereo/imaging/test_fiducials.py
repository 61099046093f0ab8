"""Ranges of fiducials in camera images against ideal images of the same pose, with OpenCV's detectors."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from bench.sensor_fiducials import TEXELS, View, tag_texture
from renderers.raster import CpuRenderer
from renderers.stereo.realism import RealismPart

CELL: Final = 0.01
"""Side of a cell, metres."""
POSES: Final = {
    "frontal": ((0.0, 0.0, 0.02), 1.0),
    "tilted": ((0.5, 0.3, 0.2), 1.0),
    "oblique": ((0.1, -0.9, 0.7), 0.8),
}
"""Rotation vector and distance in metres; tags of 8 cells are 60 to 90 pixels wide."""


def circles() -> NDArray[np.uint8]:
    """Return a grid of 4 x 3 black circles, 24 texels per cell."""
    y, x = (np.mgrid[0 : 9 * TEXELS, 0 : 11 * TEXELS] + 0.5) / TEXELS
    far = np.hypot((x - 1.5) % 2 - 1.0, (y - 1.5) % 2 - 1.0) > 0.6
    border = (x < 1.5) | (y < 1.5) | (x > 9.5) | (y > 7.5)
    return np.where(far | border, 255, 0).astype(np.uint8)


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
    points = np.array([(2 * i * CELL, 2 * j * CELL, 0.0) for j in range(3) for i in range(4)])
    points -= points.mean(axis=0)
    parameters = cv2.SimpleBlobDetector.Params()
    parameters.minArea, parameters.minDistBetweenBlobs = 15.0, 5.0
    detector = cv2.SimpleBlobDetector.create(parameters)
    flags = cv2.CALIB_CB_SYMMETRIC_GRID | cv2.CALIB_CB_CLUSTERING
    ranges = []
    for image in (view.camera_image(renderer), view.ideal_image()):
        found, centers = cv2.findCirclesGrid(image, (4, 3), flags=flags, blobDetector=detector)
        assert found
        ranges.append(view.range(centers, points))
    assert ranges[0] == pytest.approx(ranges[1], rel=1e-3)
