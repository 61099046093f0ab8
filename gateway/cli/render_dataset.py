"""``scenegate render`` with a folder as output: runs a job, shows its progress and reports failures."""

import signal
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Final

import typer

from gateway.datasets.job import Job, Result
from gateway.datasets.local_tasks import run_local
from gateway.datasets.ray_tasks import run_ray
from gateway.datasets.run import RunProgress, run
from scenegate.cli.output import print_note
from scenegate.cli.progress_bar import clock_text, progress_bar
from scenegate.datasets import manifest

LOG_SECONDS: Final = 10.0
"""Minimum time between two lines of progress, if stderr is not a terminal."""


def render_dataset(job: Job, cores: int, ray: str | None) -> bool:
    """Create or complete a dataset on cores of this machine, or on the Ray cluster at an address.

    Returns True if all samples could be rendered. Raises ValueError, OSError or RuntimeError, a sentence, if it cannot
    start.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # stop like Ctrl+C
    execute = partial(run_local, cores=cores) if ray is None else partial(run_ray, address=ray)
    begin = time.monotonic()
    try:
        progress = _run_with_progress(job, execute)
    except KeyboardInterrupt:
        print_note("Stopped. The same command goes on from here.")
        raise typer.Exit(130) from None
    _print_result(job.out, progress, time.monotonic() - begin)
    return not progress.failures


def _run_with_progress(job: Job, execute: partial[Iterator[Result]]) -> RunProgress:
    """Run the job; show a progress bar on a terminal, else a line every ``LOG_SECONDS``."""
    begin = logged = time.monotonic()
    with progress_bar("Rendering", f"of {job.size} samples", job.size) as bar:

        def report(progress: RunProgress) -> None:
            nonlocal logged
            note = f"{len(progress.failures)} failed" if progress.failures else ""
            bar.update(progress.finished, progress.finished, note=note)
            if not bar.shown and time.monotonic() - logged > LOG_SECONDS:
                logged = time.monotonic()
                rate = progress.rendered / (logged - begin)
                left = f", {rate:.1f}/s, {clock_text((progress.total - progress.finished) / rate)} left" if rate else ""
                print_note(f"{progress.finished} of {progress.total} done{left} {note}")

        return run(job, execute, report)


def _print_result(out: Path, progress: RunProgress, seconds: float) -> None:
    for note in progress.notes:
        print_note(f"{out}: {note}")
    for name, warnings in sorted(progress.warnings.items()):
        for warning in warnings:
            print_note(f"{name}: {warning}")
    for failure in progress.failures:
        where = failure.scene if failure.view is None else f"{failure.scene}, {failure.view}"
        print_note(f"scenegate: {where}: {failure.reason}")
    problems = f"; {len(progress.failures)} problems, see {manifest.FAILURES_FILE}" if progress.failures else ""
    print_note(
        f"{out}: {progress.finished} of {progress.total} samples, {progress.kept} of them from before, "
        f"{progress.rendered} rendered in {seconds:.1f} s{problems}"
    )
