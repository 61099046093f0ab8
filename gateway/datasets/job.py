"""A job (scenes, their views, settings), and its tasks for worker processes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

from gateway.client.manifest import FailureRecord, SampleRecord, Settings
from gateway.datasets.camera_file import CameraFile
from gateway.datasets.sources import Kind, Source
from gateway.datasets.views import REQUEST, View

VIEWS_PER_TASK: Final = 16
"""Maximum number of views in a task, about a second of work. Each task reads its scene once; a worker that dies loses
its task."""

_REQUEST_VIEWS: Final = (View(REQUEST, None),)


class JobError(ValueError):
    """The job cannot be started; the message is one sentence."""


@dataclass(frozen=True, slots=True)
class PlannedSample:
    """A sample of a job."""

    number: int
    """Index among all samples of the job: its place in the manifest."""
    source: Source
    view: View


@dataclass(frozen=True, eq=False)
class Job:
    """All samples to render. They are computed and not stored, since there may be millions."""

    sources: tuple[Source, ...]
    views: tuple[View, ...]
    """Views of the scenes that are not in ``own_views``."""
    own_views: Mapping[str, tuple[View, ...]]
    """Views of single scenes, by scene name."""
    settings: Settings
    out: Path
    timeout: float = 0.0
    """Maximum time for reading a scene and for rendering each view, seconds; 0: no limit."""

    def views_of(self, source: Source) -> tuple[View, ...]:
        """Return the views of a scene."""
        if source.kind is Kind.REQUEST:
            return _REQUEST_VIEWS
        return self.own_views.get(source.name, self.views)

    @cached_property
    def size(self) -> int:
        """Number of samples."""
        return sum(len(self.views_of(source)) for source in self.sources)

    def find(self, sample_id: str) -> PlannedSample | None:
        """Return the sample with this id, or None if it is not part of the job."""
        scene, _, view_name = sample_id.rpartition("/")
        if scene not in self._first_numbers:
            return None
        first_number, source = self._first_numbers[scene]
        views = self.views_of(source)
        index = self._view_indices[id(views)].get(view_name)
        return None if index is None else PlannedSample(first_number + index, source, views[index])

    def tasks(self, is_done: Callable[[int], bool], renderer: str) -> list[Task]:
        """Return the tasks for all samples that are not done, in the order of the scenes.

        Args:
            is_done: returns True for the numbers of samples that exist already.
            renderer: digest of the rasterizer's sources.
        """
        tasks: list[Task] = []
        for first_number, source in self._first_numbers.values():
            if source.problem:
                continue
            missing = [view for k, view in enumerate(self.views_of(source), first_number) if not is_done(k)]
            for k in range(0, len(missing), VIEWS_PER_TASK):
                views = tuple(missing[k : k + VIEWS_PER_TASK])
                tasks.append(Task(source, views, str(self.out), self.settings, renderer, timeout=self.timeout))
        return tasks

    @cached_property
    def _first_numbers(self) -> dict[str, tuple[int, Source]]:
        """By scene name, in the order of the job: the number of the scene's first sample, and the scene."""
        first_numbers = {}
        number = 0
        for source in self.sources:
            first_numbers[source.name] = number, source
            number += len(self.views_of(source))
        return first_numbers

    @cached_property
    def _view_indices(self) -> dict[int, dict[str, int]]:
        """Indices of views by name, for each tuple of views by its ``id``, since most scenes share one."""
        all_views = (_REQUEST_VIEWS, self.views, *self.own_views.values())
        return {id(views): {view.name: index for index, view in enumerate(views)} for views in all_views}


@dataclass(frozen=True, slots=True)
class Task:
    """Some views of one scene, to be sent to a worker process."""

    source: Source
    views: tuple[View, ...]
    out: str
    """Folder of the dataset."""
    settings: Settings
    renderer: str
    """Digest of the rasterizer's sources; a worker with another version refuses the task."""
    threads: int = 1
    """Number of threads in the worker for one image."""
    timeout: float = 0.0
    """Maximum time for reading the scene and for rendering each view, seconds; 0: no limit."""

    def failed(self, reason: str) -> Result:
        """Return the result of this task if none of its views can be rendered."""
        return Result(failures=[FailureRecord(self.source.name, view.name, reason) for view in self.views])


@dataclass(slots=True)
class Result:
    """Outcome of a task."""

    samples: list[SampleRecord] = field(default_factory=list)
    failures: list[FailureRecord] = field(default_factory=list)
    warnings: tuple[str, ...] = ()


def make_job(
    sources: tuple[Source, ...],
    views: tuple[View, ...],
    cameras: CameraFile,
    settings: Settings,
    out: Path,
    timeout: float = 0.0,
) -> Job:
    """Return the job for a command line.

    Args:
        views: views from the command line. Without any, and without a camera file, each scene has one view: the file's
            own first camera, or ``fit``.

    Raises:
        JobError: two views have the same name, or the camera file names a scene that is not there.
    """
    common = (*views, *cameras.cameras) or (View("default", None),)
    name, count = Counter(view.name for view in common).most_common(1)[0]
    if count > 1:
        raise JobError(f"two views are called {name!r}")
    if unknown := cameras.scenes.keys() - {source.name for source in sources}:
        raise JobError(f"the camera file names scenes that are not there: {', '.join(sorted(unknown)[:5])}")
    return Job(sources, common, cameras.scenes, settings, out, timeout)
