"""Errors of the stereo camera's depth over time: ``python -m bench.sensor --over-time``.

A static scene is measured ten times, then once after the camera has moved sideways and once after the body has.
Scenes are the walls of the corpus (``SCENEGATE_CORPUS``) and walls with textures that ``sensor_fit`` has not seen.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.sensor_images import Sample, make_sample, renderer
from bench.sensor_scenes import plain, textured
from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.imaging.rendered_images import Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.demo.meshes import tile
from gateway.files.gltf import read_gltf
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Part, Surface
from gateway.scene.tree.nodes import Node, TreeEdit
from gateway.scene.tree.transforms import Matrix, translation
from renderers.drawlist import DrawList, Instance
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.depth.filters import Filters
from renderers.stereo.depth.matching import refined_matches
from renderers.stereo.model import DISPARITY_SCALE
from renderers.stereo.realism import REALISM_PARTS

Measure = Callable[[Sample], DepthImages]
FRAMES: Final = 10
"""Number of frames of the static scene."""
SHIFTS: Final = (0.25, 0.5, 1.0, 5.0)
"""Motions, pixels of the depth image at ``DISTANCE``."""
DISTANCE: Final = 1.7
"""Distance of the middle of the walls, metres."""
SEED: Final = 900
"""Seed of the textures, which ``sensor_fit`` does not have."""
PHASES: Final = 16
"""Number of bins of the sub-pixel phase."""


@dataclass(frozen=True, slots=True)
class TimeScene:
    """A scene that is seen from the origin along +z."""

    name: str
    scene: DrawList
    projector: bool = False


def wall(*parts: Part) -> DrawList:
    edit = TreeEdit(Node())
    edit.set_parts(("scene",), parts)
    return flatten(edit.commit())


def slanted(z: float = DISTANCE, angle: float = 0.18) -> Matrix:
    """Return the pose of a tile (x and y) that is turned about y, so that all sub-pixel phases occur."""
    X = translation(0.0, 0.0, z)
    X[0, 0] = X[2, 2] = np.cos(angle)
    X[0, 2], X[2, 0] = np.sin(angle), -np.sin(angle)
    return X


def time_scenes() -> Iterator[TimeScene]:
    """Yield walls of strong, weak and no texture, without and with the projector."""
    random = np.random.default_rng(SEED)
    for name, material in (
        ("strong texture", textured(random, 0.15)),
        ("medium texture", textured(random, 0.04)),
        ("weak texture", textured(random, 0.012)),
        ("plain", plain(random)),
    ):
        draw_list = wall(Part(Surface(tile(6.0, 8)), material, slanted()))
        yield TimeScene(name, draw_list)
        if name in ("strong texture", "plain"):
            yield TimeScene(name, draw_list, projector=True)
    if corpus := os.environ.get("SCENEGATE_CORPUS"):
        for name in ("wall_pink", "materials"):
            file = Path(corpus) / "cases/sensor" / f"{name}.glb"
            draw_list = flatten(read_gltf(file.read_bytes()).root)
            yield TimeScene(name, draw_list)
            yield TimeScene(name, draw_list, projector=True)


def moved(scene: DrawList, offset: tuple[float, float, float]) -> DrawList:
    """Return the scene with all bodies moved, metres."""
    X = translation(*offset)
    instances = tuple(Instance(i.mesh, i.material, X @ i.X_world_mesh, i.label, i.instance_id) for i in scene.instances)
    return replace(scene, instances=instances)


class Camera:
    """Camera at the origin that measures a scene after small motions, with all filters off."""

    def __init__(self, *, realism: bool) -> None:
        config = StereoConfig(seed=SEED, realism=frozenset(REALISM_PARTS if realism else ()))
        self.imaging = Imaging(config, renderer())
        settings = read_settings(Parameters())
        self.settings = replace(settings, filters=Filters(minconf=0.0, seg=0, fill=0))

    def sample(self, scene: TimeScene, frame: int, pixels: float = 0.0, *, body: bool = False) -> Sample:
        """Return a sample of a scene.

        Args:
            scene: scene.
            frame: number of the frame.
            pixels: motion of the image along x at ``DISTANCE``.
            body: move the bodies instead of the camera.
        """
        k = self.imaging.config.model.intrinsics(self.settings.quality.divisor)
        offset = pixels * DISTANCE / k.focal_length
        draw_list = moved(scene.scene, (offset, 0.0, 0.0)) if body else scene.scene
        pose = np.eye(4) if body else translation(-offset, 0.0, 0.0)
        return make_sample(
            scene.name, self.imaging, self.settings, Capture(0, draw_list, 1, pose, int(scene.projector), frame)
        )


def deviation_of(sample: Sample, images: DepthImages) -> NDArray[np.float32]:
    """Return measured minus exact disparity where both cameras see the surface, (H, W) float32, pixels; NaN: no depth,
    or off by a pixel or more."""
    return deviation_of_disparity(sample, images.disparity * np.float32(DISPARITY_SCALE))


def deviation_of_disparity(sample: Sample, disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the same for a disparity image, (H, W) float32, pixels, 0: no depth."""
    deviation = disparity - sample.visible
    known = (disparity > 0) & (sample.visible > 0) & (np.abs(deviation) < 1.0)
    return np.where(known, deviation, np.float32(np.nan))


def correlation(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """Return the correlation of two images where both are known."""
    both = np.isfinite(one) & np.isfinite(other)
    if both.sum() < 1000 or one[both].std() == 0.0 or other[both].std() == 0.0:
        return float("nan")
    return float(np.corrcoef(one[both], other[both])[0, 1])


def at_same_surface(sample: Sample, values: NDArray[np.float32], pixels: float) -> NDArray[np.float32]:
    """Return the values of a moved sample at the pixels of the sample before the motion, (H, W) float32.

    Args:
        sample: sample before the motion.
        values: (H, W) float32 image after it.
        pixels: motion of the image at ``DISTANCE``.
    """
    factor = sample.imaging.config.model.focal_times_baseline(sample.settings.quality.divisor)
    shift = pixels * DISTANCE * sample.exact / factor
    rows, columns = np.mgrid[0 : values.shape[0], 0 : values.shape[1]].astype(np.float32)
    return np.asarray(cv2.remap(values, columns + shift, rows, cv2.INTER_LINEAR, borderValue=np.nan), np.float32)


def locking(sample: Sample, deviation: NDArray[np.float32]) -> tuple[float, float]:
    """Return the smallest and the largest mean error of the bins of the sub-pixel phase, pixels."""
    phase = ((sample.exact % 1.0) * PHASES).astype(np.int64)
    known = np.isfinite(deviation)
    means = [deviation[known & (phase == i)] for i in range(PHASES)]
    values = [float(mean.mean()) for mean in means if mean.size > 300]
    return (min(values), max(values)) if values else (float("nan"), float("nan"))


def confidence_gap(sample: Sample, images: DepthImages) -> float:
    """Return the share of right pixels minus the mean confidence, of pixels whose confidence is 0.5 or more."""
    known = (images.disparity > 0) & (sample.exact > 0) & (images.confidence >= 128)
    deviation = np.abs(images.disparity * DISPARITY_SCALE - sample.exact)
    right = deviation <= 3.0 * images.error * images.error_scale + 1e-6
    return float(right[known].mean() - images.confidence[known].mean() / 255.0) if known.sum() > 1000 else float("nan")


HEADER: Final = (
    "filled", "> 1 px", "rms px", "2 frames", "mean 10", "flicker", "std px", "lock min", "lock max",
    *(f"camera {shift:g}" for shift in SHIFTS), *(f"body {shift:g}" for shift in SHIFTS), "holes 1", "conf gap",
)  # fmt: skip
"""Columns: see ``row_of``."""


def row_of(camera: Camera, scene: TimeScene, measure: Measure) -> list[float]:
    """Return the figures of one scene and mode.

    Columns: share of measurable pixels with depth; share of these off by more than a pixel; root mean square of the
    other errors; correlation of two frames; rms of the mean of ten frames relative to one's; share of pixels that
    change between hole and depth from one frame to the next; mean standard deviation over time; smallest and largest
    bias by sub-pixel phase; correlation at one point of a surface before and after the camera, or the body, has moved;
    correlation of the holes before and after the camera has moved by 1 pixel; share of right pixels minus confidence.
    """
    samples = [camera.sample(scene, frame) for frame in range(FRAMES)]
    images = [measure(sample) for sample in samples]
    first, visible = samples[0], samples[0].visible > 0
    deviations = np.stack([deviation_of(s, i) for s, i in zip(samples, images, strict=True)])
    has_depth = np.stack([i.disparity > 0 for i in images])[:, visible]
    always = np.isfinite(deviations).all(axis=0)
    errors = deviations[:, always]
    known = (images[0].disparity > 0) & visible
    rms = float(np.sqrt(np.nanmean(deviations[0] ** 2)))
    moved_correlations, holes = [], float("nan")
    for body in (False, True):
        for shift in SHIFTS:
            after = camera.sample(scene, FRAMES, shift, body=body)
            after_images = measure(after)
            values = at_same_surface(first, deviation_of(after, after_images), shift)
            moved_correlations.append(correlation(deviations[0], values))
            if shift == 1.0 and not body:
                holes_after = at_same_surface(first, (after_images.disparity == 0).astype(np.float32), shift)
                both = visible & np.isfinite(holes_after)
                before = (images[0].disparity == 0)[both].astype(np.float32)
                after_mask = (holes_after[both] > 0.5).astype(np.float32)
                holes = float(np.corrcoef(before, after_mask)[0, 1]) if before.std() * after_mask.std() > 0 else np.nan
    return [
        float(known.sum() / visible.sum()),
        float(1.0 - np.isfinite(deviations[0][known]).mean()),
        rms,
        correlation(deviations[0], deviations[1]),
        float(np.sqrt((errors.mean(axis=0) ** 2).mean()) / np.sqrt((errors**2).mean())),
        float((has_depth[1:] != has_depth[:-1]).mean()),
        float(errors.std(axis=0).mean()),
        *locking(first, deviations[0]),
        *moved_correlations,
        holes,
        confidence_gap(first, images[0]),
    ]


def report_over_time(modes: dict[str, Measure], *, realism: bool) -> None:
    """Print the table, one row for each scene and mode."""
    camera = Camera(realism=realism)
    for mode, measure in modes.items():
        print(f"\n{mode}\n  {'scene':24}" + " ".join(f"{name:>10}" for name in HEADER))
        for scene in time_scenes():
            name = scene.name + (", dots" if scene.projector else "")
            print(f"  {name:24}" + " ".join(f"{value:10.3f}" for value in row_of(camera, scene, measure)), flush=True)
    print("\nmatched before its disparities are rounded: root mean square px, correlation after camera 1")
    for scene in time_scenes():
        before, after = camera.sample(scene, 0), camera.sample(scene, FRAMES, 1.0)
        one, other = (
            deviation_of_disparity(s, refined_matches(s.left, s.right, s.disparity_count, s.noise_sigma))
            for s in (before, after)
        )
        values = float(np.sqrt(np.nanmean(one**2))), correlation(one, at_same_surface(before, other, 1.0))
        name = scene.name + (", dots" if scene.projector else "")
        print(f"  {name:24}{values[0]:10.3f} {values[1]:10.3f}", flush=True)
