"""Verifies a dataset: everything that its manifest promises is there, whole and consistent."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.batch.files import PART, sha256_of
from gateway.batch.scenes import digest_of
from gateway.batch.views import RIGID
from gateway.client import dataset, manifest
from gateway.client.manifest import CameraRecord, Failure, ImageFile, ImageType, RecordError, Sample

WAITING: Final = 4
"""Samples per thread that are handed out: their number is not bounded, memory is."""


@dataclass(slots=True)
class Report:
    """What was looked at, and what is wrong."""

    samples: int = 0
    scenes: int = 0
    images: int = 0
    nbytes: int = 0
    """Of the images."""
    problems: list[str] = field(default_factory=list)
    """A sentence each, with the file's name."""
    notes: list[str] = field(default_factory=list)
    """What is no fault of the dataset but worth knowing."""


def check_dataset(folder: Path, threads: int) -> Report:
    """Looks at everything; never raises for what it finds."""
    report = Report()
    try:
        description = manifest.read_dataset(folder)
        if not (folder / manifest.MANIFEST).exists():
            report.problems.append(
                f"{manifest.MANIFEST} is missing: the run has not ended; give its command again to go on"
            )
            return report
        samples = manifest.read_lines(folder / manifest.MANIFEST, Sample)
        failed = folder / manifest.FAILED
        failures = manifest.read_lines(failed, Failure) if failed.exists() else []
    except RecordError as error:
        report.problems.append(str(error))
        return report
    report.notes += [f"{f.scene}{'' if f.view is None else ', ' + f.view} was not drawn: {f.reason}" for f in failures]
    if (folder / manifest.JOURNAL).exists():
        report.notes.append(f"{manifest.JOURNAL} is there: a run is going on, or was stopped")
    report.samples = len(samples)
    seen: set[str] = set()
    for sample in samples:
        if sample.id in seen:
            report.problems.append(f"{manifest.MANIFEST}: {sample.id} is there twice")
        seen.add(sample.id)
    scenes = _check_scenes(folder, samples, report)

    def problems_of(sample: Sample) -> list[str]:
        return list(_problems(folder, sample, description, scenes.get(sample.scene)))

    with ThreadPoolExecutor(threads) as pool:
        step = WAITING * threads
        for start in range(0, len(samples), step):
            part = samples[start : start + step]
            for sample, problems in zip(part, pool.map(problems_of, part), strict=True):
                report.problems += [f"{sample.id}: {problem}" for problem in problems]
                report.images += len(sample.images)
                report.nbytes += sum(image.bytes for image in sample.images.values())
    _check_strangers(folder, samples, report)
    return report


def _check_scenes(folder: Path, samples: list[Sample], report: Report) -> dict[str, manifest.Scene]:
    found: dict[str, manifest.Scene] = {}
    for name in dict.fromkeys(sample.scene for sample in samples):
        try:
            scene = manifest.read_file(folder / manifest.SCENES / name / manifest.SCENE, manifest.Scene)
        except RecordError as error:
            report.problems.append(str(error))
            continue
        if scene.scene != name:
            report.problems.append(f"{name}: its {manifest.SCENE} is that of {scene.scene}")
        if scene.sha256 != digest_of(scene.sources):
            report.problems.append(f"{name}: the hash in {manifest.SCENE} does not follow from those of its sources")
        found[name] = scene
    report.scenes = len(found)
    return found


def _problems(
    folder: Path, sample: Sample, description: manifest.Dataset, scene: manifest.Scene | None
) -> Iterator[str]:
    """What is wrong with one sample."""
    if sample.id != f"{sample.scene}/{sample.view}":
        yield f"the id is not that of scene {sample.scene} and view {sample.view}"
    if scene is not None and sample.scene_sha256 != scene.sha256:
        yield "it was drawn of another state of the scene than its scene.json tells"
    yield from _camera_problems(sample.camera)
    recorded = sample.view == "request"
    for image_type in description.settings.types:
        if image_type not in sample.images and not recorded:
            yield f"the {image_type} picture is missing in the manifest"
    for image_type, image in sample.images.items():
        problem = _image_problem(folder, image_type, image, sample.camera, scene)
        if problem:
            yield f"{image.path}: {problem}"


def _camera_problems(camera: CameraRecord) -> Iterator[str]:
    if camera.width < 1 or camera.height < 1:
        yield f"camera: size {camera.width}x{camera.height}"
    if not (camera.fx > 0.0 and camera.fy > 0.0):
        yield f"camera: focal lengths ({camera.fx}, {camera.fy}) are not positive"
    if not camera.near > 0.0 or (camera.far is not None and not camera.near < camera.far):
        yield f"camera: planes near={camera.near}, far={camera.far}"
    pose = np.array(camera.X_world_camera)
    rotation = pose[:3, :3]
    if not np.isfinite(pose).all() or pose[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        yield "camera: X_world_camera has no last row 0, 0, 0, 1, or is not finite"
    elif not (np.abs(rotation.T @ rotation - np.eye(3)) < 3 * RIGID).all() or np.linalg.det(rotation) < 0.0:
        yield "camera: X_world_camera is no rotation and translation"


_KINDS: Final[dict[ImageType, tuple[tuple[str, int], ...]]] = {
    "color": (("uint8", 3),),
    "depth": (("float32", 1), ("uint16", 1)),
    "label": (("uint8", 3),),
}


def _image_problem(
    folder: Path, image_type: ImageType, image: ImageFile, camera: CameraRecord, scene: manifest.Scene | None
) -> str:
    """What is wrong with a picture; empty: nothing."""
    path = folder / image.path
    if PurePosixPath(image.path).is_absolute() or ".." in PurePosixPath(image.path).parts:
        return "lies outside of the dataset"
    digest = sha256_of(path)
    if digest is None:
        return "missing"
    if digest != image.sha256:
        size = path.stat().st_size
        return f"changed: its SHA-256 is not that of the manifest ({size} bytes, {image.bytes} there)"
    pixels: NDArray[Any] | None = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        return "no picture that can be read"
    kind = (pixels.dtype.name, 1 if pixels.ndim == 2 else pixels.shape[2])
    if kind not in _KINDS[image_type]:
        return f"a {image_type} picture with {kind[1]} channels of {kind[0]}"
    if pixels.shape[:2] != (camera.height, camera.width):
        return f"{pixels.shape[1]}x{pixels.shape[0]} pixels, the camera has {camera.width}x{camera.height}"
    if image_type == "depth" and kind[0] == "float32" and (np.isnan(pixels).any() or (pixels < 0.0).any()):
        return "depth that is negative or not a number"
    if image_type == "label" and scene is not None and scene.labels:
        wide = pixels.astype(np.uint32)
        seen = np.unique(wide[..., 2] | wide[..., 1] << 8 | wide[..., 0] << 16)
        unknown = [label for label in seen.tolist() if label != dataset.NO_LABEL and str(label) not in scene.labels]
        if unknown:
            return f"labels that {manifest.SCENE} does not know: {', '.join(map(str, unknown[:5]))}"
    return ""


def _check_strangers(folder: Path, samples: list[Sample], report: Report) -> None:
    """Files that nobody speaks of: harmless, but a sign of something else writing there."""
    known = {image.path for sample in samples for image in sample.images.values()}
    for path in sorted((folder / manifest.SCENES).rglob("*")):
        relative = path.relative_to(folder).as_posix()
        if path.is_file() and relative not in known and path.name != manifest.SCENE:
            kind = "left by a process that was killed" if path.suffix == PART else "not in the manifest"
            report.notes.append(f"{relative}: {kind}")
