"""A job: the scenes, views and settings of a dataset; and the tasks into which it is divided for worker processes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

from gateway.datasets.classes import NO_CLASSES, ClassTable
from gateway.datasets.errors import DatasetError
from gateway.datasets.scene_sources import Source, SourceKind
from gateway.datasets.views import REQUEST_VIEW_NAME, CameraFile, SceneCamera, View
from scenegate.datasets.manifest import FailureRecord, SampleRecord, Settings

VIEWS_PER_TASK: Final = 16
"""Maximum number of views in a task. They take about a second. A worker reads the scene once for each task; if it dies,
the whole task is repeated."""

_REQUEST_VIEWS: Final = (View(REQUEST_VIEW_NAME, None),)


@dataclass(frozen=True, slots=True)
class PlannedSample:
    """A sample that a job has to render."""

    number: int
    """Index among all samples of the job, in the order of the manifest."""
    source: Source
    view: View
    next_view: View | None = None
    """View after this one, if the sample depends on it."""

    @property
    def id(self) -> str:
        """Value of ``SampleRecord.id``."""
        return f"{self.source.name}/{self.view.name}"

    @property
    def description(self) -> str:
        """Value of ``SampleRecord.view_description``."""
        then = "" if self.next_view is None else f"; then {self.next_view.description}"
        return self.view.description + then


@dataclass(frozen=True, eq=False)
class Job:
    """The scenes and views to render. Samples are not stored, because there may be millions."""

    sources: tuple[Source, ...]
    """Scene files, ordered by name."""
    default_views: tuple[View, ...]
    """Views of the scenes that are not in ``scene_views``."""
    scene_views: Mapping[str, tuple[View, ...]]
    """Views of single scenes, by scene name."""
    settings: Settings
    out: Path
    """Folder of the dataset."""
    timeout: float = 0.0
    """Maximum time for reading a scene, and for rendering each view, in seconds; 0: no limit."""
    classes: ClassTable = NO_CLASSES
    """Classes of objects; none without annotations."""

    def views_of(self, source: Source) -> tuple[View, ...]:
        """Return the views of a scene."""
        if source.kind is SourceKind.REQUEST:
            return _REQUEST_VIEWS
        return self.scene_views.get(source.name, self.default_views)

    @cached_property
    def size(self) -> int:
        """Number of samples."""
        return sum(len(self.views_of(source)) for source in self.sources)

    def find(self, sample_id: str) -> PlannedSample | None:
        """Return the sample with an id, or None if the job has no such sample."""
        scene, _, view_name = sample_id.rpartition("/")
        if scene not in self._first_numbers:
            return None
        first_number, source = self._first_numbers[scene]
        index = self._view_indices[id(self.views_of(source))].get(view_name)
        return None if index is None else self._planned(first_number, source, index)

    def _planned(self, first_number: int, source: Source, index: int) -> PlannedSample:
        """Return the sample of a scene with an index, given the number of the scene's first sample."""
        views = self.views_of(source)
        return PlannedSample(first_number + index, source, views[index], self._next_view(views, index))

    def _next_view(self, views: tuple[View, ...], index: int) -> View | None:
        """Return the view after a view, if samples depend on it and there is one. Frames have one of their camera."""
        if "flow" not in self.settings.types or index + 1 >= len(views):
            return None
        pose, next_pose = views[index].pose, views[index + 1].pose
        if isinstance(pose, SceneCamera) and isinstance(next_pose, SceneCamera) and pose.frame is not None:
            return views[index + 1] if pose.index == next_pose.index else None
        return views[index + 1]

    def tasks(self, is_done: Callable[[int], bool], renderer_digest: str) -> list[RenderTask]:
        """Return tasks for the samples whose number is not ``is_done``, in the order of the scenes."""
        tasks: list[RenderTask] = []
        for first_number, source in self._first_numbers.values():
            if source.problem:
                continue
            views = range(len(self.views_of(source)))
            missing = [self._planned(first_number, source, k) for k in views if not is_done(first_number + k)]
            tasks.extend(
                RenderTask(
                    source,
                    tuple(missing[k : k + VIEWS_PER_TASK]),
                    str(self.out),
                    self.settings,
                    renderer_digest,
                    timeout=self.timeout,
                    classes=self.classes,
                )
                for k in range(0, len(missing), VIEWS_PER_TASK)
            )
        return tasks

    @cached_property
    def _first_numbers(self) -> dict[str, tuple[int, Source]]:
        """Number of each scene's first sample, and the scene, by the scene's name."""
        first_numbers = {}
        next_number = 0
        for source in self.sources:
            first_numbers[source.name] = next_number, source
            next_number += len(self.views_of(source))
        return first_numbers

    @cached_property
    def _view_indices(self) -> dict[int, dict[str, int]]:
        """Indices of views by name, for each tuple of views by Python's ``id``. Most scenes share one tuple."""
        all_views = (_REQUEST_VIEWS, self.default_views, *self.scene_views.values())
        return {id(views): {view.name: index for index, view in enumerate(views)} for views in all_views}


@dataclass(frozen=True, slots=True)
class RenderTask:
    """Views of one scene that a worker process renders. It is sent to the process by pickle."""

    source: Source
    samples: tuple[PlannedSample, ...]
    """Samples of this scene."""
    out: str
    """Folder of the dataset."""
    settings: Settings
    renderer_digest: str
    """Digest of the rasterizer's sources. A worker of another version rejects the task."""
    threads: int = 1
    """Number of threads with which the worker renders an image."""
    timeout: float = 0.0
    """Maximum time for reading the scene, and for rendering each view, in seconds; 0: no limit."""
    classes: ClassTable = NO_CLASSES
    """Classes of objects."""

    def failed(self, reason: str) -> Result:
        """Return a result in which all views of this task have failed."""
        return Result(failures=[FailureRecord(self.source.name, sample.view.name, reason) for sample in self.samples])


@dataclass(slots=True)
class Result:
    """Result of a task."""

    samples: list[SampleRecord] = field(default_factory=list)
    failures: list[FailureRecord] = field(default_factory=list)
    warnings: tuple[str, ...] = ()
    """Warnings about the scene."""


def make_job(
    sources: tuple[Source, ...],
    views: tuple[View, ...],
    cameras: CameraFile,
    settings: Settings,
    out: Path,
    timeout: float = 0.0,
    classes: ClassTable = NO_CLASSES,
) -> Job:
    """Return the job for a command line, with the views of the camera file.

    If there are no default views at all, each scene has one: its file's first camera, or ``fit``. Raises DatasetError
    if two views have the same name, or the camera file names a scene that does not exist.
    """
    default_views = (*views, *cameras.default_views) or (View("default", None),)
    name, count = Counter(view.name for view in default_views).most_common(1)[0]
    if count > 1:
        raise DatasetError(f"two views are called {name!r}")
    if unknown_scenes := cameras.scene_views.keys() - {source.name for source in sources}:
        raise DatasetError(f"the camera file names scenes that are not there: {', '.join(sorted(unknown_scenes)[:5])}")
    return Job(sources, default_views, cameras.scene_views, settings, out, timeout, classes)
