"""What earlier runs left in the folder of a dataset, and how much of it is still good."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from pathlib import Path
from typing import Final

from gateway.client import manifest
from gateway.client.manifest import RecordError, Sample, SourceFile
from gateway.datasets.files import sha256_of
from gateway.datasets.plan import Order, PlanError
from gateway.datasets.progress import Plan
from gateway.datasets.scenes import digest_of
from gateway.datasets.sources import Source

HASHED_AT_ONCE: Final = 1000
"""Samples handed to the hashing threads: there may be millions."""


def check_samples(order: Order, plan: Plan) -> None:
    """
    Raises:
        PlanError: there are samples that nobody asks for now, or a line that is no sample.
    """
    count, first = 0, ""
    for sample in _samples(order.out):
        if plan.find(sample.id) is None:
            count += 1
            first = min(first or sample.id, sample.id)
    if count:
        raise PlanError(
            f"{order.out} holds {count} pictures of scenes or views that this command does not name "
            f"({first}); name another folder"
        )


def good_samples(order: Order, plan: Plan, threads: int = 1) -> Iterator[Sample]:
    """Those that need not be drawn again: same scene, same view, files as they were written.

    ``threads``: that read and hash the pictures.
    """
    digests: dict[str, str | None] = {}

    def is_same(sample: Sample) -> bool:
        planned = plan.find(sample.id)
        assert planned is not None
        source = planned.source
        if source.name not in digests:
            digests[source.name] = _scene_digest(order.out, source)
        return sample.asked == planned.view.asked and sample.scene_sha256 == digests[source.name]

    def is_whole(sample: Sample) -> bool:
        return all(sha256_of(order.out / image.path) == image.sha256 for image in sample.images.values())

    same = filter(is_same, _samples(order.out))
    with ThreadPoolExecutor(threads) as pool:
        while part := list(islice(same, HASHED_AT_ONCE)):
            yield from (sample for sample, whole in zip(part, pool.map(is_whole, part), strict=True) if whole)


def _samples(out: Path) -> Iterator[Sample]:
    """All that the folder tells of; what is in the journal and in the manifest comes twice."""
    try:
        for name in (manifest.MANIFEST, manifest.JOURNAL):
            if (out / name).exists():
                yield from manifest.read_lines(out / name, Sample, torn_end=name == manifest.JOURNAL)
    except RecordError as error:
        raise PlanError(str(error)) from None


def _scene_digest(out: Path, source: Source) -> str | None:
    """The hash that the scene would have now, of the files that it was read from; None when one is missing."""
    try:
        known = manifest.read_file(out / manifest.SCENES / source.name / manifest.SCENE, manifest.Scene)
    except RecordError:
        return None
    folder = Path(source.path).parent
    now = tuple(SourceFile(file.path, sha256_of(folder / file.path) or "") for file in known.sources)
    return digest_of(now)
