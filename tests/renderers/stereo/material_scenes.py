"""Depth of materials: plates before a textured wall, and plain walls that the projector lights."""

from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.imaging.rendered_images import Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.demo.objects import tile
from gateway.files.gltf import read_gltf
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Part, Surface
from gateway.scene.tree.transforms import translation
from renderers.drawlist import DrawList, Material
from renderers.interface import Output
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.model import DISPARITY_SCALE
from renderers.stereo.realism import REALISM_PARTS
from tests.adapters.stereo.scenes import scene_of
from tools.calibration.errors import match
from tools.calibration.samples import Sample, make_sample, renderer

MATERIALS: Final = {
    "mirror": 1, "brushed metal": 2, "glass": 3, "black": 4, "chequer": 5, "weak texture": 6, "strong texture": 7,
}  # fmt: skip
"""Numbers of the plates of ``cases/sensor/materials.glb``."""
SEED: Final = 900
"""Seed of the noise."""


class Scenes:
    """Samples of scenes from the origin along +z."""

    def __init__(self, *, realism: bool) -> None:
        self.imaging = Imaging(StereoConfig(seed=SEED, realism=frozenset(REALISM_PARTS if realism else ())), renderer())
        self.parameters = Parameters()

    def capture(self, scene: DrawList, *, projector: bool) -> Capture:
        return Capture(0, scene, 1, np.eye(4), int(projector), 1)

    def sample(self, scene: DrawList, *, projector: bool) -> Sample:
        settings = read_settings(self.parameters)
        return make_sample("", self.imaging, settings, self.capture(scene, projector=projector))

    def instances(self, sample: Sample) -> NDArray[np.int32]:
        """Return the instance that the left camera sees in each pixel of the depth image, panes of glass included."""
        divisor = sample.settings.quality.divisor
        frame: Any = self.imaging.render(sample.capture, 0.0, divisor, Output.INSTANCE)
        return frame.instance


def filled_and_wrong(sample: Sample, images: DepthImages, region: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the share of a region's pixels that have depth, and the share of these that are off by over a pixel."""
    inside = cv2.erode((region & (sample.visible > 0)).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    filled = inside & (images.disparity > 0)
    deviation = np.abs(images.disparity[filled] * DISPARITY_SCALE - sample.exact[filled])
    return float(filled.sum() / max(inside.sum(), 1)), float((deviation > 1.0).mean()) if filled.any() else 0.0


def plates(scene: DrawList, *, projector: bool, realism: bool) -> dict[str, tuple[float, float]]:
    """Return ``filled_and_wrong`` of each plate of ``cases/sensor/materials.glb``; the depth behind glass is right."""
    scenes = Scenes(realism=realism)
    sample = scenes.sample(scene, projector=projector)
    instances, images = scenes.instances(sample), match(sample)
    return {name: filled_and_wrong(sample, images, instances == number) for name, number in MATERIALS.items()}


def read_plates(corpus: Path) -> DrawList:
    return flatten(read_gltf((corpus / "cases/sensor/materials.glb").read_bytes()).root)


def filled_wall(albedo: float, distance: float) -> float:
    """Return the share of a plain wall that has depth with the projector and an exposure time of 5 ms."""
    scenes = Scenes(realism=False)
    scenes.parameters.set("rc_camera", [("exp_control", "Manual"), ("exp_value", 0.005)])
    material = Material((albedo, albedo, albedo, 1.0), metallic=0.0, roughness=0.8, double_sided=True)
    plate = Part(Surface(tile(30.0, 2)), material, translation(0.0, 0.0, distance))
    sample = scenes.sample(scene_of(plate), projector=True)
    return filled_and_wrong(sample, match(sample), np.ones(sample.visible.shape, np.bool_))[0]
