"""Finds the samples of a former run and checks which of them are still valid."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import Final

from gateway.client import manifest
from gateway.client.manifest import RecordError, Sample, Settings, SourceFile
from gateway.datasets.files import sha256_of
from gateway.datasets.job import Job, JobError
from gateway.datasets.scenes import digest_of
from gateway.datasets.sources import Source

BATCH: Final = 1000
"""Samples that are hashed at once; all of them, possibly millions, would not fit in memory."""


def existing_dataset(job: Job) -> manifest.Dataset | None:
    """Return the description of the dataset in the job's folder, or None if the folder is empty or missing.

    Raises:
        JobError: the folder holds something else, other settings, or samples that are not part of the job. None of them
            may be overwritten.
    """
    out = job.out
    if not (out / manifest.DATASET).exists():
        if out.is_dir() and any(out.iterdir()):
            raise JobError(f"{out} is not empty and holds no dataset")
        return None
    try:
        found = manifest.read_dataset(out)
    except RecordError as error:
        raise JobError(str(error)) from None
    for name in Settings.__struct_fields__:
        there, here = getattr(found.settings, name), getattr(job.settings, name)
        if there != here:
            raise JobError(
                f"{out} holds a dataset with other settings ({name}: {there} there, {here} now); name another folder"
            )
    unknown, first = 0, ""
    for sample in _samples(job):
        if job.find(sample.id) is None:
            unknown += 1
            first = min(first or sample.id, sample.id)
    if unknown:
        raise JobError(
            f"{out} holds {unknown} samples of scenes or views that this command does not name "
            f"({first}); name another folder"
        )
    return found


def valid_samples(job: Job, threads: int = 1) -> Iterator[Sample]:
    """Iterate over the samples whose scene, view and files have not changed.

    Args:
        threads: number of threads that read and hash the images.
    """

    scene_digest = cache(partial(_scene_digest, job))

    def same_input(sample: Sample) -> bool:
        planned = job.find(sample.id)
        assert planned is not None
        return sample.asked == planned.view.description and sample.scene_sha256 == scene_digest(planned.source)

    def same_files(sample: Sample) -> bool:
        return all(sha256_of(job.out / image.path) == image.sha256 for image in sample.images.values())

    candidates = filter(same_input, _samples(job))
    with ThreadPoolExecutor(threads) as pool:
        while batch := list(islice(candidates, BATCH)):
            yield from (sample for sample, same in zip(batch, pool.map(same_files, batch), strict=True) if same)


def _samples(job: Job) -> Iterator[Sample]:
    """Iterate over the samples in the manifest and in the journal; one that is in both comes twice."""
    try:
        for name in (manifest.MANIFEST, manifest.JOURNAL):
            if (job.out / name).exists():
                yield from manifest.read_lines(job.out / name, Sample, allow_partial_end=name == manifest.JOURNAL)
    except RecordError as error:
        raise JobError(str(error)) from None


def _scene_digest(job: Job, source: Source) -> str | None:
    """Return the digest of the scene's files as they are now; None if its description is missing."""
    try:
        known = manifest.read_file(job.out / manifest.SCENES / source.name / manifest.SCENE, manifest.Scene)
    except RecordError:
        return None
    folder = Path(source.path).parent
    return digest_of(tuple(SourceFile(file.path, sha256_of(folder / file.path) or "") for file in known.sources))
