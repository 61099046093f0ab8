"""Time and memory of the manifest of a large dataset, without its images.

    python -m bench.manifest [--samples 1000000]

Each row is a process of its own; memory is what its peak adds to that of a process that has only imported the code. The
peer is the same with all lines decoded into one list. Seconds are CPU time.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from bench.table import Row, show
from gateway.datasets.camera_file import CameraFile
from gateway.datasets.files import write_atomically
from gateway.datasets.job import Job, make_job
from gateway.datasets.resume import existing_dataset
from gateway.datasets.run import Journal
from gateway.datasets.sources import Source, SourceKind
from gateway.datasets.views import View
from scenegate.datasets import manifest
from scenegate.datasets.dataset import Dataset
from scenegate.datasets.manifest import CameraRecord, ImageFile, SampleRecord, Settings

VIEWS = 100
"""Views of each scene."""
SETTINGS = Settings(("color", "depth", "label"), 640, 480, 45.0, "auto", "auto", "fxaa", "tiff", (204, 229, 255))
CAMERA = CameraRecord(
    width=640, height=480, fx=579.4112549695428, fy=579.4112549695428, cx=320.0, cy=240.0, near=0.01, far=4.25,
    X_world_camera=(4 * ((0.8660254037844386, 0.25, -0.4330127018922193, 1.2990381056766578),)),
)  # fmt: skip


def job_of(folder: Path, samples: int) -> Job:
    sources = tuple(Source(f"robots/{n:06d}.glb", f"/{n}", SourceKind.FILE) for n in range(samples // VIEWS))
    return make_job(sources, tuple(View(f"orbit-{n:03d}", "fit") for n in range(VIEWS)), CameraFile(), SETTINGS, folder)


def sample(scene: str, view: str) -> SampleRecord:
    types, ends = SETTINGS.types, ("color.png", "depth.tiff", "label.png")
    images = {
        kind: ImageFile(f"scenes/{scene}/{view}.{end}", 8 * "0123abcd", 1228942)
        for kind, end in zip(types, ends, strict=True)
    }
    return SampleRecord(
        id=f"{scene}/{view}", scene=scene, view=view, view_description="fit", scene_sha256=8 * "0123abcd",
        camera=CAMERA, images=images,
    )  # fmt: skip


def write(folder: Path, samples: int) -> None:
    """Write the journal and the manifest of a run, without its images."""
    job = job_of(folder, samples)
    with (folder / manifest.JOURNAL_FILE).open("w+b") as file:
        journal = Journal(job, file)
        for view in job.default_views:  # far from the order of the manifest
            for source in job.sources:
                journal.add(sample(source.name, view.name))
        write_atomically(folder / manifest.MANIFEST_FILE, journal.lines_in_job_order())
    (folder / manifest.JOURNAL_FILE).unlink()
    known = manifest.DatasetRecord(generator="", renderer="", settings=SETTINGS, conventions={})
    write_atomically(folder / manifest.DATASET_FILE, manifest.encode_indented(known))


def resume(folder: Path, samples: int) -> None:
    """Read the samples of a former run, without hashing its images."""
    job = job_of(folder, samples)
    existing_dataset(job)
    with tempfile.TemporaryFile() as file:
        journal = Journal(job, file)
        for each in manifest.read_lines(folder / manifest.MANIFEST_FILE, SampleRecord):
            journal.add(each)
        assert journal.count == samples


def open_one(folder: Path, samples: int) -> None:
    """Open the dataset and read one sample."""
    dataset = Dataset(folder)
    assert len(dataset) == samples
    assert dataset[samples // 2].K.shape == (3, 3)


def iterate(folder: Path, samples: int) -> None:
    assert sum(1 for _ in Dataset(folder)) == samples


def as_list(folder: Path, samples: int) -> None:
    assert len(list(manifest.read_lines(folder / manifest.MANIFEST_FILE, SampleRecord))) == samples


JOBS: dict[str, Callable[[Path, int], None]] = {
    "write": write,
    "resume": resume,
    "open": open_one,
    "iterate": iterate,
    "list": as_list,
}
WHAT = {
    "write": "a run: journal and manifest of all samples",
    "resume": "the same run again: read all samples",
    "open": "reader: open, one sample",
    "iterate": "reader: all samples, one after the other",
}


def measure(job: str, folder: Path, samples: int) -> tuple[float, float]:
    """Return CPU time in seconds and memory in MB."""
    command = [sys.executable, "-m", "bench.manifest", "--samples", str(samples), "--job", job, str(folder)]
    seconds, megabytes = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    return float(seconds), float(megabytes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=1_000_000)
    parser.add_argument("--job", nargs=2, metavar=("JOB", "FOLDER"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    samples = max(1, options.samples // VIEWS) * VIEWS
    if options.job:
        before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
        JOBS[options.job[0]](Path(options.job[1]), samples)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        print(time.process_time() - began, peak / 1e3)
        return
    with tempfile.TemporaryDirectory() as name:
        figures = {job: measure(job, Path(name), samples) for job in JOBS}
        size = (Path(name) / manifest.MANIFEST_FILE).stat().st_size
    print(f"{samples} samples of {VIEWS} views a scene, a manifest of {size / 1e6:.0f} MB")
    seconds, megabytes = figures.pop("list")
    peer = f"{seconds:.2f} s, {megabytes:.0f} MB"
    show(
        Row(WHAT[job], f"{own:.2f} s, {used:.0f} MB", peer, f"{megabytes / max(used, 1.0):.0f}× less memory")
        for job, (own, used) in figures.items()
    )


if __name__ == "__main__":
    main()
