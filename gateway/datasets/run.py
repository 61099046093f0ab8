"""A whole run: what is left to do is done, noted as it comes, and put in order at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

from gateway.client import manifest
from gateway.client.manifest import Failure
from gateway.datasets.files import alone, part_of, remove_parts, write_whole
from gateway.datasets.plan import Order, Result, Task, check_folder, description, tasks_of
from gateway.datasets.progress import Ledger, Plan
from gateway.datasets.resume import check_samples, good_samples
from gateway.runtime import kernel_cache
from gateway.runtime.worker_pool import usable_cpus

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
    renderer = kernel_cache.sources_digest()
    wanted = description(order.settings, renderer)
    found = check_folder(order, wanted)
    plan = Plan(order)
    if found is None:
        write_whole(out / manifest.DATASET, manifest.encode_for_people(wanted))
    else:
        check_samples(order, plan)
    with part_of(out / manifest.JOURNAL) as part, part.open("w+b") as journal:
        ledger = Ledger(plan, journal)
        if found is not None and found.renderer == renderer:  # another version draws all again
            for sample in good_samples(order, plan, usable_cpus()):
                ledger.add(sample)
        ledger.flush()
        # From here on the journal says what is there; without it the next run would believe an old manifest.
        part.replace(out / manifest.JOURNAL)
        for name in (manifest.MANIFEST, manifest.FAILED):
            (out / name).unlink(missing_ok=True)
        write_whole(out / manifest.DATASET, manifest.encode_for_people(wanted))
        refused = (Failure(source.shown, None, source.problem) for source in order.sources if source.problem)
        progress = Progress(plan.size, kept=ledger.count, failures=dict.fromkeys(refused))
        report(progress)
        for result in execute(tasks_of(order, ledger.has, renderer)):
            for sample in result.samples:
                ledger.add(sample)
            ledger.flush()
            progress.drawn += len(result.samples)
            progress.failures.update(dict.fromkeys(result.failures))
            if result.warnings and result.samples:
                progress.warnings[result.samples[0].scene] = result.warnings
            report(progress)
        _finish(order, ledger, progress.failures)
    return progress


def _finish(order: Order, ledger: Ledger, failures: Iterable[Failure]) -> None:
    out = order.out
    remove_parts(out)
    for source in order.sources:
        folder = out / manifest.SCENES / source.name
        if not source.problem and folder.is_dir():
            remove_parts(folder)
    if failed := sorted(failures, key=lambda failure: (failure.scene, failure.view or "")):
        write_whole(out / manifest.FAILED, (manifest.encode(failure) + b"\n" for failure in failed))
    write_whole(out / manifest.MANIFEST, ledger.lines())
    (out / manifest.JOURNAL).unlink()
