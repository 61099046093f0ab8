"""Check a dataset: its files exist, have the recorded hashes, and can be read."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Final

from gateway.datasets.files import TEMPORARY_SUFFIX
from gateway.datasets.scenes import scene_digest
from gateway.datasets.views import REQUEST_VIEW_NAME
from renderers.stop import check_stop
from scenegate.datasets import Sample, manifest
from scenegate.datasets.manifest import FailureRecord, ImageFile, RecordError, SampleRecord
from scenegate.regular_files import open_regular, sha256_of

BATCH_SAMPLES_PER_THREAD: Final = 16
"""Number of samples that are checked at a time, per thread. A dataset may have millions, which do not fit in memory."""
CACHED_SCENES: Final = 8
"""Number of scene descriptions in memory. Few are needed, because samples are ordered by scene. One may have a million
paths."""
CACHED_MODELS: Final = 10_000
"""Number of models whose hashes are in memory. Scenes share models."""


@dataclass(slots=True)
class Report:
    """Result of a check."""

    samples: int = 0
    """Number of samples."""
    scenes: int = 0
    """Number of scenes."""
    images: int = 0
    """Number of images."""
    image_bytes: int = 0
    """Bytes of all images."""
    problems: list[str] = field(default_factory=list)
    """Errors, one sentence each, with the name of the file or sample."""
    notes: list[str] = field(default_factory=list)
    """Remarks about what is not an error of the dataset, such as files that the manifest does not name."""


def check_dataset(folder: Path, threads: int, show: Callable[[int, int], object] = lambda done, total: None) -> Report:
    """Check all files of a dataset. Errors are not raised, but are in the report.

    ``show`` is called now and then with the numbers of checked and of all samples.
    """
    report = Report()
    try:
        description = manifest.read_dataset(folder)
        if not (folder / manifest.MANIFEST_FILE).exists():
            report.problems.append(
                f"{manifest.MANIFEST_FILE} is missing: the run has not ended; give its command again to go on"
            )
            return report
        failures_file = folder / manifest.FAILURES_FILE
        failures = list(manifest.read_lines(failures_file, FailureRecord)) if failures_file.exists() else []
    except RecordError as error:
        report.problems.append(str(error))
        return report
    for failure in failures:
        view = "" if failure.view is None else f", {failure.view}"
        report.notes.append(f"{failure.scene}{view} was not drawn: {failure.reason}")
    if (folder / manifest.JOURNAL_FILE).exists():
        report.notes.append(f"{manifest.JOURNAL_FILE} is there: a run is going on, or was stopped")
    try:
        _check_samples(folder, description, threads, report, show)
    except RecordError as error:
        report.problems.append(str(error))
    return report


def _count_lines(path: Path) -> int:
    with open_regular(path) as file:
        return sum(block.count(b"\n") for block in iter(lambda: file.read(1 << 20), b""))


def _check_samples(
    folder: Path, description: manifest.DatasetRecord, threads: int, report: Report, show: Callable[[int, int], object]
) -> None:
    """Check the samples of the manifest. Raises RecordError if a line cannot be read."""
    # Hashes instead of texts: the names of a million samples would take 600 MB.
    id_hashes, path_hashes = set[int](), set[int]()

    @lru_cache(CACHED_SCENES)
    def cached_scene(name: str) -> manifest.SceneRecord | None:
        return _read_scene(folder, name, model_digest, report)

    @lru_cache(CACHED_MODELS)
    def model_digest(path: str) -> str | None:
        try:
            return sha256_of(manifest.path_inside(folder, path), check_stop)
        except RecordError:
            return None

    def problems_of(sample: SampleRecord, scene: manifest.SceneRecord | None) -> list[str]:
        return list(_sample_problems(folder, sample, description, scene))

    total = _count_lines(folder / manifest.MANIFEST_FILE)
    samples = manifest.read_lines(folder / manifest.MANIFEST_FILE, SampleRecord)
    with ThreadPoolExecutor(threads) as pool:
        while batch := list(islice(samples, BATCH_SAMPLES_PER_THREAD * threads)):
            show(report.samples, total)
            scenes = [cached_scene(sample.scene) for sample in batch]
            for sample, problems in zip(batch, pool.map(problems_of, batch, scenes), strict=True):
                report.problems += [f"{sample.id}: {problem}" for problem in problems]
                if hash(sample.id) in id_hashes:
                    report.problems.append(f"{manifest.MANIFEST_FILE}: {sample.id} is there twice")
                report.samples += 1
                report.images += len(sample.images)
                report.image_bytes += sum(image.bytes for image in sample.images.values())
                id_hashes.add(hash(sample.id))
                path_hashes.update(hash(image.path) for image in sample.images.values())
    if not report.samples:
        report.problems.append(f"{manifest.MANIFEST_FILE} has no samples")
    _note_unknown_files(folder, path_hashes, report)


def _sample_problems(
    folder: Path, sample: SampleRecord, description: manifest.DatasetRecord, scene: manifest.SceneRecord | None
) -> Iterator[str]:
    """Yield the errors of a sample and its images."""
    if sample.id != f"{sample.scene}/{sample.view}":
        yield f"the id is not that of scene {sample.scene} and view {sample.view}"
    if scene is not None and sample.scene_sha256 != scene.sha256:
        yield "it was drawn of another state of the scene than its scene.json tells"
    is_request = sample.view == REQUEST_VIEW_NAME
    for image_type in description.settings.types:
        if image_type not in sample.images and not is_request and image_type != "flow":  # the last view has none
            yield f"the {image_type} image is missing in the manifest"
    reader = Sample(folder, sample)
    for image_type, image in sample.images.items():
        try:
            _check_file(folder, image)
            read = reader.image if image_type in ("amodal", "flow") else reader.stored
            read(image_type)
        except RecordError as error:
            yield f"{image.path}: {str(error).removeprefix(f'{folder / image.path}: ')}"


def _check_file(folder: Path, image: ImageFile) -> None:
    """Raise RecordError if an image file is not that of the manifest."""
    path = manifest.path_inside(folder, image.path)
    digest = sha256_of(path, check_stop)
    if digest is None:
        raise RecordError("missing, or not a regular file that can be read")
    if digest != image.sha256:
        size = path.stat().st_size
        raise RecordError(f"changed: its SHA-256 is not that of the manifest ({size} bytes, {image.bytes} there)")


def _read_scene(
    folder: Path, name: str, model_digest: Callable[[str], str | None], report: Report
) -> manifest.SceneRecord | None:
    """Return the description of a scene, or None if it cannot be read. Add its errors to the report.

    ``model_digest`` returns the SHA-256 of the file of a model; None if there is none.
    """
    try:
        scene = manifest.read_scene(folder, name)
    except RecordError as error:
        report.problems.append(str(error))
        return None
    if scene.scene != name:
        report.problems.append(f"{name}: its {manifest.SCENE_FILE} is that of {scene.scene}")
    if scene.sha256 != scene_digest(scene.sources):
        report.problems.append(f"{name}: the hash in {manifest.SCENE_FILE} does not follow from those of its sources")
    for model in dict.fromkeys(scene.models.values()):
        if model_digest(model.path) != model.sha256:
            report.problems.append(
                f"{name}: {model.path}: missing, or its SHA-256 is not that of {manifest.SCENE_FILE}"
            )
    report.scenes += 1
    return scene


def _note_unknown_files(folder: Path, path_hashes: set[int], report: Report) -> None:
    """Add a note for each file in the folders of scenes whose path is not among the hashes of those of the manifest."""
    for path, folders, files in os.walk(folder / manifest.SCENES_FOLDER):
        folders.sort()
        for name in sorted(files):
            relative = (Path(path) / name).relative_to(folder).as_posix()
            if name != manifest.SCENE_FILE and hash(relative) not in path_hashes:
                is_temporary = name.endswith(TEMPORARY_SUFFIX)
                reason = "left by a process that was killed" if is_temporary else "not in the manifest"
                report.notes.append(f"{relative}: {reason}")
