"""Ranges of fiducials in camera images against ideal images of the same pose, with OpenCV's detectors."""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.stereo.config import StereoConfig
from gateway.stereo.images import Capture, ImageRequest
from gateway.stereo.realistic_images import make_imaging
from renderers.drawlist import DrawList, Image, Instance, Material, Mesh, Texture
from renderers.raster import CpuRenderer
from renderers.stereo.exposure import DISPLAY_GAMMA, Exposure
from renderers.stereo.noise import NoiseStream
from renderers.stereo.optics import LENS_BLUR
from renderers.stereo.realism import RealismPart

TEXELS: Final = 24
"""Texels per cell: finer than the pixels of the image."""
CELL: Final = 0.01
"""Side of a cell, metres."""
WHITE: Final = 0.8
POSES: Final = {
    "frontal": ((0.0, 0.0, 0.02), 1.0),
    "tilted": ((0.5, 0.3, 0.2), 1.0),
    "oblique": ((0.1, -0.9, 0.7), 0.8),
}
"""Rotation vector and distance in metres; tags of 8 cells are 60 to 90 pixels wide."""


def tag(name: int) -> NDArray[np.uint8]:
    """Return a tag with a white border of a cell, a value per cell."""
    dictionary = cv2.aruco.getPredefinedDictionary(name)
    cells = dictionary.markerSize + 2
    return np.pad(np.asarray(cv2.aruco.generateImageMarker(dictionary, 17, cells), np.uint8), 1, constant_values=255)


def circles() -> NDArray[np.uint8]:
    """Return a grid of 4 x 3 black circles, 24 texels per cell."""
    y, x = (np.mgrid[0 : 9 * TEXELS, 0 : 11 * TEXELS] + 0.5) / TEXELS
    far = np.hypot((x - 1.5) % 2 - 1.0, (y - 1.5) % 2 - 1.0) > 0.6
    border = (x < 1.5) | (y < 1.5) | (x > 9.5) | (y > 7.5)
    return np.where(far | border, 255, 0).astype(np.uint8)


class View:
    """A flat pattern before the left camera: its camera image, and the ideal one."""

    def __init__(
        self, texture: NDArray[np.uint8], size: tuple[float, float], pose: str, parts: tuple[RealismPart, ...]
    ):
        self.config = StereoConfig(noise=False, realism=frozenset(parts))
        self.texture, self.size, self.blur = texture, size, LENS_BLUR if parts else 0.0
        rotation, z = POSES[pose]
        self.pose = np.eye(4)
        self.pose[:3, :3] = cv2.Rodrigues(np.array(rotation))[0]
        self.pose[:3, 3] = (0.031, -0.023, z)
        self.k = self.config.model.intrinsics()
        center = self.pose[:2, 3] / z * self.k.focal_length + (self.k.cx, self.k.cy)
        self.left, self.top = (int(each) - 90 for each in center)

    def camera_image(self, renderer: CpuRenderer) -> NDArray[np.uint8]:
        rgba = np.dstack((*(self.texture,) * 3, np.full_like(self.texture, 255)))
        image = Image(b"", lambda: rgba)
        x, y = self.size[0] / 2, self.size[1] / 2
        mesh = Mesh(
            np.array(((-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)), np.float32),
            np.array(((0, 1, 2), (0, 2, 3)), np.uint32),
            uv0=np.array(((0, 0), (1, 0), (1, 1), (0, 1)), np.float32),
        )
        material = Material((WHITE, WHITE, WHITE, 1.0), Texture(image), double_sided=True, unlit=True)
        capture = Capture(0, DrawList((Instance(mesh, material, self.pose),), (image,)), 1, np.eye(4), 0, 1)
        request = ImageRequest(Exposure(), NoiseStream.LEFT, frozenset((False,)))
        whole = make_imaging(self.config, renderer).expose(capture, request)[False].image
        return np.ascontiguousarray(whole[self.top : self.top + 180, self.left : self.left + 180])

    def ideal_image(self, side: int = 6) -> NDArray[np.uint8]:
        """Return the mean light of ``side`` squared rays per pixel, behind the lens."""
        at = (np.arange(180 * side) + 0.5) / side
        x, y = (at + self.left - self.k.cx) / self.k.focal_length, (at + self.top - self.k.cy) / self.k.focal_length
        rays = np.stack((*np.meshgrid(x, y), np.ones((len(at), len(at)))), axis=-1)
        on_plane = rays @ np.linalg.inv(self.pose[:3, [0, 1, 3]]).T
        height, width = self.texture.shape
        column = np.floor((on_plane[..., 0] / on_plane[..., 2] / self.size[0] + 0.5) * width).astype(int)
        row = np.floor((on_plane[..., 1] / on_plane[..., 2] / self.size[1] + 0.5) * height).astype(int)
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        texel = self.texture[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
        red, green, blue = (np.array(self.config.background) / 255.0) ** DISPLAY_GAMMA
        light = np.where(inside, texel / 255.0 * WHITE, 0.299 * red + 0.587 * green + 0.114 * blue)
        light = light.reshape(180, side, 180, side).mean(axis=(1, 3))
        outer = 0.5 * self.blur**2
        taps = np.array((outer, 1.0 - 2.0 * outer, outer))
        return np.asarray(np.rint(255.0 * cv2.sepFilter2D(light, -1, taps, taps)), np.uint8)

    def range(self, corners: Any, points: NDArray[np.float64]) -> float:
        """Return the distance of points of the pattern, (N, 3), from their pixels, (N, 2)."""
        k = self.k
        K = np.array(((k.focal_length, 0, k.cx - 0.5), (0, k.focal_length, k.cy - 0.5), (0, 0, 1)))
        pixels = corners.reshape(-1, 2).astype(float) + np.array((self.left, self.top))
        _, _, translation = cv2.solvePnP(points, pixels, K, None)
        return float(np.linalg.norm(translation))


@pytest.mark.slow
@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize(
    ("name", "parts"),
    [(cv2.aruco.DICT_APRILTAG_36h11, ()), (cv2.aruco.DICT_APRILTAG_36h11, ("lens-blur",)), (cv2.aruco.DICT_4X4_50, ())],
)
def test_ranges_of_tags_are_those_of_ideal_images(
    renderer: CpuRenderer, name: int, pose: str, parts: tuple[RealismPart, ...]
) -> None:
    cells = tag(name)
    cell = CELL * 10 / len(cells)
    view = View(np.kron(cells, np.ones((TEXELS, TEXELS), np.uint8)), (len(cells) * cell,) * 2, pose, parts)
    half = (len(cells) - 2) * cell / 2
    points = np.array(((-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)))
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(name), parameters)
    ranges = []
    for image in (view.camera_image(renderer), view.ideal_image()):
        corners, ids, _ = detector.detectMarkers(image)
        assert ids.ravel().tolist() == [17]
        ranges.append(view.range(corners[0], points))
    assert ranges[0] == pytest.approx(ranges[1], rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("pose", POSES)
def test_ranges_of_circle_grids_are_those_of_ideal_images(renderer: CpuRenderer, pose: str) -> None:
    view = View(circles(), (11 * CELL, 9 * CELL), pose, ())
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
