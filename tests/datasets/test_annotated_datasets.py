"""Datasets with annotations: what the reader returns, what the check finds, and what a further run keeps."""

import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from gateway.datasets.check import check_dataset
from gateway.datasets.classes import classes_of_models
from gateway.datasets.errors import DatasetError
from gateway.datasets.job import Job
from gateway.datasets.views import CameraFile, View
from scenegate.datasets import manifest
from scenegate.datasets.dataset import FLOW_MAGIC, Dataset
from scenegate.datasets.manifest import IMAGE_TYPES, RecordError
from scenegate.regular_files import sha256_of
from tests.datasets.conftest import SETTINGS, Draw, contents, draw_in_processes, job_of
from tests.datasets.plates import Plate, write_plates
from tests.datasets.test_check import edit

TYPES = tuple(image_type for image_type in IMAGE_TYPES if image_type != "measured")
ALL = msgspec.structs.replace(SETTINGS, types=TYPES, baseline=0.1, up="z")
VIEWS = tuple(View(f"v{k}", f"eye={k / 4},0,0;target={k / 4},0,4;up=0,-1,0;fovy=60") for k in range(3))


def plates_job(folder: Path, out: Path, **changes: object) -> Job:
    """Return a job of three views of plates, of which the near one hides half of the far one in the first view."""
    (folder / "plates").mkdir(exist_ok=True)
    plates = [Plate("far", mesh="b"), Plate("near", (0.5, 0.0, 2.0), "a"), Plate("c", (-1.0, 0.0, 4.0))]
    write_plates(folder / "plates" / "p.gltf", plates)
    values = {"settings": ALL, "cameras": CameraFile(VIEWS), **changes}
    return job_of(folder / "plates", out, orbit=0, **values)  # type: ignore[arg-type]  # settings


@pytest.fixture
def dataset(tmp_path: Path, draw: Draw) -> Path:
    progress = draw(plates_job(tmp_path, tmp_path / "out"))
    assert not progress.failures
    return tmp_path / "out"


def test_the_reader_returns_all_images(dataset: Path) -> None:
    opened = Dataset(dataset)
    assert opened.classes == {1: "a", 2: "b", 3: "plate"}
    first, *_, last = opened
    shape = (24, 32)
    far, near, _ = first.objects
    assert [each.path for each in first.objects] == [("far",), ("near",), ("c",)]
    assert first.instance.shape == shape
    assert first.instance.dtype == first.class_ids.dtype == np.uint16
    np.testing.assert_array_equal(first.class_ids, np.array([0, 2, 1, 3])[first.instance])
    assert (first.instance == near.instance).sum() == near.visible_pixels > 0
    mask = first.amodal_mask(far.instance)
    assert mask.shape == shape
    assert mask.sum() == far.amodal_pixels > far.visible_pixels > 0
    assert (mask & (first.instance == near.instance)).any()
    normal = first.normal
    assert normal.dtype == np.float32
    facing = normal[first.instance > 0]
    np.testing.assert_allclose(facing, np.broadcast_to((0.0, 0.0, -1.0), facing.shape), atol=1e-6)
    assert (normal[first.instance == 0] == 0.0).all()
    assert first.albedo.shape == first.stereo.shape == (*shape, 3)
    assert first.flow.shape == (*shape, 2)
    expected = -first.record.camera.fx * 0.25 / first.depth
    np.testing.assert_allclose(first.flow[..., 0][first.instance > 0], expected[first.instance > 0], rtol=1e-5)
    assert np.isnan(first.flow[np.isinf(first.depth)]).all()
    first.path("flow").write_bytes(struct.pack("<fii2f", FLOW_MAGIC, 1, 1, 0.0, 0.0))
    with pytest.raises(RecordError, match=r"flow\.flo: 1x1 .*32x24"):
        _ = first.flow
    with pytest.raises(RecordError, match="has no flow image"):
        _ = last.flow
    with pytest.raises(RecordError, match="no mask of instance 9"):
        first.amodal_mask(9)


def test_poses_and_models_put_points_into_the_image(dataset: Path) -> None:
    """Corners of the model of an object, projected by its pose and K, are the corners of its box."""
    opened = Dataset(dataset)
    models = opened.scene("p.gltf").models
    for sample in opened:
        for each in sample.objects:
            corners = np.array(models[each.model].box) * each.scale
            X = np.array(each.X_camera_object)
            pixels = (corners @ X[:3, :3].T + X[:3, 3]) @ sample.K.T
            pixels = pixels[:, :2] / pixels[:, 2:]
            assert each.box_amodal is not None
            x, y, width, height = each.box_amodal
            np.testing.assert_allclose(pixels, ((x, y), (x + width, y + height)), atol=0.51)
            np.testing.assert_allclose(sample.X_world_camera @ X, each.X_world_object, atol=1e-9)


def test_measured_depth_of_a_profile(tmp_path: Path, draw: Draw) -> None:
    profile = tmp_path / "small.toml"
    stereo = "[stereo]\nsize = [64, 48]\nfocal_length = 40.0\nbaseline = 0.2\n"
    profile.write_text(f'name = "s"\n{stereo}[projector]\noutput = "High"')
    settings = msgspec.structs.replace(ALL, types=("depth", "measured"), stereo_profile=str(profile))
    wall = write_plates(tmp_path / "wall.gltf", [Plate("wall", (0.0, 0.0, 2.0), node={"scale": [20.0, 20.0, 1.0]})])
    job = job_of(wall, tmp_path / "out", orbit=0, settings=settings, cameras=CameraFile(VIEWS[:1]))
    assert not draw(job).failures
    (sample,) = Dataset(tmp_path / "out")
    assert sample.K.tolist() == [[40, 0, 32], [0, 40, 24], [0, 0, 1]]
    both = np.isfinite(sample.measured) & np.isfinite(sample.depth)
    assert both.sum() > 500
    assert np.median(np.abs(sample.measured - sample.depth)[both]) < 0.2  # 0.25 pixels are 125 mm at 2 m
    assert check_dataset(tmp_path / "out", 1).problems == []


def test_there_are_no_objects_without_their_images(tmp_path: Path, draw: Draw) -> None:
    draw(plates_job(tmp_path, tmp_path / "out", settings=msgspec.structs.replace(SETTINGS, up="z")))
    opened = Dataset(tmp_path / "out")
    assert not opened.classes
    assert not opened.scene("p.gltf").models
    assert not any(sample.objects for sample in opened)
    assert not (tmp_path / "out" / manifest.MODELS_FOLDER).exists()


def test_recorded_requests_are_not_annotated(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    draw(job_of(scenes, tmp_path / "out", settings=ALL))
    objects = {sample.record.scene: len(sample.objects) for sample in Dataset(tmp_path / "out")}
    assert objects == {"a.gltf": 1, "deep/mesh.stl": 1, "depth.multipart": 0, "robot.tree.json": 2}
    assert check_dataset(tmp_path / "out", 1).problems == []


@pytest.mark.slow
def test_processes_give_the_same_bytes(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    draw(job_of(scenes, tmp_path / "one", orbit=20, settings=ALL))
    job = job_of(scenes, tmp_path / "two", orbit=20, settings=ALL)
    draw_in_processes(job)
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


def change_masks(dataset: Path, *counts: list[int]) -> None:
    """Replace the silhouettes of the first sample, and their hash."""

    def change(line: dict[str, dict[str, dict[str, str]]]) -> None:
        path = dataset / line["images"]["amodal"]["path"]
        silhouettes = [{"instance": k, "size": [24, 32], "counts": runs} for k, runs in enumerate(counts, 1)]
        path.write_text(json.dumps(silhouettes))
        line["images"]["amodal"]["sha256"] = str(sha256_of(path))

    edit(dataset, 0, change)


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (lambda d: change_masks(d), "there is no mask of instance 1"),
        (lambda d: change_masks(d, [767]), "the runs of instance 1 do not fill the image"),
        (lambda d: [path.unlink() for path in (d / "models").iterdir()], "missing, or its SHA-256 is not that of"),
    ],
)
def test_damage_is_named(dataset: Path, damage: Callable[[Path], object], sentence: str) -> None:
    assert check_dataset(dataset, 1).problems == []
    damage(dataset)
    report = check_dataset(dataset, 2)
    assert any(sentence in problem for problem in report.problems), report.problems


def test_a_run_with_other_classes_is_refused(dataset: Path, tmp_path: Path, draw: Draw) -> None:
    assert draw(plates_job(tmp_path, dataset)).rendered == 0
    before = contents(dataset)
    with pytest.raises(DatasetError, match=r"classes \(3 .*1 "):
        draw(plates_job(tmp_path, dataset, classes=classes_of_models(["a"])))
    assert contents(dataset) == before


def test_damaged_models_are_written_again(dataset: Path, tmp_path: Path, draw: Draw) -> None:
    before = contents(dataset)
    (model,) = (dataset / manifest.MODELS_FOLDER).iterdir()  # all plates have the same geometry
    model.write_bytes(b"broken")
    assert draw(plates_job(tmp_path, dataset)).rendered == 3
    assert contents(dataset) == before


def test_another_next_view_makes_another_flow(dataset: Path, tmp_path: Path, draw: Draw) -> None:
    """Of three views, the last one changes: it and the one before are rendered again."""
    views = (*VIEWS[:2], View("v2", "eye=1,0,0;target=1,0,4;up=0,-1,0;fovy=60"))
    job = job_of(tmp_path / "plates", dataset, orbit=0, settings=ALL, cameras=CameraFile(views))
    assert draw(job).rendered == 2


def test_a_manifest_that_was_cut_is_repaired(dataset: Path, tmp_path: Path, draw: Draw) -> None:
    before = contents(dataset)
    path = dataset / manifest.MANIFEST_FILE
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(RecordError, match="line 3: cut off"):
        Dataset(dataset)
    progress = draw(plates_job(tmp_path, dataset))
    assert progress.notes == ["the last line of manifest.jsonl was cut off; its sample is rendered again"]
    assert (progress.kept, progress.rendered) == (2, 1)
    assert contents(dataset) == before
    assert draw(plates_job(tmp_path, dataset)).notes == []


def test_a_full_disk_is_found_after_the_first_task(tmp_path: Path, draw: Draw, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three scenes with a task each. The samples of the first one tell how large the others are."""
    job = plates_job(tmp_path, tmp_path / "out")
    for name in ("q.gltf", "r.gltf"):
        shutil.copy(tmp_path / "plates" / "p.gltf", tmp_path / "plates" / name)
    job = job_of(tmp_path / "plates", tmp_path / "out", orbit=0, settings=ALL, cameras=CameraFile(VIEWS))
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=1000))
    with pytest.raises(DatasetError, match=r"0.0 GB more, and 0.0 GB"):
        draw(job)
    monkeypatch.undo()
    assert draw(job).finished == 9
