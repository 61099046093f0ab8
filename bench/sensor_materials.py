"""Depth of materials, and the camera's response to light: parts of ``python -m bench.sensor``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.sensor_images import Sample, make_sample, renderer
from bench.sensor_scenes import textured
from bench.sensor_time import Measure, slanted, wall
from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.imaging.rendered_images import ImageRequest, Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.demo.meshes import tile
from gateway.files.gltf import read_gltf
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Part, Surface
from gateway.scene.tree.transforms import translation
from renderers.drawlist import DrawList, Material
from renderers.interface import Output
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.model import DISPARITY_SCALE
from renderers.stereo.realism import REALISM_PARTS
from renderers.stereo.sensor.camera_image import NoiseStream
from renderers.stereo.sensor.exposure import Exposure

MATERIALS: Final = {
    "mirror": 1, "brushed metal": 2, "glass": 3, "black": 4, "chequer": 5, "weak texture": 6, "strong texture": 7,
}  # fmt: skip
"""Numbers of the plates of ``cases/sensor/materials.glb``."""
SEED: Final = 900
"""Seed of the noise."""
GAMMAS: Final = (0.5, 1.0, 2.0)
LONGER: Final = 2.5
"""Factor of the exposure time in ``report_response``."""
ALBEDOS: Final = (0.5, 0.1, 0.03, 0.01, 0.003)
"""Base colours of the walls of ``report_reach``."""
DISTANCES: Final = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
"""Distances of these walls, metres."""


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
        frame = self.imaging.render(sample.capture, 0.0, divisor, Output.INSTANCE)
        assert frame.instance is not None
        return frame.instance


def filled_and_wrong(sample: Sample, images: DepthImages, region: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the share of a region's pixels that have depth, and the share of these that are off by over a pixel."""
    inside = cv2.erode((region & (sample.visible > 0)).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    filled = inside & (images.disparity > 0)
    deviation = np.abs(images.disparity[filled] * DISPARITY_SCALE - sample.exact[filled])
    return float(filled.sum() / max(inside.sum(), 1)), float((deviation > 1.0).mean()) if filled.any() else 0.0


def plates(scene: DrawList, measure: Measure, *, projector: bool, realism: bool) -> dict[str, tuple[float, float]]:
    """Return ``filled_and_wrong`` of each plate of ``cases/sensor/materials.glb``; the depth behind glass is right."""
    scenes = Scenes(realism=realism)
    sample = scenes.sample(scene, projector=projector)
    instances, images = scenes.instances(sample), measure(sample)
    return {name: filled_and_wrong(sample, images, instances == number) for name, number in MATERIALS.items()}


def report_materials(modes: dict[str, Measure], *, realism: bool) -> None:
    """Print the shares of ``plates``."""
    if (corpus := os.environ.get("SCENEGATE_CORPUS")) is None:
        return
    scene = read_plates(Path(corpus))
    print("\nmaterials: filled / wrong, projector off: " + ", ".join(modes) + "; projector on: " + ", ".join(modes))
    columns = [
        plates(scene, measure, projector=projector, realism=realism)
        for projector in (False, True)
        for measure in modes.values()
    ]
    for name in MATERIALS:
        values = [column[name] for column in columns]
        print(f"  {name:15}" + " ".join(f"  {filled:4.2f} / {wrong:4.2f}" for filled, wrong in values))


def read_plates(corpus: Path) -> DrawList:
    """Return ``cases/sensor/materials.glb``."""
    return flatten(read_gltf((corpus / "cases/sensor/materials.glb").read_bytes()).root)


def report_reach(modes: dict[str, Measure], *, realism: bool) -> None:
    """Print how much of a plain wall has depth with the projector, by albedo and distance.

    The exposure time is fixed at 5 ms: in a picture with brighter things, a dark one is not exposed for longer.
    """
    print(f"\nplain walls with the projector, 5 ms: albedo, filled ({' / '.join(modes)}) at m: {DISTANCES}")
    for albedo in ALBEDOS:
        cells = []
        for distance in DISTANCES:
            filled = (filled_wall(albedo, distance, measure, realism=realism) for measure in modes.values())
            cells.append("/".join(f"{each:.2f}" for each in filled))
        print(f"  {albedo:6.3f} " + "  ".join(cells))


def filled_wall(albedo: float, distance: float, measure: Measure, *, realism: bool = False) -> float:
    """Return the share of a plain wall that has depth with the projector and an exposure time of 5 ms."""
    scenes = Scenes(realism=realism)
    scenes.parameters.set("rc_camera", [("exp_control", "Manual"), ("exp_value", 0.005)])
    material = Material((albedo, albedo, albedo, 1.0), metallic=0.0, roughness=0.8, double_sided=True)
    plate = Part(Surface(tile(30.0, 2)), material, translation(0.0, 0.0, distance))
    sample = scenes.sample(wall(plate), projector=True)
    return filled_and_wrong(sample, measure(sample), np.ones(sample.visible.shape, np.bool_))[0]


def report_response() -> None:
    """Print the mean of a camera image by gamma, with that of the light to this power, and by exposure time."""
    scenes = Scenes(realism=False)
    scene = wall(Part(Surface(tile(6.0, 8)), textured(np.random.default_rng(SEED), 0.04), slanted()))

    def image(exposure: Exposure) -> NDArray[np.uint8]:
        request = ImageRequest(exposure, NoiseStream.LEFT, frozenset((False,)))
        return scenes.imaging.expose(scenes.capture(scene, projector=False), request)[False].image

    linear = image(Exposure())
    print("\nresponse: gamma, mean, 255 times the mean of the light to this power")
    for gamma in GAMMAS:
        expected = 255.0 * float(((linear / 255.0) ** gamma).mean())
        print(f"  {gamma:4.1f} {image(Exposure(gamma=gamma)).mean():7.1f} {expected:7.1f}")
    ratio = float(image(Exposure(time=LONGER * Exposure().time)).mean() / linear.mean())
    print(f"exposure time x {LONGER}: grey x {ratio:.3f}")
