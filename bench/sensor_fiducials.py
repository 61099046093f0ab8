"""Ranges of flat patterns in camera images against ideal images of the same pose, with OpenCV's detectors.

``report_tags`` is a part of ``python -m bench.sensor``.
"""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.stereo.device.camera_config import StereoConfig
from gateway.stereo.imaging.rendered_images import Capture, ImageRequest, Imaging
from renderers.drawlist import DrawList, Image, Instance, Material, Mesh, Texture
from renderers.raster import CpuRenderer
from renderers.stereo.lens.optics import LENS_BLUR
from renderers.stereo.realism import RealismPart
from renderers.stereo.sensor.exposure import DISPLAY_GAMMA, Exposure
from renderers.stereo.sensor.noise import NoiseStream

TEXELS: Final = 24
"""Texels per cell of a tag: finer than the pixels of the image."""
TAG_ID: Final = 17
WHITE: Final = 0.8
"""Albedo of white cells."""
TAG_SIDE: Final = 0.08
"""Side of the black square of ``report_tags``, metres."""
DISTANCES: Final = (0.6, 0.8, 1.0, 1.2, 1.5)
"""Distances of ``report_tags``, metres."""


def tag(name: int) -> NDArray[np.uint8]:
    """Return a tag of one of OpenCV's dictionaries with a white border of a cell, a value per cell."""
    dictionary = cv2.aruco.getPredefinedDictionary(name)
    cells = dictionary.markerSize + 2
    image = np.asarray(cv2.aruco.generateImageMarker(dictionary, TAG_ID, cells), np.uint8)
    return np.pad(image, 1, constant_values=255)


def tag_texture(name: int) -> NDArray[np.uint8]:
    """Return the texture of a tag, ``TEXELS`` per cell."""
    return np.kron(tag(name), np.ones((TEXELS, TEXELS), np.uint8))


class View:
    """A flat pattern before the left camera: its camera image, and the ideal one."""

    def __init__(
        self,
        texture: NDArray[np.uint8],
        size: tuple[float, float],
        rotation: tuple[float, float, float],
        distance: float,
        parts: tuple[RealismPart, ...] = (),
    ):
        """
        Args:
            texture: grey values of the pattern.
            size: width and height of the pattern, metres.
            rotation: rotation vector of the pattern, radians.
            distance: depth of its centre, metres.
            parts: parts of ``--stereo-realism``.
        """
        self.config = StereoConfig(noise=False, realism=frozenset(parts))
        self.texture, self.size, self.blur = texture, size, LENS_BLUR if "lens-blur" in parts else 0.0
        self.pose = np.eye(4)
        self.pose[:3, :3] = cv2.Rodrigues(np.array(rotation))[0]
        self.pose[:3, 3] = (0.031, -0.023, distance)
        self.k = self.config.model.intrinsics()
        center = self.pose[:2, 3] / distance * self.k.focal_length + (self.k.cx, self.k.cy)
        half = int(0.85 * max(size) / distance * self.k.focal_length)
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
        request = ImageRequest(Exposure(), NoiseStream.LEFT, frozenset((False,)))
        whole = Imaging(self.config, renderer).expose(capture, request)[False].image
        return np.ascontiguousarray(whole[self.top : self.top + self.side, self.left : self.left + self.side])

    def ideal_image(self, rays_per_side: int = 6) -> NDArray[np.uint8]:
        """Return the mean light of ``rays_per_side`` squared rays per pixel, behind the lens, (side, side) uint8."""
        count = rays_per_side
        at = (np.arange(self.side * count) + 0.5) / count
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
        light = light.reshape(self.side, count, self.side, count).mean(axis=(1, 3))
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

    def tag_ranges(self, name: int, side: float, renderer: CpuRenderer) -> tuple[float, float]:
        """Return the distance of a tag's centre by its camera image and by its ideal image, metres.

        Args:
            name: OpenCV's dictionary.
            side: side of the black square, metres.
            renderer: renderer of the camera image.

        Raises:
            ValueError: the tag is not found in one of the images.
        """
        half = side / 2
        points = np.array(((-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)))
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(name), parameters)
        ranges = []
        for image in (self.camera_image(renderer), self.ideal_image()):
            corners, ids, _ = detector.detectMarkers(image)
            if ids is None or ids.ravel().tolist() != [TAG_ID]:
                raise ValueError("the tag is not found")
            ranges.append(self.range(corners[0], points))
        return ranges[0], ranges[1]


def report_tags(renderer: CpuRenderer) -> None:
    """Print the error of the range of a frontal AprilTag by distance, and that of ideal images."""
    name = cv2.aruco.DICT_APRILTAG_36h11
    texture = tag_texture(name)
    whole = TAG_SIDE * texture.shape[0] / (texture.shape[0] - 2 * TEXELS)
    print(f"\nAprilTag 36h11 of {TAG_SIDE * 1e3:.0f} mm: distance m, side px, error of the range %, ideal image %")
    for parts in ((), ("lens-blur",)):
        for distance in DISTANCES:
            view = View(texture, (whole, whole), (0.0, 0.0, 0.02), distance, parts)
            true = float(np.linalg.norm(view.pose[:3, 3]))
            errors = (100.0 * (each / true - 1.0) for each in view.tag_ranges(name, TAG_SIDE, renderer))
            pixels = TAG_SIDE / distance * view.k.focal_length
            print(
                f"  {', '.join(parts) or 'off':12} {distance:5.2f} {pixels:6.1f}"
                + " ".join(f"{e:8.3f}" for e in errors)
            )
