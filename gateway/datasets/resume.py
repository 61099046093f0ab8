"""Read the dataset of an earlier run, and find the samples that need not be rendered again. ``run`` uses it."""

import io
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from itertools import compress, islice
from pathlib import Path
from typing import Final

from gateway.datasets.errors import DatasetError
from gateway.datasets.job import Job
from gateway.datasets.scene_sources import Source
from gateway.datasets.scenes import scene_digest
from renderers.stop import StopFlag, check_stop
from scenegate.datasets import manifest
from scenegate.datasets.manifest import RecordError, SampleRecord, Settings, SourceFile
from scenegate.regular_files import open_regular, sha256_of

_CHANGES: Final = {
    "scenario_sha256": "the scenario has changed, or the names of its files",
    "classes_sha256": "the file of classes has changed",
}
"""Descriptions of changes, by the setting whose digest differs."""
BATCH_SAMPLES: Final = 1000
"""Number of samples whose images are hashed at a time. A dataset may have millions, which do not fit in memory."""


def existing_dataset(job: Job) -> manifest.DatasetRecord | None:
    """Return the description of the dataset in the job's folder, or None if the folder is empty or missing.

    Raises DatasetError if it has other files, other settings or samples that the job does not have; or RecordError.
    """
    out = job.out
    if not (out / manifest.DATASET_FILE).exists():
        if out.is_dir() and any(out.iterdir()):
            raise DatasetError(f"{out} is not empty and holds no dataset")
        return None
    dataset = manifest.read_dataset(out)
    for name in Settings.__struct_fields__:
        old, new = getattr(dataset.settings, name), getattr(job.settings, name)
        if old != new:
            change = f": {_CHANGES[name]}" if old and new and name in _CHANGES else f" ({name}: {old} there, {new} now)"
            raise DatasetError(f"{out} holds a dataset with other settings{change}; name another folder")
    if dataset.classes != job.classes.names:
        raise DatasetError(
            f"{out} holds a dataset with other classes ({len(dataset.classes)} there, {len(job.classes.names)} now); "
            "name another folder, or give it a file of classes"
        )
    if unknown := [sample.id for sample in _recorded_samples(job) if job.find(sample.id) is None]:
        raise DatasetError(
            f"{out} holds {len(unknown)} samples of scenes or views that this command does not name "
            f"({min(unknown)}); name another folder"
        )
    return dataset


def valid_samples(job: Job, threads: int = 1) -> Iterator[SampleRecord]:
    """Yield the samples whose scene, view and images have not changed. Threads read and hash the images."""

    current_digest = cache(partial(_current_digest, job))

    def has_same_input(sample: SampleRecord) -> bool:
        planned = job.find(sample.id)
        assert planned is not None
        is_same_view = sample.view_description == planned.description
        return is_same_view and sample.scene_sha256 == current_digest(planned.source)

    stop = StopFlag()

    def has_same_files(sample: SampleRecord) -> bool:
        return stop.run(
            lambda: all(sha256_of(job.out / image.path, check_stop) == image.sha256 for image in sample.images.values())
        )

    candidates = filter(has_same_input, _recorded_samples(job))
    with ThreadPoolExecutor(threads) as pool:
        try:
            while batch := list(islice(candidates, BATCH_SAMPLES)):
                yield from compress(batch, pool.map(has_same_files, batch))
        finally:  # after Ctrl+C or SIGTERM, too: the pool waits for its threads
            stop.set(InterruptedError("the run is stopped"))
            pool.shutdown(cancel_futures=True)


def ends_in_partial_line(path: Path) -> bool:
    """Return True if the last line of a file is cut off, as by a full disk or a copy that was stopped."""
    try:
        with open_regular(path) as file:
            file.seek(max(0, file.seek(0, io.SEEK_END) - 1))
            return file.read(1) not in (b"", b"\n")
    except OSError:
        return False


def _recorded_samples(job: Job) -> Iterator[SampleRecord]:
    """Yield the samples in the manifest, then those in the journal. A sample may be in both."""
    for name in (manifest.MANIFEST_FILE, manifest.JOURNAL_FILE):
        if (job.out / name).exists():
            yield from manifest.read_lines(job.out / name, SampleRecord, allow_partial_end=True)


def _current_digest(job: Job, source: Source) -> str | None:
    """Return the digest that the scene has now, or None if its ``scene.json`` or a model cannot be read."""
    try:
        description = manifest.read_file(
            job.out / manifest.SCENES_FOLDER / source.name / manifest.SCENE_FILE, manifest.SceneRecord
        )
    except RecordError:
        return None
    if any(sha256_of(job.out / model.path, check_stop) != model.sha256 for model in description.models.values()):
        return None
    folder = Path(source.path).parent
    return scene_digest(
        tuple(SourceFile(file.path, sha256_of(folder / file.path, check_stop) or "") for file in description.sources)
    )
