"""A whole run: what is left to do is done, noted as it comes, and put in order at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

from gateway.batch.files import alone, remove_parts, write_whole
from gateway.batch.plan import Order, Result, Task, check_folder, description, done_of, tasks_of
from gateway.client import manifest
from gateway.client.manifest import Failure, Sample
from gateway.ops import kernels
from gateway.workers import usable_cpus

Execute = Callable[[list[Task]], Iterator[Result]]


@dataclass(slots=True)
class Progress:
    """How far a run is."""

    total: int
    """Samples of the dataset."""
    kept: int = 0
    """Samples that were there already."""
    drawn: int = 0
    failures: dict[Failure, None] = field(default_factory=dict)
    """In the order in which they came; a scene that cannot be read fails once, however many views it has."""
    warnings: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """By scene."""

    @property
    def finished(self) -> int:
        return self.kept + self.drawn


def run(order: Order, execute: Execute, report: Callable[[Progress], None]) -> Progress:
    """Makes the dataset.

    Args:
        execute: gives the results of tasks, in any order.
        report: called whenever something is finished.

    Raises:
        PlanError: the folder holds something else.
        InUseError: another run works on it.
        OSError: it cannot be written.
    """
    order.out.mkdir(parents=True, exist_ok=True)
    with alone(order.out):
        return _run(order, execute, report)


def _run(order: Order, execute: Execute, report: Callable[[Progress], None]) -> Progress:
    out = order.out
    renderer = kernels.sources_digest()
    wanted = description(order.settings, renderer)
    samples = {sample.id: sample for sample in done_of(order, check_folder(order, wanted), usable_cpus())}
    progress = Progress(order.size, kept=len(samples))
    write_whole(out / manifest.DATASET, manifest.encode_for_people(wanted))
    # From here on the journal says what is there; without it the next run would believe an old manifest.
    write_whole(out / manifest.JOURNAL, _lines(samples.values()))
    for name in (manifest.MANIFEST, manifest.FAILED):
        (out / name).unlink(missing_ok=True)
    report(progress)
    with (out / manifest.JOURNAL).open("ab") as journal:
        for result in execute(tasks_of(order, set(samples), renderer)):
            for sample in result.samples:
                samples[sample.id] = sample
                journal.write(manifest.encode(sample) + b"\n")
            journal.flush()
            progress.drawn += len(result.samples)
            progress.failures.update(dict.fromkeys(result.failures))
            if result.warnings and result.samples:
                progress.warnings[result.samples[0].scene] = result.warnings
            report(progress)
    _finish(order, samples, progress.failures)
    return progress


def _finish(order: Order, samples: dict[str, Sample], failures: Iterable[Failure]) -> None:
    out = order.out
    for source in order.sources:
        folder = out / manifest.SCENES / source.name
        if folder.is_dir():
            remove_parts(folder)
    if failed := sorted(failures, key=lambda failure: (failure.scene, failure.view or "")):
        write_whole(out / manifest.FAILED, _lines(failed))
    planned = (f"{source.name}/{view.name}" for source in order.sources for view in order.views_of(source))
    write_whole(out / manifest.MANIFEST, _lines(samples[name] for name in planned if name in samples))
    (out / manifest.JOURNAL).unlink()


def _lines(records: Iterable[Sample | Failure]) -> bytes:
    return b"".join(manifest.encode(record) + b"\n" for record in records)
