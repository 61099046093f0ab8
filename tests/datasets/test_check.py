"""``scenegate dataset check`` finds what is wrong, and nothing in what is right."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gateway.client import manifest
from gateway.datasets.check import check_dataset
from tests.datasets.conftest import Draw, job_of


@pytest.fixture
def dataset(scenes: Path, tmp_path: Path, draw: Draw) -> Path:
    draw(job_of(scenes, tmp_path / "out"))
    return tmp_path / "out"


def edit(dataset: Path, number: int, change: Callable[[dict[str, Any]], object]) -> None:
    """Changes a line of the manifest."""
    path = dataset / manifest.MANIFEST
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    change(lines[number])
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def replace_picture(dataset: Path, number: int, image_type: str, pixels: Any) -> None:
    """Another picture with its right hash."""

    def change(line: dict[str, Any]) -> None:
        path = dataset / line["images"][image_type]["path"]
        cv2.imwrite(str(path), pixels)
        line["images"][image_type]["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()

    edit(dataset, number, change)


def test_a_whole_dataset(dataset: Path) -> None:
    report = check_dataset(dataset, 2)
    assert report.problems == []
    assert report.notes == []
    assert (report.samples, report.scenes, report.images) == (7, 4, 19)


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (lambda d: (d / manifest.DATASET).unlink(), "there is no dataset.json"),
        (lambda d: (d / manifest.MANIFEST).unlink(), "the run has not ended"),
        (lambda d: (d / manifest.MANIFEST).write_bytes(b'{"id":1}\n'), "line 1: Expected `str`, got `int`"),
        (lambda d: (d / manifest.MANIFEST).write_bytes(b'{"id":'), "line 1: cut off"),
        (lambda d: (d / "scenes/a.gltf/orbit-0.color.png").unlink(), "a.gltf/orbit-0.color.png: missing"),
        (lambda d: (d / "scenes/a.gltf/orbit-0.color.png").write_bytes(b"x"), "changed: its SHA-256 is not"),
        (lambda d: (d / "scenes/a.gltf/scene.json").unlink(), "scene.json: No such file"),
        (lambda d: edit(d, 0, lambda s: s["camera"].update(fx=-1.0)), "focal lengths (-1.0"),
        (lambda d: edit(d, 0, lambda s: s["camera"].update(near=5.0, far=1.0)), "planes near=5.0, far=1.0"),
        (lambda d: edit(d, 0, lambda s: s["camera"]["X_world_camera"][0].__setitem__(0, 9.0)), "no rotation"),
        (lambda d: edit(d, 0, lambda s: s["camera"].update(width=33)), "32x24 pixels, the camera has 33x24"),
        (lambda d: edit(d, 0, lambda s: s["images"].pop("label")), "the label image is missing in the manifest"),
        (lambda d: edit(d, 1, lambda s: s.update(id="a.gltf/orbit-0")), "a.gltf/orbit-0 is there twice"),
        (lambda d: edit(d, 0, lambda s: s.update(scene_sha256="0")), "another state of the scene"),
        (
            lambda d: edit(d, 0, lambda s: s["images"]["color"].update(path="../../etc/passwd")),
            "outside of the dataset",
        ),
        (lambda d: replace_picture(d, 0, "color", np.zeros((24, 32), np.uint8)), "with 1 channels of uint8"),
        (lambda d: replace_picture(d, 0, "depth", np.full((24, 32), -1, np.float32)), "negative or not a number"),
        (
            lambda d: replace_picture(d, 0, "label", np.full((24, 32, 3), 7, np.uint8)),
            "labels that scene.json does not",
        ),
    ],
)
def test_damage_is_named(dataset: Path, damage: Callable[[Path], object], sentence: str) -> None:
    damage(dataset)
    report = check_dataset(dataset, 2)
    assert any(sentence in problem for problem in report.problems), report.problems


def test_strangers_are_noted(dataset: Path) -> None:
    (dataset / "scenes" / "a.gltf" / "holiday.jpg").write_bytes(b"")
    report = check_dataset(dataset, 1)
    assert report.problems == []
    assert report.notes == ["scenes/a.gltf/holiday.jpg: not in the manifest"]
