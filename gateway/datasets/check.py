"""Verifies a dataset: all files of its manifest exist, have their hashes and fit together."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.client import dataset, manifest
from gateway.client.manifest import CameraRecord, Failure, ImageFile, ImageType, RecordError, Sample
from gateway.datasets.files import TEMPORARY_SUFFIX, sha256_of
from gateway.datasets.scenes import digest_of
from gateway.datasets.views import MAX_ROTATION_ERROR, REQUEST

BATCH_PER_THREAD: Final = 16
"""Samples per thread that are checked at once; all of them, possibly millions, would not fit in memory."""
CACHED_SCENES: Final = 8
"""Descriptions of scenes in memory. Samples are ordered by scene, and one description may have a million paths."""


@dataclass(slots=True)
class Report:
    """Counts and findings of a check."""

    samples: int = 0
    scenes: int = 0
    images: int = 0
    nbytes: int = 0
    """Size of all images in bytes."""
    problems: list[str] = field(default_factory=list)
    """Errors, one sentence each, with the file's name."""
    notes: list[str] = field(default_factory=list)
    """Remarks that are no errors of the dataset."""


def check_dataset(folder: Path, threads: int) -> Report:
    """Check all files of a dataset. Errors are part of the report; none is raised."""
    report = Report()
    try:
        description = manifest.read_dataset(folder)
        if not (folder / manifest.MANIFEST).exists():
            report.problems.append(
                f"{manifest.MANIFEST} is missing: the run has not ended; give its command again to go on"
            )
            return report
        failed = folder / manifest.FAILED
        failures = list(manifest.read_lines(failed, Failure)) if failed.exists() else []
    except RecordError as error:
        report.problems.append(str(error))
        return report
    report.notes += [f"{f.scene}{'' if f.view is None else ', ' + f.view} was not drawn: {f.reason}" for f in failures]
    if (folder / manifest.JOURNAL).exists():
        report.notes.append(f"{manifest.JOURNAL} is there: a run is going on, or was stopped")
    try:
        _check_samples(folder, description, threads, report)
    except RecordError as error:
        report.problems.append(str(error))
    return report


def _check_samples(folder: Path, description: manifest.Dataset, threads: int, report: Report) -> None:
    """
    Raises:
        RecordError: the manifest cannot be read to its end.
    """
    ids, paths = set[int](), set[int]()  # hashes: of a million samples, the names would take 600 MB

    @lru_cache(CACHED_SCENES)
    def scene_of(name: str) -> manifest.Scene | None:
        return _read_scene(folder, name, report)

    def problems_of(sample: Sample, scene: manifest.Scene | None) -> list[str]:
        return list(_sample_problems(folder, sample, description, scene))

    samples = manifest.read_lines(folder / manifest.MANIFEST, Sample)
    with ThreadPoolExecutor(threads) as pool:
        while batch := list(islice(samples, BATCH_PER_THREAD * threads)):
            scenes = [scene_of(sample.scene) for sample in batch]
            for sample, problems in zip(batch, pool.map(problems_of, batch, scenes), strict=True):
                report.problems += [f"{sample.id}: {problem}" for problem in problems]
                if hash(sample.id) in ids:
                    report.problems.append(f"{manifest.MANIFEST}: {sample.id} is there twice")
                report.samples += 1
                report.images += len(sample.images)
                report.nbytes += sum(image.bytes for image in sample.images.values())
                ids.add(hash(sample.id))
                paths.update(hash(image.path) for image in sample.images.values())
    _note_unknown_files(folder, paths, report)


def _read_scene(folder: Path, name: str, report: Report) -> manifest.Scene | None:
    """Return the description of a scene, or None if it cannot be read; report what is wrong with it."""
    try:
        scene = manifest.read_file(folder / manifest.SCENES / name / manifest.SCENE, manifest.Scene)
    except RecordError as error:
        report.problems.append(str(error))
        return None
    if scene.scene != name:
        report.problems.append(f"{name}: its {manifest.SCENE} is that of {scene.scene}")
    if scene.sha256 != digest_of(scene.sources):
        report.problems.append(f"{name}: the hash in {manifest.SCENE} does not follow from those of its sources")
    report.scenes += 1
    return scene


def _sample_problems(
    folder: Path, sample: Sample, description: manifest.Dataset, scene: manifest.Scene | None
) -> Iterator[str]:
    """Yield the errors of one sample."""
    if sample.id != f"{sample.scene}/{sample.view}":
        yield f"the id is not that of scene {sample.scene} and view {sample.view}"
    if scene is not None and sample.scene_sha256 != scene.sha256:
        yield "it was drawn of another state of the scene than its scene.json tells"
    yield from _camera_problems(sample.camera)
    recorded = sample.view == REQUEST
    for image_type in description.settings.types:
        if image_type not in sample.images and not recorded:
            yield f"the {image_type} image is missing in the manifest"
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
    elif (np.abs(rotation.T @ rotation - np.eye(3)) >= 3 * MAX_ROTATION_ERROR).any() or np.linalg.det(rotation) < 0.0:
        yield "camera: X_world_camera is no rotation and translation"


_KINDS: Final[dict[ImageType, tuple[tuple[str, int], ...]]] = {
    "color": (("uint8", 3),),
    "depth": (("float32", 1), ("uint16", 1)),
    "label": (("uint8", 3),),
}


def _image_problem(
    folder: Path, image_type: ImageType, image: ImageFile, camera: CameraRecord, scene: manifest.Scene | None
) -> str:
    """Return the error of an image; empty if there is none."""
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
        return "not an image that can be read"
    kind = (pixels.dtype.name, 1 if pixels.ndim == 2 else pixels.shape[2])
    if kind not in _KINDS[image_type]:
        return f"a {image_type} image with {kind[1]} channels of {kind[0]}"
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


def _note_unknown_files(folder: Path, known: set[int], report: Report) -> None:
    """Note files that the manifest does not name; they are harmless.

    Args:
        known: hashes of the paths of all images.
    """
    for path, folders, files in os.walk(folder / manifest.SCENES):
        folders.sort()
        for name in sorted(files):
            relative = (Path(path) / name).relative_to(folder).as_posix()
            if name != manifest.SCENE and hash(relative) not in known:
                kind = "left by a process that was killed" if name.endswith(TEMPORARY_SUFFIX) else "not in the manifest"
                report.notes.append(f"{relative}: {kind}")
