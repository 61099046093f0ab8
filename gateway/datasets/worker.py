"""Render the views of a task, in a worker process, and write their images to the dataset."""

from __future__ import annotations

import hashlib
import os
import zlib
from collections.abc import Callable
from dataclasses import replace
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

import msgspec

from gateway.adapters.render.errors import RequestError
from gateway.datasets.annotated_scene import AnnotatedScene, annotate_scene
from gateway.datasets.classes import ClassTable
from gateway.datasets.files import write_atomically
from gateway.datasets.job import PlannedSample, RenderTask, Result
from gateway.datasets.rendering import (
    IMAGE_FORMATS,
    SampleInputs,
    render_request,
    render_sample,
    rig_warning,
    style_of,
    view_hint,
)
from gateway.datasets.scenario.tables import ScenarioError
from gateway.datasets.scene_sources import Source
from gateway.datasets.scenes import LoadedScene, SceneError, load_options, load_scene
from gateway.datasets.views import Intrinsics, View, camera_of, record_of
from gateway.files.robots.scene_files import SceneOptions
from gateway.runtime.workers import process_tuning
from gateway.scene.draw.cameras import CameraError
from renderers.camera import Camera
from renderers.compiler import cache_folder
from renderers.drawlist import ImageError
from renderers.raster import CpuRenderer
from renderers.stop import run_within
from scenegate.datasets import manifest
from scenegate.datasets.manifest import (
    ANNOTATED_TYPES,
    FailureRecord,
    ImageType,
    ModelRecord,
    ObjectRecord,
    SampleRecord,
)
from scenegate.regular_files import sha256_of

if TYPE_CHECKING:
    from gateway.adapters.stereo.device.profile import Profile

T = TypeVar("T")

CACHED_SCENES: Final = 2
"""Number of loaded scenes in memory. A scene with many views has several tasks, most of which are consecutive."""


def run_task(task: RenderTask) -> Result:
    """Render all views of a task. Errors are not raised, but are in the result."""
    scene_name = task.source.name
    if reason := _rejection(task):
        return Result(failures=[FailureRecord(scene_name, None, reason)])
    try:
        status = Path(task.source.path).stat()
        load = partial(_load_cached, task.source, load_options(task.settings), status.st_mtime_ns, status.st_size)
        scene = _with_timeout(task, load)
        warning = rig_warning(scene, task.settings)
        annotated = None
        if scene.request is None and {*ANNOTATED_TYPES} & {*task.settings.types}:
            annotated = _with_timeout(task, partial(_annotate_cached, scene, task.classes, task.out))
        description = scene.description
        if annotated is not None:
            description = msgspec.structs.replace(description, models=annotated.models)
        folder = Path(task.out) / manifest.SCENES_FOLDER / scene_name
        write_atomically(folder / manifest.SCENE_FILE, manifest.encode_indented(description))
    except Exception as error:  # noqa: BLE001 - one bad scene must not end the others
        return Result(failures=[FailureRecord(scene_name, None, _error_text(error))])
    result = Result(warnings=scene.description.warnings if warning is None else (*scene.description.warnings, warning))
    result.warnings += _view_hints(task, scene)
    for sample in task.samples:
        try:
            result.samples.append(_with_timeout(task, partial(_render_sample, task, scene, annotated, sample)))
        except Exception as error:  # noqa: BLE001 - one bad view must not end the others
            result.failures.append(FailureRecord(scene_name, sample.view.name, _error_text(error)))
    return result


def _render_sample(
    task: RenderTask, scene: LoadedScene, annotated: AnnotatedScene | None, sample: PlannedSample
) -> SampleRecord:
    """Render a sample, write its images, and return its record."""
    objects: tuple[ObjectRecord, ...] = ()
    if scene.request is not None:
        camera, image_type, data = render_request(_renderer(task.threads), scene.request, task.settings)
        encoded_images = {image_type: data}
    else:
        inputs = _inputs(task, scene, annotated, sample)
        camera = inputs.camera
        if camera.width * camera.height > manifest.MAX_IMAGE_PIXELS:  # readers of datasets refuse more
            limit = f"the limit of an image of a dataset is {manifest.MAX_IMAGE_PIXELS} pixels"
            raise ValueError(f"{camera.width}x{camera.height} pixels, {limit}")
        formats = {image_type: _file_format(image_type, task.settings) for image_type in task.settings.types}
        encoded_images, objects = render_sample(_renderer(task.threads), inputs, formats, style_of(task.settings))
    images: dict[ImageType, manifest.ImageFile] = {}
    for image_type, data in encoded_images.items():
        path = f"{manifest.SCENES_FOLDER}/{sample.id}.{image_type}.{_file_format(image_type, task.settings)}"
        write_atomically(Path(task.out) / path, data)
        images[image_type] = manifest.ImageFile(path, hashlib.sha256(data).hexdigest(), len(data))
    return SampleRecord(
        id=sample.id,
        scene=task.source.name,
        view=sample.view.name,
        view_description=sample.description,
        scene_sha256=scene.description.sha256,
        camera=record_of(camera),
        images=images,
        objects=objects,
    )


def _view_hints(task: RenderTask, scene: LoadedScene) -> tuple[str, ...]:
    """Return a hint if the first view of a scene, which is no scenario's, sees nothing of it."""
    if scene.request is not None or scene.scenario is not None or not task.samples:
        return ()
    try:
        camera = _camera_of(task.samples[0].view, scene, task.settings)
        hint = _with_timeout(task, partial(view_hint, _renderer(task.threads), scene, camera))
    except (ValueError, OSError):  # the sample fails likewise
        return ()
    return () if hint is None else (hint,)


def _inputs(
    task: RenderTask, scene: LoadedScene, annotated: AnnotatedScene | None, sample: PlannedSample
) -> SampleInputs:
    """Return the scene, the cameras and the camera profile of a sample."""
    settings = task.settings
    scene_at_frame, view_with_pose = scene.at_frame_of(sample.view)
    if scene_at_frame is not scene and annotated is not None:
        annotated = _annotate_cached(scene_at_frame, task.classes, task.out)
    next_scene, next_camera = None, None
    if sample.next_view is not None:
        next_scene, next_view_with_pose = scene_at_frame.at_frame_of(sample.next_view)
        next_camera = _camera_of(next_view_with_pose, next_scene, settings)
    return SampleInputs(
        scene_at_frame,
        _camera_of(view_with_pose, scene_at_frame, settings),
        annotated,
        next_camera=next_camera,
        next_scene=None if next_scene is scene_at_frame else next_scene,
        baseline=settings.baseline,
        profile=_profile_of(settings),
        depth_mode=settings.depth_mode,
        noise_seed=zlib.crc32(sample.id.encode()),
    )


@cache
def _renderer(threads: int) -> CpuRenderer:
    """Return the renderer of this process, which is created at the first call."""
    process_tuning.tune()
    return CpuRenderer(threads)


def _rejection(task: RenderTask) -> str:
    """Return the reason why this process cannot run a task, or an empty text."""
    node = os.uname().nodename
    if task.renderer_digest != cache_folder.sources_digest():
        return f"worker {node} has another version of Scenegate than the one that was started"
    if not (Path(task.out) / manifest.DATASET_FILE).is_file():
        return f"worker {node} does not see {task.out}: the folders must be shared by all nodes"
    return ""


@lru_cache(CACHED_SCENES)
def _load_cached(source: Source, options: SceneOptions, modified_ns: int, size: int) -> LoadedScene:
    """Load a scene. The time and size of its file are arguments, so that they are part of the cache's key."""
    return load_scene(source, options)


def _camera_of(view: View, scene: LoadedScene, settings: manifest.Settings) -> Camera:
    """Return the camera of a view in a scene. Views without a lens have that of the stereo profile, if there is one."""
    profile = _profile_of(settings)
    if profile is not None and view.intrinsics == Intrinsics():
        k = profile.model.intrinsics()
        view = replace(view, intrinsics=Intrinsics(k.width, k.height, fy=k.focal_length, cx=k.cx, cy=k.cy))
    return camera_of(
        view, scene.root, scene.draw_list, scene.file_camera, settings.width, settings.height, settings.fovy
    )


def _profile_of(settings: manifest.Settings) -> Profile | None:
    """Return the camera profile of a dataset, if it has one."""
    if not settings.stereo_profile:
        return None
    from gateway.datasets.measured_depth import cached_profile

    return cached_profile(settings.stereo_profile)


@lru_cache(CACHED_SCENES)
def _annotate_cached(scene: LoadedScene, classes: ClassTable, out: str) -> AnnotatedScene:
    """Return the objects of a scene, and write the models that the dataset does not have."""

    def save(record: ModelRecord, data: bytes) -> None:
        path = Path(out) / record.path
        if sha256_of(path) != record.sha256:
            write_atomically(path, data)

    return annotate_scene(scene, classes, save)


def _with_timeout(task: RenderTask, call: Callable[[], T]) -> T:
    """Return ``call()``, or raise TimeoutError if it takes longer than the task's ``timeout``."""
    return run_within(task.timeout, call, TimeoutError(f"it took longer than --timeout = {task.timeout:g} s"))


def _error_text(error: Exception) -> str:
    """Return the text of an error. The type is added if it is not one of the expected types."""
    if isinstance(error, SceneError | ScenarioError | CameraError | ImageError | RequestError | OSError):
        return str(error)
    return f"{type(error).__name__}: {error}"


def _file_format(image_type: ImageType, settings: manifest.Settings) -> str:
    """Return the file format, which is also the suffix, of a type of image."""
    return settings.depth_format if image_type == "depth" else IMAGE_FORMATS[image_type][0]
