"""Writes docs/images/stereo-light.webp, left images of five scenes: ``python -m tools.pictures.stereo_light [OUT]``.

A room, a corridor, a shelf, a table and outdoor ground, with the default light and exposure.
"""

import sys
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.imaging.rendered_images import GREY, ImageRequest, Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node, TreeEdit
from gateway.scene.tree.transforms import look_at
from renderers.raster import CpuRenderer
from renderers.stereo.sensor.camera_image import NoiseStream
from tools.calibration.plain_scenes import planks
from tools.calibration.scenes import box, plain, textured

SIZE: Final = (426, 320)
"""Width and height of each image, pixels."""
_random: Final = np.random.default_rng(3)


def _walls(length: float, width: float, height: float) -> list[Part]:
    """Return a closed room of textured walls, centred on the origin of the floor."""
    half, middle = width / 2, height / 2
    return [
        box(0, 0, -0.05, (length, width, 0.1), planks(_random)),
        box(0, 0, height + 0.05, (length, width, 0.1), plain(_random)),
        *(box(0, side * (half + 0.05), middle, (length, 0.1, height), textured(_random)) for side in (-1, 1)),
        *(box(side * length / 2, 0, middle, (0.1, width, height), textured(_random)) for side in (-1, 1)),
    ]


def _boxes(count: int, x: float, z: float) -> list[Part]:
    """Return boxes in a row along y, which stand on the height z."""
    sides = _random.uniform(0.1, 0.24, (count, 3))
    places = np.linspace(-0.9, 0.9, count)
    return [
        box(x, y, z + size[2] / 2, tuple(size), textured(_random) if k % 2 else plain(_random))
        for k, (y, size) in enumerate(zip(places.tolist(), sides, strict=True))
    ]


def _shelf() -> list[Part]:
    boards = [box(1.2, 0, z, (0.4, 2.2, 0.03), planks(_random)) for z in (0.3, 0.8, 1.3, 1.8)]
    return [*_walls(5, 4, 2.6), *boards, *(part for z in (0.3, 0.8, 1.3) for part in _boxes(7, 1.15, z + 0.015))]


def _table() -> list[Part]:
    return [*_walls(6, 5, 2.6), box(1.2, 0, 0.72, (0.9, 2.0, 0.04), planks(_random)), *_boxes(7, 1.1, 0.74)]


def _outdoor() -> list[Part]:
    ground = box(0, 0, -0.05, (60, 60, 0.1), textured(_random))
    return [ground, *(box(x, y, 0.5, (0.4, 0.4, 1.0), plain(_random)) for x, y in ((3, -1), (5, 1), (9, -2), (14, 3)))]


def picture(
    parts: list[Part], eye: tuple[float, float, float], target: tuple[float, float, float]
) -> NDArray[np.uint8]:
    """Return the left image of a scene, of ``SIZE``, with the default parameters."""
    edit = TreeEdit(Node())
    edit.set_parts(("scene",), tuple(parts))
    imaging, settings = Imaging(StereoConfig(), CpuRenderer()), read_settings(Parameters())
    capture = Capture(0, flatten(edit.commit()), 1, look_at(eye, target, (0.0, 0.0, 1.0)), 0)
    exposure = imaging.meter(capture, settings).exposure
    left = imaging.expose(capture, ImageRequest(exposure, NoiseStream.LEFT, frozenset((GREY,))))[GREY].image
    return np.asarray(cv2.resize(left, SIZE, interpolation=cv2.INTER_AREA), np.uint8)


def main(out: str = "docs/images/stereo-light.webp") -> None:
    """Write the five images side by side."""
    pictures = [
        picture(_walls(6, 4, 2.6), (-2.5, 0, 1.2), (3, 0, 1.2)),
        picture(_walls(12, 1.6, 2.5), (-5.5, 0, 1.2), (6, 0, 1.2)),
        picture(_shelf(), (-1.0, 0.3, 1.3), (1.2, 0, 0.9)),
        picture(_table(), (-0.4, 0.5, 1.6), (1.2, 0, 0.75)),
        picture(_outdoor(), (0, 0, 1.4), (6, 0, 0.6)),
    ]
    cv2.imwrite(out, np.hstack(pictures), [cv2.IMWRITE_WEBP_QUALITY, 80])


if __name__ == "__main__":
    main(*sys.argv[1:])
