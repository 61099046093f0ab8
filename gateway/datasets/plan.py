"""What a run has to draw, what of it is there already, and the tasks that are left."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from gateway import __version__
from gateway.client import manifest
from gateway.client.manifest import Failure, RecordError, Sample, Settings
from gateway.datasets.camera_file import CameraFile
from gateway.datasets.sources import Kind, Source
from gateway.datasets.views import REQUEST, View

VIEWS_PER_TASK: Final = 16
"""Reading a scene is paid once a task, and what a killed worker loses is a task: 16 views are about a second."""

_OF_REQUEST: Final = (View(REQUEST, None),)

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
    timeout: float = 0.0
    """Seconds that reading the scene may take, and each of its views; 0: any time."""


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
    timeout: float = 0.0
    """Seconds for reading a scene and for drawing each view; 0: no limit."""

    def views_of(self, source: Source) -> tuple[View, ...]:
        """The views of a scene."""
        if source.kind is Kind.REQUEST:
            return _OF_REQUEST
        return self.own_views.get(source.name, self.views)

    @property
    def size(self) -> int:
        """How many samples that makes."""
        return sum(len(self.views_of(source)) for source in self.sources)


def make_order(
    sources: tuple[Source, ...],
    views: tuple[View, ...],
    cameras: CameraFile,
    settings: Settings,
    out: Path,
    timeout: float = 0.0,
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
    return Order(sources, common, cameras.scenes, settings, out, timeout)


def description(settings: Settings, renderer: str) -> manifest.Dataset:
    """``dataset.json``."""
    return manifest.Dataset(
        generator=f"scenegate {__version__}", renderer=renderer, settings=settings, conventions=CONVENTIONS
    )


def check_folder(order: Order, wanted: manifest.Dataset) -> manifest.Dataset | None:
    """What the folder of the dataset holds: nothing, or the same dataset, perhaps of another version of the renderer.

    Raises:
        PlanError: the folder holds something else, which would be spoilt.
    """
    out = order.out
    if not (out / manifest.DATASET).exists():
        if out.is_dir() and any(out.iterdir()):
            raise PlanError(f"{out} is not empty and holds no dataset")
        return None
    try:
        found = manifest.read_dataset(out)
    except RecordError as error:
        raise PlanError(str(error)) from None
    if found.settings != wanted.settings:
        names = Settings.__struct_fields__
        name = next(name for name in names if getattr(found.settings, name) != getattr(wanted.settings, name))
        there, here = getattr(found.settings, name), getattr(wanted.settings, name)
        raise PlanError(
            f"{out} holds a dataset with other settings ({name}: {there} there, {here} now); name another folder"
        )
    return found


def tasks_of(order: Order, is_done: Callable[[int], bool], renderer: str) -> list[Task]:
    """The tasks that are left, in the order of the scenes; ``is_done`` is asked by a sample's number in that order."""
    tasks: list[Task] = []
    first = 0
    for source in order.sources:
        all_of = order.views_of(source)
        views = [view for number, view in enumerate(all_of, first) if not is_done(number)]
        first += len(all_of)
        if source.problem:
            continue
        for start in range(0, len(views), VIEWS_PER_TASK):
            part = tuple(views[start : start + VIEWS_PER_TASK])
            task = Task(len(tasks), source, part, str(order.out), order.settings, renderer, timeout=order.timeout)
            tasks.append(task)
    return tasks


def with_threads(tasks: Iterable[Task], threads: int) -> list[Task]:
    """The same tasks for workers with so many threads each."""
    return [replace(task, threads=threads) for task in tasks]
