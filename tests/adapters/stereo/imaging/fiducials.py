"""Ranges of flat patterns in camera images against ideal images of the same pose, with OpenCV's detectors."""

from collections.abc import Callable
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.imaging.rendered_images import Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from renderers.drawlist import DrawList, Image, Instance, Material, Mesh, Texture
from renderers.raster import CpuRenderer
from renderers.stereo.realism import RealismPart
from renderers.stereo.sensor.camera_image import LENS_BLUR
from renderers.stereo.sensor.exposure import DISPLAY_GAMMA, Exposure
from tests.adapters.stereo.camera_images import expose

Find = Callable[[NDArray[np.uint8]], Any]
"""Finds the pixels of a pattern's points; None: it is not seen."""
TEXELS: Final = 24
"""Texels per cell of a tag: finer than the pixels of the image."""
TAG_ID: Final = 17
RAYS: Final = 61
"""Rays per pixel of an ideal image, on a lattice: no two have the same row or column. A grid of 6 x 6 rays moves
upright edges by up to 1/12 pixel, which changes ranges by up to 0.1 %."""
LATTICE: Final = 17
"""Step of the lattice's rows."""
WHITE: Final = 0.8
"""Albedo of white cells."""
GRID: Final = (4, 3)
"""Columns and rows of circles of a grid."""
PATTERNS: Final[dict[str, int | None]] = {
    "AprilTag 36h11": cv2.aruco.DICT_APRILTAG_36h11,
    "ArUco 4x4": cv2.aruco.DICT_4X4_50,
    "circle grid": None,
}
"""OpenCV's dictionary by the name of a pattern; None: a grid of circles."""


def texture_of(pattern: str) -> NDArray[np.uint8]:
    """Return the texture of a pattern, ``TEXELS`` per cell, with a white border of a cell around a tag."""
    name = PATTERNS[pattern]
    if name is None:
        return circles()
    dictionary = cv2.aruco.getPredefinedDictionary(name)
    image = np.asarray(cv2.aruco.generateImageMarker(dictionary, TAG_ID, dictionary.markerSize + 2), np.uint8)
    cells = np.pad(image, 1, constant_values=255)
    return np.kron(cells, np.ones((TEXELS, TEXELS), np.uint8)).astype(np.uint8)


class View:
    """A flat pattern before the left camera: its camera image, and the ideal one."""

    def __init__(
        self,
        pattern: str,
        cell: float,
        rotation: tuple[float, float, float],
        distance: float,
        parts: tuple[RealismPart, ...] = (),
    ):
        """
        Args:
            pattern: a name of ``PATTERNS``.
            cell: side of its cells, metres.
            rotation: rotation vector of the pattern, radians.
            distance: depth of its centre, metres.
            parts: parts of ``--stereo-realism``.
        """
        self.config = StereoConfig(noise=False, realism=frozenset(parts))
        self.pattern, self.cell, self.texture = pattern, cell, texture_of(pattern)
        self.size = (cell * self.texture.shape[1] / TEXELS, cell * self.texture.shape[0] / TEXELS)
        self.blur = LENS_BLUR if "lens-blur" in parts else 0.0
        self.pose = np.eye(4)
        self.pose[:3, :3] = cv2.Rodrigues(np.array(rotation))[0]
        self.k = self.config.model.intrinsics()
        self.pose[:3, 3] = (0.031, -0.023, distance)
        center = self.pose[:2, 3] / distance * self.k.focal_length + (self.k.cx, self.k.cy)
        half = int(0.85 * max(self.size) / distance * self.k.focal_length)
        self.left, self.top, self.side = int(center[0]) - half, int(center[1]) - half, 2 * half

    def camera_image(self, renderer: CpuRenderer) -> NDArray[np.uint8]:
        """Return the camera image around the pattern, (side, side) uint8."""
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
        whole = expose(Imaging(self.config, renderer), capture, Exposure()).image
        return np.ascontiguousarray(whole[self.top : self.top + self.side, self.left : self.left + self.side])

    def ideal_image(self) -> NDArray[np.uint8]:
        """Return the mean light of ``RAYS`` rays per pixel, behind the lens, (side, side) uint8."""
        rows, columns = np.mgrid[0 : self.side, 0 : self.side]
        height, width = self.texture.shape
        to_plane = np.linalg.inv(self.pose[:3, [0, 1, 3]])
        light = np.zeros((self.side, self.side))
        for ray in range(RAYS):
            x = (columns + self.left + (ray + 0.5) / RAYS - self.k.cx) / self.k.focal_length
            y = (rows + self.top + (ray * LATTICE % RAYS + 0.5) / RAYS - self.k.cy) / self.k.focal_length
            on_plane = np.stack((x, y, np.ones_like(x)), axis=-1) @ to_plane.T
            column = np.floor((on_plane[..., 0] / on_plane[..., 2] / self.size[0] + 0.5) * width).astype(int)
            row = np.floor((on_plane[..., 1] / on_plane[..., 2] / self.size[1] + 0.5) * height).astype(int)
            inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            texel = self.texture[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
            light += np.where(inside, texel / 255.0 * WHITE, self._background()) / RAYS
        outer = 0.5 * self.blur**2
        taps = np.array((outer, 1.0 - 2.0 * outer, outer))
        return np.asarray(np.rint(255.0 * cv2.sepFilter2D(light, -1, taps, taps)), np.uint8)

    def _background(self) -> float:
        red, green, blue = (np.array(self.config.background) / 255.0) ** DISPLAY_GAMMA
        return float(0.299 * red + 0.587 * green + 0.114 * blue)

    def range(self, corners: Any, points: NDArray[np.float64]) -> float:
        """Return the distance of points of the pattern, (N, 3), from their pixels, (N, 2)."""
        k = self.k
        K = np.array(((k.focal_length, 0, k.cx - 0.5), (0, k.focal_length, k.cy - 0.5), (0, 0, 1)))
        pixels = corners.reshape(-1, 2).astype(float) + np.array((self.left, self.top))
        _, _, translation = cv2.solvePnP(points, pixels, K, None)
        return float(np.linalg.norm(translation))

    def ranges(self, renderer: CpuRenderer) -> tuple[float, float]:
        """Return the distance of the pattern's centre by its camera image and by its ideal image, metres."""
        find, points = self._circles() if PATTERNS[self.pattern] is None else self._tag()
        found = [find(image) for image in (self.camera_image(renderer), self.ideal_image())]
        assert all(pixels is not None for pixels in found), "the pattern is not found"
        measured, ideal = (self.range(pixels, points) for pixels in found)
        return measured, ideal

    def _tag(self) -> tuple[Find, NDArray[np.float64]]:
        """Return what finds the corners of a tag, and these in metres."""
        half = self.cell * (len(self.texture) / TEXELS - 2) / 2
        points = np.array(((-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)))
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        dictionary = cv2.aruco.getPredefinedDictionary(PATTERNS[self.pattern] or 0)
        detector = cv2.aruco.ArucoDetector(dictionary, parameters)

        def corners(image: NDArray[np.uint8]) -> Any:
            found, ids, _ = detector.detectMarkers(image)
            return found[0] if ids is not None and ids.ravel().tolist() == [TAG_ID] else None

        return corners, points

    def _circles(self) -> tuple[Find, NDArray[np.float64]]:
        """Return what finds the centres of circles, and these in metres."""
        columns, rows = GRID
        points = 2 * self.cell * np.array([(i, j, 0.0) for j in range(rows) for i in range(columns)])
        parameters = cv2.SimpleBlobDetector.Params()
        parameters.minArea, parameters.minDistBetweenBlobs = 15.0, 5.0
        detector = cv2.SimpleBlobDetector.create(parameters)
        flags = cv2.CALIB_CB_SYMMETRIC_GRID | cv2.CALIB_CB_CLUSTERING

        def centers(image: NDArray[np.uint8]) -> Any:
            found, pixels = cv2.findCirclesGrid(image, GRID, flags=flags, blobDetector=detector)
            return pixels if found else None

        return centers, points - points.mean(axis=0)


def circles() -> NDArray[np.uint8]:
    """Return the texture of a ``GRID`` of black circles, two cells apart, with a border."""
    columns, rows = GRID
    y, x = (np.mgrid[0 : (2 * rows + 3) * TEXELS, 0 : (2 * columns + 3) * TEXELS] + 0.5) / TEXELS
    far = np.hypot((x - 1.5) % 2 - 1.0, (y - 1.5) % 2 - 1.0) > 0.6
    border = (x < 1.5) | (y < 1.5) | (x > 2 * columns + 1.5) | (y > 2 * rows + 1.5)
    return np.where(far | border, 255, 0).astype(np.uint8)
