"""BOP: what is written, by a reader of its own, and rendered again from its annotations."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from scenegate.datasets import Dataset, RecordError
from scenegate.datasets.formats import export
from scenegate.datasets.formats.bop_format import diameter
from scenegate.datasets.ply import read_ply
from tests.datasets.analytic import FOCAL, HEIGHT, WIDTH, write_dataset
from tests.datasets.formats.bop_reader import BopImage, read_bop


@pytest.fixture(scope="module")
def folder(analytic: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bop") / "out"
    export(analytic, folder, "bop")
    return folder


@pytest.fixture(scope="module")
def images(folder: Path) -> list[BopImage]:
    return read_bop(folder)


def test_rendering_the_annotations_again_gives_the_masks(images: list[BopImage]) -> None:
    for image in images:
        for k, item in enumerate(image.objects):
            np.testing.assert_array_equal(np.isfinite(item.rendered), item.mask)
            np.testing.assert_array_equal(image.front == k, item.mask_visib)


def test_depth_is_that_of_the_rendered_models(images: list[BopImage]) -> None:
    for image in images:
        rendered = np.min([item.rendered for item in image.objects], axis=0)
        seen = np.isfinite(rendered)
        np.testing.assert_array_equal(image.depth > 0.0, seen)
        assert image.camera["depth_scale"] == 0.1
        np.testing.assert_allclose(image.depth[seen], rendered[seen], atol=0.0501)


def test_poses_and_cameras(analytic: Dataset, images: list[BopImage]) -> None:
    for sample, image in zip(analytic, images, strict=True):
        np.testing.assert_array_equal(image.color, sample.color)
        # OpenCV's convention: the centre of the first pixel is (0, 0).
        K = np.array(((FOCAL, 0, WIDTH / 2 - 0.5), (0, FOCAL, HEIGHT / 2 - 0.5), (0, 0, 1)))
        np.testing.assert_allclose(np.reshape(image.camera["cam_K"], (3, 3)), K)
        R, t = np.reshape(image.camera["cam_R_w2c"], (3, 3)), np.array(image.camera["cam_t_w2c"])
        X = np.linalg.inv(sample.X_world_camera)
        np.testing.assert_allclose(R, X[:3, :3], atol=1e-12)
        np.testing.assert_allclose(t, 1000.0 * X[:3, 3], atol=1e-9)
        for record, item in zip(sample.objects, image.objects, strict=True):
            pose = np.linalg.inv(sample.X_world_camera) @ np.array(record.X_world_object)
            np.testing.assert_allclose(np.reshape(item.gt["cam_R_m2c"], (3, 3)), pose[:3, :3], atol=1e-12)
            np.testing.assert_allclose(item.gt["cam_t_m2c"], 1000.0 * pose[:3, 3], atol=1e-9)


def test_infos_are_counted_as_the_toolkit_counts(analytic: Dataset, images: list[BopImage]) -> None:
    for sample, image in zip(analytic, images, strict=True):
        for record, item in zip(sample.objects, image.objects, strict=True):
            rows, columns = item.mask_visib.nonzero()
            # The toolkit's width is the last column minus the first.
            expected = [columns.min(), rows.min(), np.ptp(columns), np.ptp(rows)]
            assert item.info["bbox_visib"] == expected
            assert item.info["px_count_visib"] == item.mask_visib.sum()
            assert item.info["px_count_valid"] == (item.mask & (image.depth > 0.0)).sum()
            assert item.info["px_count_all"] == record.amodal_pixels >= item.mask.sum()
            assert item.info["visib_fract"] == pytest.approx(item.info["px_count_visib"] / item.info["px_count_all"])
    truncated = images[1].objects[0]
    assert truncated.info["px_count_all"] > truncated.mask.sum()
    assert truncated.info["bbox_obj"][0] + truncated.info["bbox_obj"][2] >= WIDTH


def test_models_have_millimetres_and_scale(folder: Path) -> None:
    infos = json.loads((folder / "models" / "models_info.json").read_text())
    names = json.loads((folder / "dataset_info.json").read_text())["objects"]
    assert [names[key] for key in infos] == [
        {"model": "block", "scale": [1.0, 1.0, 1.0]},
        {"model": "block", "scale": [1.5, 1.0, 0.5]},
    ]
    for key, info in infos.items():
        mesh = trimesh.load_mesh(folder / "models" / f"obj_{int(key):06d}.ply", process=False)
        np.testing.assert_allclose(mesh.extents, [info[f"size_{axis}"] for axis in "xyz"], rtol=1e-6)
        np.testing.assert_allclose(mesh.bounds[0], [info[f"min_{axis}"] for axis in "xyz"], atol=1e-4)
        assert info["diameter"] == pytest.approx(np.linalg.norm(mesh.extents))
        assert mesh.volume == pytest.approx(np.prod(mesh.extents))  # faces point outwards
        np.testing.assert_allclose(mesh.extents, np.multiply((100.0, 80.0, 60.0), names[key]["scale"]), rtol=1e-6)


def test_a_mirrored_model_faces_outwards(tmp_path: Path) -> None:
    from tests.datasets.analytic import Box, pose

    mirrored = Box(pose(0.0, 0.0, 0.0), np.array((-1.0, 1.0, 1.0)))
    export(Dataset(write_dataset(tmp_path / "out", {"one": [(mirrored,)]})), tmp_path / "bop", "bop")
    mesh = trimesh.load_mesh(tmp_path / "bop" / "models" / "obj_000001.ply", process=False)
    assert mesh.volume > 0.0
    assert mesh.bounds[1, 0] <= 1e-6


@pytest.mark.parametrize("shape", ["ball", "cloud", "line"])
def test_the_diameter_is_that_of_all_pairs(shape: str) -> None:
    rng = np.random.default_rng(5)
    stretch = {"ball": (1.0, 1.0, 1.0), "cloud": (1.0, 2.0, 0.1), "line": (5.0, 0.0, 0.0)}[shape]
    points = rng.normal(size=(1500, 3)) * np.array(stretch)
    if shape == "ball":
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    distances = np.linalg.norm(points[:, None] - points[None], axis=-1)
    assert diameter(points) == pytest.approx(distances.max(), rel=1e-12)


def test_a_model_that_is_no_model(tmp_path: Path) -> None:
    path = tmp_path / "x.ply"
    with pytest.raises(RecordError, match="No such file"):
        read_ply(path)
    path.write_bytes(b"ply\nformat ascii 1.0\n")
    with pytest.raises(RecordError, match="not a binary PLY file"):
        read_ply(path)
    folder = write_dataset(tmp_path / "out")
    data = (folder / "models" / "block.ply").read_bytes()
    path.write_bytes(data[:-1])
    with pytest.raises(RecordError, match="cut off"):
        read_ply(path)
    path.write_bytes(data[:-4] + b"\x08\x00\x00\x00")
    with pytest.raises(RecordError, match="not a triangle of its vertices"):
        read_ply(path)


def test_a_model_outside_of_the_dataset_is_not_read(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "out")
    for path in folder.rglob("scene.json"):
        path.write_text(path.read_text().replace("models/block.ply", "../block.ply"))
    (tmp_path / "block.ply").write_bytes((folder / "models" / "block.ply").read_bytes())
    with pytest.raises(RecordError, match=r"'\.\./block\.ply' .*outside"):
        export(Dataset(folder), tmp_path / "bop", "bop")
