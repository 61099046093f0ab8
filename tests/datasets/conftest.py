"""Small scenes of every kind, and runs in this process."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gateway.datasets import local_tasks
from gateway.datasets.classes import ClassTable, classes_of_models
from gateway.datasets.job import Job, RenderTask, Result, make_job
from gateway.datasets.run import RunProgress, run
from gateway.datasets.scene_sources import Source, find_sources
from gateway.datasets.scenes import LoadedScene, load_scene, model_names
from gateway.datasets.views import CameraFile, View
from gateway.datasets.worker import run_task
from gateway.files.robots.scene_files import SceneOptions
from gateway.scene.draw.cameras import OrbitCamera
from renderers.raster import CpuRenderer
from scenegate.datasets.manifest import ANNOTATED_TYPES, FAILURES_FILE, FailureRecord, Settings, read_lines
from tests.support import forms

SETTINGS = Settings(
    types=("color", "depth", "label"),
    width=32,
    height=24,
    fovy=45.0,
    look="auto",
    up="auto",
    antialias="fxaa",
    depth_format="tiff",
    background=(204, 229, 255),
)
TREE = {
    "setgeometry": [
        {"path": ["robot", "base"], "geometry": {"type": "cylinder", "radius": 0.3, "length": 0.2}},
        {"path": ["robot", "arm"], "geometry": {"type": "box", "lengths": [0.1, 0.1, 0.8], "color": [1, 0.6, 0.1, 1]}},
    ],
    "settransform": [{"path": ["robot", "arm"], "transform": {"translation": [0, 0, 0.5]}}],
}
FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    """A folder with one scene of each kind."""
    folder = tmp_path / "scenes"
    (folder / "deep").mkdir(parents=True)
    (folder / "a.gltf").write_text(json.dumps(forms.gltf(generator="another program")))
    (folder / "deep" / "mesh.stl").write_text(f"solid t\n{FACET}endsolid t\n")
    (folder / "robot.tree.json").write_text(json.dumps(TREE))
    (folder / "depth.multipart").write_bytes(forms.body(forms.gltf(), forms.drake_fields("depth")))
    (folder / "notes.txt").write_text("no scene")
    return folder


def named(scenes: Path, name: str) -> Source:
    """Return the scene of a name in a folder."""
    return next(source for source in find_sources([scenes]) if source.name == name)


def loaded(path: Path, options: SceneOptions | None = None) -> LoadedScene:
    """Load the only scene of a file."""
    (source,) = find_sources([path])
    return load_scene(source, options or SceneOptions())


@pytest.fixture(scope="module")
def renderer() -> Iterator[CpuRenderer]:
    renderer = CpuRenderer(1)
    yield renderer
    renderer.close()


Draw = Callable[..., RunProgress]


@pytest.fixture
def draw() -> Draw:
    """Run jobs in this process; ``most`` interrupts the run after that many tasks."""

    def execute(job: Job, most: int | None = None) -> RunProgress:
        def tasks(all_of: list[RenderTask]) -> Iterator[Result]:
            for number, task in enumerate(all_of):
                if number == most:
                    raise KeyboardInterrupt
                yield run_task(task)

        return run(job, tasks, lambda _: None)

    return execute


def job_of(
    scenes: Path,
    out: Path,
    *,
    orbit: int = 2,
    settings: Settings = SETTINGS,
    cameras: CameraFile | None = None,
    classes: ClassTable | None = None,
) -> Job:
    """Return a job. Without ``classes``, each model has one if the settings have annotations."""
    views = tuple(View(f"orbit-{i}", OrbitCamera(i, orbit, 30.0)) for i in range(orbit))
    sources = find_sources([scenes])
    if classes is None:
        has_objects = bool({*ANNOTATED_TYPES} & {*settings.types})
        classes = classes_of_models(name for source in sources for name in model_names(source) if has_objects)
    return make_job(sources, views, cameras or CameraFile(), settings, out, classes=classes)


def contents(folder: Path) -> dict[str, bytes]:
    """Return all files of a folder by relative path."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def draw_in_processes(job: Job) -> RunProgress:
    """Run a job in two processes."""
    return run(job, lambda tasks: local_tasks.run_local(tasks, 2), lambda _: None)


def failures_of(out: Path) -> list[FailureRecord]:
    """Return what a dataset says of scenes and views that were not drawn."""
    return list(read_lines(out / FAILURES_FILE, FailureRecord))
