"""Ranges of fiducials in camera images against ideal images of the same pose, with OpenCV's detectors."""

from typing import Final

import pytest

from renderers.raster import CpuRenderer
from renderers.stereo.realism import RealismPart
from tests.adapters.stereo.imaging.fiducials import View

POSES: Final = {
    "frontal": ((0.0, 0.0, 0.02), 1.0),
    "tilted": ((0.5, 0.3, 0.2), 1.0),
    "oblique": ((0.1, -0.9, 0.7), 0.8),
}
"""Rotation vector and distance in metres; tags of 8 cells are 60 to 90 pixels wide."""


@pytest.mark.slow
@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize(
    ("pattern", "cell", "parts"),
    [
        ("AprilTag 36h11", 0.01, ()),
        ("AprilTag 36h11", 0.01, ("lens-blur",)),
        ("ArUco 4x4", 0.0125, ()),
        ("circle grid", 0.01, ()),
    ],
)
def test_ranges_of_patterns_are_those_of_ideal_images(
    renderer: CpuRenderer, pattern: str, cell: float, pose: str, parts: tuple[RealismPart, ...]
) -> None:
    measured, ideal = View(pattern, cell, *POSES[pose], parts).ranges(renderer)
    assert measured == pytest.approx(ideal, rel=1e-3)
