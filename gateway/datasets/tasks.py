"""What one worker does: some views of one scene, drawn and written. Workers share nothing but the dataset's folder."""

from __future__ import annotations

import hashlib
import os
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

from gateway.client import manifest
from gateway.client.manifest import Failure, ImageType, Sample
from gateway.datasets.draw import FORMATS, RequestDrawer, draw, style_of, unlit_by_rig
from gateway.datasets.files import write_whole
from gateway.datasets.plan import Result, Task
from gateway.datasets.scenes import LoadedScene, SceneError, load_scene
from gateway.datasets.sources import Source
from gateway.datasets.views import View, camera_of, record_of
from gateway.render.errors import RequestError
from gateway.runtime import kernel_cache, process_tuning
from gateway.scene.cameras import CameraError
from renderers.camera import Camera
from renderers.drawlist import ImageError
from renderers.raster import CpuRenderer
from renderers.stop import run_within

T = TypeVar("T")

KEPT_SCENES: Final = 2
"""Per worker: the views of a scene come in a few tasks, mostly one after the other."""


@dataclass(frozen=True, slots=True)
class _Key:
    source: Source
    up: str
    modified: int
    size: int


class Worker:
    """Draws tasks, one after the other."""

    def __init__(self, threads: int = 1) -> None:
        """``threads``: that work inside one picture."""
        self._renderer = CpuRenderer(threads)
        self._scenes: OrderedDict[_Key, LoadedScene | SceneError] = OrderedDict()

    def work(self, task: Task) -> Result:
        """Draws all views of a task; what cannot be drawn is in the result."""
        result = Result(task.number)
        out = Path(task.out)
        if task.renderer != kernel_cache.sources_digest():
            reason = f"worker {os.uname().nodename} has another version of Scenegate than the one that was started"
            result.failures.append(Failure(task.source.name, None, reason))
            return result
        if not (out / manifest.DATASET).is_file():
            reason = f"worker {os.uname().nodename} does not see {out}: the folders must be shared by all nodes"
            result.failures.append(Failure(task.source.name, None, reason))
            return result
        try:
            scene = _within(task, lambda: self._scene(task))
            unlit = unlit_by_rig(scene, task.settings)
            folder = out / manifest.SCENES / task.source.name
            write_whole(folder / manifest.SCENE, manifest.encode_for_people(scene.record))
        except Exception as error:  # noqa: BLE001 - one bad scene must not end the others
            result.failures.append(Failure(task.source.name, None, _reason(error)))
            return result
        result.warnings = scene.record.warnings if unlit is None else (*scene.record.warnings, unlit)
        for view in task.views:
            try:
                result.samples.append(_within(task, partial(self._sample, task, scene, view, out)))
            except Exception as error:  # noqa: BLE001 - nor one bad view
                result.failures.append(Failure(task.source.name, view.name, _reason(error)))
        return result

    def _scene(self, task: Task) -> LoadedScene:
        status = Path(task.source.path).stat()
        key = _Key(task.source, task.settings.up, status.st_mtime_ns, status.st_size)
        found = self._scenes.pop(key, None)
        if found is None:
            try:
                found = load_scene(task.source, task.settings.up)  # type: ignore[arg-type]  # y, z or auto
            except SceneError as error:
                found = error
        self._scenes[key] = found
        while len(self._scenes) > KEPT_SCENES:
            self._scenes.popitem(last=False)
        if isinstance(found, SceneError):
            raise found
        return found

    def _sample(self, task: Task, scene: LoadedScene, view: View, out: Path) -> Sample:
        camera, pictures = self._pictures(task, scene, view)
        images: dict[ImageType, manifest.ImageFile] = {}
        for image_type, data in pictures.items():
            suffix = _format(image_type, task.settings)
            relative = f"{manifest.SCENES}/{task.source.name}/{view.name}.{image_type}.{suffix}"
            write_whole(out / relative, data)
            images[image_type] = manifest.ImageFile(relative, hashlib.sha256(data).hexdigest(), len(data))
        return Sample(
            id=f"{task.source.name}/{view.name}",
            scene=task.source.name,
            view=view.name,
            asked=view.asked,
            scene_sha256=scene.record.sha256,
            camera=record_of(camera),
            images=images,
        )

    def _pictures(self, task: Task, scene: LoadedScene, view: View) -> tuple[Camera, dict[ImageType, bytes]]:
        settings = task.settings
        if scene.request is not None:
            camera, image_type, data = RequestDrawer(self._renderer, settings).draw(scene.request)
            return camera, {image_type: data}
        camera = camera_of(
            view, scene.root, scene.drawn, scene.own_camera, settings.width, settings.height, settings.fovy
        )
        style = style_of(settings)
        formats = {image_type: _format(image_type, settings) for image_type in settings.types}
        return camera, draw(self._renderer, scene, camera, formats, style)


def _within(task: Task, call: Callable[[], T]) -> T:
    """Raises ``TimeoutError`` where it takes longer than the task allows."""
    return run_within(task.timeout, call, TimeoutError(f"it took longer than --timeout = {task.timeout:g} s"))


def _reason(error: Exception) -> str:
    """Our own errors are sentences; anything else is a defect, which its type helps to find."""
    if isinstance(error, SceneError | CameraError | ImageError | RequestError | OSError):
        return str(error)
    return f"{type(error).__name__}: {error}"


def _format(image_type: ImageType, settings: manifest.Settings) -> str:
    return settings.depth_format if image_type == "depth" else FORMATS[image_type][0]


_worker: Worker | None = None


def work(task: Task) -> Result:
    """``Worker.work`` of this process's own worker, with as many threads as the first task says."""
    global _worker
    if _worker is None:
        process_tuning.tune()
        _worker = Worker(task.threads)
    return _worker.work(task)
