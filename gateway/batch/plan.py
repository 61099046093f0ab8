"""What a run has to draw, what of it is there already, and the tasks that are left."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from gateway import __version__
from gateway.batch.camerafile import CameraFile
from gateway.batch.files import sha256_of
from gateway.batch.scenes import digest_of
from gateway.batch.sources import Kind, Source
from gateway.batch.views import REQUEST, View
from gateway.client import manifest
from gateway.client.manifest import Failure, RecordError, Sample, Settings, SourceFile

VIEWS_PER_TASK: Final = 16
"""Reading a scene is paid once a task, and what a killed worker loses is a task: 16 views are about a second."""
HASHED_AT_ONCE: Final = 1000
"""Samples handed to the hashing threads: there may be millions."""

CONVENTIONS: Final = {
    "units": "metres, pixels; the world is right-handed and Z up",
    "X_world_camera": "4 x 4, row-major: pose of the optical frame (+X right, +Y down, +Z forward) in the world",
    "pixel": "column i, row j, (0, 0) is top left; its ray is ((i + 0.5 - cx) / fx, (j + 0.5 - cy) / fy, 1)",
    "color": "8-bit RGB, sRGB",
    "depth": "along the optical axis; tiff: float32 metres, inf is nothing; png: uint16 millimetres, 65535 is nothing",
    "label": "8-bit RGB: label = red + 256 green + 65536 blue; white is no label; scene.json says what they mean",
}


class PlanError(ValueError):
    """The run cannot be started; a sentence."""


@dataclass(frozen=True, slots=True)
class Task:
    """Some views of one scene; small, since it travels to workers."""

    number: int
    source: Source
    views: tuple[View, ...]
    out: str
    settings: Settings
    renderer: str
    """Digest of the rasterizer; a worker with another one refuses."""
    threads: int = 1
    """Of the worker, inside one picture."""


@dataclass(slots=True)
class Result:
    """What came of a task."""

    number: int
    samples: list[Sample] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Order:
    """All that a run was asked for."""

    sources: tuple[Source, ...]
    views: tuple[View, ...]
    """Of scenes that have none of their own."""
    own_views: Mapping[str, tuple[View, ...]]
    settings: Settings
    out: Path

    def views_of(self, source: Source) -> tuple[View, ...]:
        """The views of a scene."""
        if source.kind is Kind.REQUEST:
            return (View(REQUEST, None),)
        return self.own_views.get(source.name, self.views)

    @property
    def size(self) -> int:
        """How many samples that makes."""
        return sum(len(self.views_of(source)) for source in self.sources)


def make_order(
    sources: tuple[Source, ...], views: tuple[View, ...], cameras: CameraFile, settings: Settings, out: Path
) -> Order:
    """
    Args:
        views: of the command line; none of anything means one view, the file's own camera or ``fit``.

    Raises:
        PlanError: two views have one name, or the camera file speaks of scenes that are not there.
    """
    common = (*views, *cameras.cameras)
    if not common:
        common = (View("default", None),)
    names = Counter(view.name for view in common)
    if (twice := names.most_common(1)[0])[1] > 1:
        raise PlanError(f"two views are called {twice[0]!r}")
    strangers = cameras.scenes.keys() - {source.name for source in sources}
    if strangers:
        raise PlanError(f"the camera file names scenes that are not there: {', '.join(sorted(strangers)[:5])}")
    return Order(sources, common, cameras.scenes, settings, out)


def description(settings: Settings, renderer: str) -> manifest.Dataset:
    """``dataset.json``."""
    return manifest.Dataset(
        generator=f"scenegate {__version__}", renderer=renderer, settings=settings, conventions=CONVENTIONS
    )


def check_folder(order: Order, wanted: manifest.Dataset) -> list[Sample]:
    """What earlier runs left in the folder of the dataset, if it is the same dataset.

    Raises:
        PlanError: the folder holds something else, which would be spoilt.
    """
    out = order.out
    if not (out / manifest.DATASET).exists():
        if out.is_dir() and any(out.iterdir()):
            raise PlanError(f"{out} is not empty and holds no dataset")
        return []
    try:
        found = manifest.read_dataset(out)
        samples = {
            sample.id: sample
            for name in (manifest.MANIFEST, manifest.JOURNAL)
            if (out / name).exists()
            for sample in manifest.read_lines(out / name, Sample, torn_end=name == manifest.JOURNAL)
        }
    except RecordError as error:
        raise PlanError(str(error)) from None
    if found.settings != wanted.settings:
        names = Settings.__struct_fields__
        name = next(name for name in names if getattr(found.settings, name) != getattr(wanted.settings, name))
        there, here = getattr(found.settings, name), getattr(wanted.settings, name)
        raise PlanError(
            f"{out} holds a dataset with other settings ({name}: {there} there, {here} now); name another folder"
        )
    planned = {f"{source.name}/{view.name}" for source in order.sources for view in order.views_of(source)}
    strangers = sorted(samples.keys() - planned)
    if strangers:
        raise PlanError(
            f"{out} holds {len(strangers)} pictures of scenes or views that this command does not name "
            f"({strangers[0]}); name another folder"
        )
    if found.renderer != wanted.renderer:
        return []  # drawn by another version: all again
    return list(samples.values())


def done_of(order: Order, known: Iterable[Sample], threads: int = 1) -> Iterator[Sample]:
    """Those of the known samples that need not be drawn again: same scene, same view, files as they were written.

    ``threads``: that read and hash the pictures.
    """
    wanted = {
        f"{source.name}/{view.name}": (source, view) for source in order.sources for view in order.views_of(source)
    }
    digests: dict[str, str | None] = {}
    same: list[Sample] = []
    for sample in known:
        source, view = wanted[sample.id]
        if source.name not in digests:
            digests[source.name] = _scene_digest(order.out, source)
        if sample.asked == view.asked and sample.scene_sha256 == digests[source.name]:
            same.append(sample)

    def is_whole(sample: Sample) -> bool:
        return all(sha256_of(order.out / image.path) == image.sha256 for image in sample.images.values())

    with ThreadPoolExecutor(threads) as pool:
        for start in range(0, len(same), HASHED_AT_ONCE):
            part = same[start : start + HASHED_AT_ONCE]
            yield from (sample for sample, whole in zip(part, pool.map(is_whole, part), strict=True) if whole)


def _scene_digest(out: Path, source: Source) -> str | None:
    """The hash that the scene would have now, of the files that it was read from; None when one is missing."""
    try:
        known = manifest.read_file(out / manifest.SCENES / source.name / manifest.SCENE, manifest.Scene)
    except RecordError:
        return None
    folder = Path(source.path).parent
    now = tuple(SourceFile(file.path, sha256_of(folder / file.path) or "") for file in known.sources)
    return digest_of(now)


def tasks_of(order: Order, done: set[str], renderer: str) -> list[Task]:
    """The tasks that are left, in the order of the scenes."""
    tasks: list[Task] = []
    for source in order.sources:
        views = [view for view in order.views_of(source) if f"{source.name}/{view.name}" not in done]
        for start in range(0, len(views), VIEWS_PER_TASK):
            part = tuple(views[start : start + VIEWS_PER_TASK])
            tasks.append(Task(len(tasks), source, part, str(order.out), order.settings, renderer))
    return tasks


def with_threads(tasks: Iterable[Task], threads: int) -> list[Task]:
    """The same tasks for workers with so many threads each."""
    return [replace(task, threads=threads) for task in tasks]
