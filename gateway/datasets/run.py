"""Run a job: render the samples that a dataset lacks, and write its manifest. The next run continues a stopped one."""

import shutil
from array import array
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import BinaryIO, Final

from gateway import __version__
from gateway.datasets.errors import DatasetError
from gateway.datasets.files import locked, remove_temporary_files, temporary_name, write_atomically
from gateway.datasets.job import Job, RenderTask, Result
from gateway.datasets.resume import ends_in_partial_line, existing_dataset, valid_samples
from gateway.runtime.workers.scheduling import usable_cpus
from renderers.compiler import cache_folder
from scenegate.datasets import manifest
from scenegate.datasets.manifest import FailureRecord, SampleRecord

TaskRunner = Callable[[list[RenderTask]], Iterator[Result]]
"""Function that runs tasks in worker processes, and yields their results in any order."""

_ABSENT: Final = -1
"""Offset of a sample that is not in the journal."""
CONVENTIONS: Final = {
    "units": "metres, pixels; the world is right-handed and Z up",
    "X_world_camera": "4 x 4, row-major: pose of the optical frame (+X right, +Y down, +Z forward) in the world",
    "pixel": "column i, row j, (0, 0) is top left; its ray is ((i + 0.5 - cx) / fx, (j + 0.5 - cy) / fy, 1)",
    "color": "8-bit RGB, sRGB",
    "depth": "along the optical axis; tiff: float32 metres, inf is nothing; png: uint16 millimetres, 65535 is nothing",
    "label": "8-bit RGB: label = red + 256 green + 65536 blue; white is no label; scene.json says what they mean",
    "instance": "16-bit grey: instance of an object in the manifest; 0 is none",
    "class": "16-bit grey: class_id of an object, named in classes; 0 is none",
    "normal": "8-bit RGB: 128 + 127 x, y, z of the unit normal in the optical frame; 128, 128, 128 is nothing",
    "albedo": "8-bit RGB, sRGB: base colour without light; black is nothing",
    "amodal": "JSON: list of instance, size, counts: each object's silhouette as COCO's uncompressed RLE",
    "flow": "Middlebury .flo: float32 pixels to the right and down, to the next view; beyond 1e9 is not known",
    "stereo": "as color, from the camera at (baseline, 0, 0) in the optical frame, of the same intrinsics",
    "measured": "16-bit grey: millimetres along the optical axis, as stereo_profile measures it; 0 is nothing",
    "objects": "X_camera_object: 4 x 4, pose in the optical frame; p of the model is scale * p in the object",
    "boxes": "x, y, width, height in whole pixels; box_amodal may reach beyond the image, by its size at most",
}
"""Value of ``DatasetRecord.conventions``."""


@dataclass(slots=True)
class RunProgress:
    """State of a run."""

    total: int
    """Number of samples in the job."""
    kept: int = 0
    """Number of samples that are kept from earlier runs."""
    rendered: int = 0
    """Number of samples that this run has rendered."""
    failures: dict[FailureRecord, None] = field(default_factory=dict)
    """Different failures, in the order of their arrival. All tasks of an unreadable scene report the same failure."""
    warnings: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Warnings by the name of the scene."""
    notes: list[str] = field(default_factory=list)
    """Sentences about what this run found and repaired in the folder."""

    @property
    def finished(self) -> int:
        """Number of samples that exist."""
        return self.kept + self.rendered


class Journal:
    """A file with a line for each finished sample, in the order in which the samples finish; read in that of the job.

    A run may have millions of samples. Each takes 8 bytes of memory, the offset of its line.
    """

    def __init__(self, job: Job, file: BinaryIO) -> None:
        """Create an empty journal in an empty file that is open for reading and writing."""
        self._job = job
        self._file = file
        self._end_offset = 0
        self._offsets = array("q", [_ABSENT]) * job.size
        """Offset of each sample's line in bytes, by the number of the sample."""
        self.count = 0
        """Number of different samples that were added."""

    def has_sample(self, number: int) -> bool:
        """Return True if the sample with a number was added."""
        return self._offsets[number] != _ABSENT

    def add(self, sample: SampleRecord) -> None:
        """Append a sample. It replaces an earlier sample with the same id."""
        planned = self._job.find(sample.id)
        assert planned is not None
        if not self.has_sample(planned.number):
            self.count += 1
        self._offsets[planned.number] = self._end_offset
        self._end_offset += self._file.write(manifest.encode(sample) + b"\n")

    def flush(self) -> None:
        """Write buffered lines to the file, so that they are not lost if this process is killed."""
        self._file.flush()

    def lines_in_job_order(self) -> Iterator[bytes]:
        """Yield the lines of all samples."""
        self._file.flush()
        try:
            for offset in self._offsets:
                if offset != _ABSENT:
                    if self._file.tell() != offset:
                        self._file.seek(offset)
                    yield self._file.readline()
        finally:
            self._file.seek(self._end_offset)  # where ``add`` goes on


def run(job: Job, run_tasks: TaskRunner, report: Callable[[RunProgress], None]) -> RunProgress:
    """Render the samples of a job that its folder does not have; ``report`` is called at the start and after each task.

    Raises DatasetError if the folder has other files, another dataset or another run; OSError if it cannot be written.
    """
    job.out.mkdir(parents=True, exist_ok=True)
    with locked(job.out):
        return _run_locked(job, run_tasks, report)


def _run_locked(job: Job, run_tasks: TaskRunner, report: Callable[[RunProgress], None]) -> RunProgress:
    out, existing = job.out, existing_dataset(job)
    notes = []
    if existing is not None and ends_in_partial_line(out / manifest.MANIFEST_FILE):
        notes = [f"the last line of {manifest.MANIFEST_FILE} was cut off; its sample is rendered again"]
    description = manifest.DatasetRecord(
        generator=f"scenegate {__version__}",
        renderer=cache_folder.sources_digest(),
        settings=job.settings,
        conventions=CONVENTIONS,
        classes=job.classes.names,
    )
    if existing is None:  # before all other files: the next run takes the folder for this job's, however this one ends
        write_atomically(out / manifest.DATASET_FILE, manifest.encode_indented(description))
    with temporary_name(out / manifest.JOURNAL_FILE) as temporary, temporary.open("w+b") as file:
        journal = Journal(job, file)
        if existing is not None and existing.renderer == description.renderer:  # another one renders all samples again
            for sample in valid_samples(job, usable_cpus()):
                journal.add(sample)
        journal.flush()
        temporary.replace(out / manifest.JOURNAL_FILE)
        if existing is not None:
            # The journal has the valid samples. The description comes last: once it names this renderer, the next run
            # takes all samples in the folder for its own.
            for name in (manifest.MANIFEST_FILE, manifest.FAILURES_FILE):
                (out / name).unlink(missing_ok=True)
            write_atomically(out / manifest.DATASET_FILE, manifest.encode_indented(description))
        problems = (FailureRecord(each.printable_name, None, each.problem) for each in job.sources if each.problem)
        progress = RunProgress(job.size, kept=journal.count, failures=dict.fromkeys(problems), notes=notes)
        report(progress)
        for result in run_tasks(job.tasks(journal.has_sample, description.renderer)):
            _add(result, job, journal, progress)
            report(progress)
        _finish(job, journal, progress.failures)
    return progress


def _add(result: Result, job: Job, journal: Journal, progress: RunProgress) -> None:
    if result.samples and not progress.rendered:
        _check_space(job, result.samples, job.size - journal.count)
    for sample in result.samples:
        journal.add(sample)
    journal.flush()
    progress.rendered += len(result.samples)
    progress.failures.update(dict.fromkeys(result.failures))
    if result.warnings and result.samples:
        progress.warnings[result.samples[0].scene] = result.warnings


def _check_space(job: Job, samples: list[SampleRecord], missing: int) -> None:
    """Raise DatasetError if a disk cannot hold all missing samples, estimated from the first ones."""
    mean = sum(image.bytes for sample in samples for image in sample.images.values()) / len(samples)
    needed, free = mean * (missing - len(samples)), shutil.disk_usage(job.out).free
    if needed > free:
        raise DatasetError(
            f"{job.out}: the samples need about {needed / 1e9:.1f} GB more, and {free / 1e9:.1f} GB are free; name a "
            "folder on another disk, or render fewer, smaller or other images (--depth-format png is compressed)"
        )


def _finish(job: Job, journal: Journal, failures: Iterable[FailureRecord]) -> None:
    """Write ``manifest.jsonl`` and ``failed.jsonl``, and remove the journal and temporary files."""
    out = job.out
    remove_temporary_files(out)
    remove_temporary_files(out / manifest.MODELS_FOLDER)
    for source in job.sources:
        folder = out / manifest.SCENES_FOLDER / source.name
        if not source.problem and folder.is_dir():
            remove_temporary_files(folder)
    if sorted_failures := sorted(failures, key=lambda failure: (failure.scene, failure.view or "")):
        write_atomically(
            out / manifest.FAILURES_FILE, (manifest.encode(failure) + b"\n" for failure in sorted_failures)
        )
    write_atomically(out / manifest.MANIFEST_FILE, journal.lines_in_job_order())
    (out / manifest.JOURNAL_FILE).unlink()
