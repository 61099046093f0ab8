"""Verifies a dataset: everything that its manifest promises is there, whole and consistent."""

from __future__ import annotations

import hashlib
import os
from array import array
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
from gateway.datasets.files import PART, sha256_of
from gateway.datasets.scenes import digest_of
from gateway.datasets.views import RIGID

WAITING: Final = 16
"""Samples per thread that are handed out: their number is not bounded, memory is."""
KEPT_SCENES: Final = 8
"""Descriptions of scenes in memory: samples come scene by scene, and one may describe a million paths."""


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
    ids, paths, checked = _Names(), _Names(), set[str]()

    @lru_cache(maxsize=KEPT_SCENES)
    def scene_of(name: str) -> manifest.Scene | None:
        problems: list[str] = []
        scene = _scene(folder, name, problems)
        if name not in checked:  # the samples of a scene need not come one after the other
            report.problems.extend(problems)
            report.scenes += scene is not None
            checked.add(name)
        return scene

    def problems_of(sample: Sample, scene: manifest.Scene | None) -> list[str]:
        return list(_problems(folder, sample, description, scene))

    samples = manifest.read_lines(folder / manifest.MANIFEST, Sample)
    with ThreadPoolExecutor(threads) as pool:
        while part := list(islice(samples, WAITING * threads)):
            scenes = [scene_of(sample.scene) for sample in part]
            for sample, problems in zip(part, pool.map(problems_of, part, scenes), strict=True):
                report.problems += [f"{sample.id}: {problem}" for problem in problems]
                report.samples += 1
                report.images += len(sample.images)
                report.nbytes += sum(image.bytes for image in sample.images.values())
                ids.add(sample.id)
                for image in sample.images.values():
                    paths.add(image.path)
    if twice := ids.twice():
        again = (sample.id for sample in manifest.read_lines(folder / manifest.MANIFEST, Sample))
        names = dict.fromkeys(name for name in again if _Names.hashed(name) in twice)
        report.problems += [f"{manifest.MANIFEST}: {name} is there twice" for name in names]
    _check_strangers(folder, paths, report)


class _Names:
    """Which names there were, 8 bytes each: of a million, two have the same hash once in 30 million datasets."""

    def __init__(self) -> None:
        self._hashes = array("Q")
        self._sorted: NDArray[np.uint64] | None = None

    @staticmethod
    def hashed(name: str) -> int:
        return int.from_bytes(hashlib.blake2b(name.encode("utf-8", "replace"), digest_size=8).digest(), "little")

    def add(self, name: str) -> None:
        self._hashes.append(self.hashed(name))

    def twice(self) -> set[int]:
        """Hashes of the names that were added more than once."""
        values = np.sort(np.array(self._hashes, np.uint64))
        return set(values[1:][values[1:] == values[:-1]].tolist())

    def __contains__(self, name: str) -> bool:
        if self._sorted is None:
            self._sorted = np.sort(np.array(self._hashes, np.uint64))
        value = np.uint64(self.hashed(name))
        place = int(np.searchsorted(self._sorted, value))
        return place < len(self._sorted) and bool(self._sorted[place] == value)


def _scene(folder: Path, name: str, problems: list[str]) -> manifest.Scene | None:
    """The description of a scene; what is wrong with it is added to the problems."""
    try:
        scene = manifest.read_file(folder / manifest.SCENES / name / manifest.SCENE, manifest.Scene)
    except RecordError as error:
        problems.append(str(error))
        return None
    if scene.scene != name:
        problems.append(f"{name}: its {manifest.SCENE} is that of {scene.scene}")
    if scene.sha256 != digest_of(scene.sources):
        problems.append(f"{name}: the hash in {manifest.SCENE} does not follow from those of its sources")
    return scene


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


def _check_strangers(folder: Path, known: _Names, report: Report) -> None:
    """Files that nobody speaks of: harmless, but a sign of something else writing there."""
    for path, folders, files in os.walk(folder / manifest.SCENES):
        folders.sort()
        for name in sorted(files):
            relative = (Path(path) / name).relative_to(folder).as_posix()
            if name != manifest.SCENE and relative not in known:
                kind = "left by a process that was killed" if name.endswith(PART) else "not in the manifest"
                report.notes.append(f"{relative}: {kind}")
