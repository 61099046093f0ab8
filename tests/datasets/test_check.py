"""``scenegate dataset check`` finds what is wrong, and nothing in what is right."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gateway.datasets.check import check_dataset
from scenegate.datasets import manifest
from tests.datasets.conftest import Draw, job_of


@pytest.fixture
def dataset(scenes: Path, tmp_path: Path, draw: Draw) -> Path:
    draw(job_of(scenes, tmp_path / "out"))
    return tmp_path / "out"


def edit(dataset: Path, number: int, change: Callable[[dict[str, Any]], object]) -> None:
    """Change a line of the manifest."""
    path = dataset / manifest.MANIFEST_FILE
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    change(lines[number])
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def replace_by_pipe(path: Path) -> None:
    """Put a named pipe, which nobody writes to, in place of a file."""
    path.unlink()
    os.mkfifo(path)


def edit_scene(dataset: Path, **changes: object) -> None:
    """Change the description of the first scene."""
    path = dataset / "scenes" / "a.gltf" / manifest.SCENE_FILE
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


@pytest.mark.parametrize("threads", [1, 2])
def test_a_whole_dataset(dataset: Path, threads: int) -> None:
    report = check_dataset(dataset, threads)
    assert report.image_bytes == sum(p.stat().st_size for p in dataset.rglob("*") if p.suffix in (".png", ".tiff"))
    assert report.problems == []
    assert report.notes == []
    assert (report.samples, report.scenes, report.images) == (7, 4, 19)


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (lambda d: (d / manifest.DATASET_FILE).unlink(), "there is no dataset.json"),
        (lambda d: (d / manifest.MANIFEST_FILE).unlink(), "the run has not ended"),
        (lambda d: (d / manifest.MANIFEST_FILE).write_bytes(b'{"id":1}\n'), "line 1: Expected `str`, got `int`"),
        (lambda d: (d / manifest.MANIFEST_FILE).write_bytes(b'{"id":'), "line 1: cut off"),
        (lambda d: (d / "scenes/a.gltf/orbit-0.color.png").unlink(), "a.gltf/orbit-0.color.png: missing"),
        (lambda d: (d / "scenes/a.gltf/orbit-0.color.png").write_bytes(b"x"), "changed: its SHA-256 is not"),
        (lambda d: (d / "scenes/a.gltf/scene.json").unlink(), "scene.json: No such file"),
        (lambda d: replace_by_pipe(d / "scenes/a.gltf/orbit-0.color.png"), "missing, or not a regular file"),
        (lambda d: replace_by_pipe(d / "scenes/a.gltf/scene.json"), "scene.json: it is not a regular file"),
        (lambda d: edit(d, 0, lambda s: s["camera"].update(width=33)), "32x24 pixels, the camera has 33x24"),
        (lambda d: edit(d, 0, lambda s: s["images"].pop("label")), "the label image is missing in the manifest"),
        (lambda d: edit(d, 1, lambda s: s.update(id="a.gltf/orbit-0")), "a.gltf/orbit-0 is there twice"),
        (lambda d: edit(d, 0, lambda s: s.update(scene_sha256="0")), "another state of the scene"),
        (lambda d: edit(d, 0, lambda s: s.update(id="a.gltf/other")), "is not that of scene a.gltf and view orbit-0"),
        (lambda d: edit(d, 0, lambda s: s["camera"].update(width=0)), "Expected `int` >= 1 - at `$.camera.width`"),
        (lambda d: edit(d, 0, lambda s: s["camera"].update(height=0)), "Expected `int` >= 1 - at `$.camera.height`"),
        (lambda d: (d / manifest.MANIFEST_FILE).write_bytes(b""), "manifest.jsonl has no samples"),
        (lambda d: edit(d, 0, lambda s: s["camera"].update(height=25)), "32x24 pixels, the camera has 32x25"),
        (lambda d: edit(d, 0, lambda s: s["images"]["color"].update(path="/etc/passwd")), "outside of the dataset"),
        (lambda d: edit_scene(d, scene="other"), "its scene.json is that of other"),
        (lambda d: edit_scene(d, sha256="0"), "does not follow from those of its sources"),
        (lambda d: edit(d, 0, lambda s: s["images"]["color"].update(path="../../etc/passwd")), "outside of the data"),
    ],
)
def test_damage_is_named(dataset: Path, damage: Callable[[Path], object], sentence: str) -> None:
    damage(dataset)
    report = check_dataset(dataset, 2)
    assert any(sentence in problem for problem in report.problems), report.problems


def test_unknown_files_are_noted(dataset: Path) -> None:
    (dataset / "scenes" / "a.gltf" / "holiday.jpg").write_bytes(b"")
    (dataset / "scenes" / "deep" / "image.png.7.part").write_bytes(b"")
    (dataset / manifest.JOURNAL_FILE).write_bytes(b"")
    report = check_dataset(dataset, 1)
    assert report.problems == []
    assert report.notes == [
        "journal.jsonl is there: a run is going on, or was stopped",
        "scenes/a.gltf/holiday.jpg: not in the manifest",
        "scenes/deep/image.png.7.part: left by a process that was killed",
    ]


def test_failures_are_noted(dataset: Path) -> None:
    failures = manifest.FailureRecord("b.gltf", None, "it is torn"), manifest.FailureRecord("a.gltf", "top", "no node")
    (dataset / manifest.FAILURES_FILE).write_bytes(b"".join(manifest.encode(each) + b"\n" for each in failures))
    report = check_dataset(dataset, 1)
    assert report.problems == []
    assert report.notes == ["b.gltf was not drawn: it is torn", "a.gltf, top was not drawn: no node"]
