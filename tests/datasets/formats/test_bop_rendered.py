"""A glTF file, rendered, written as BOP and rendered again from its annotations by a ray caster."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from scenegate.datasets import Dataset
from tests.datasets.conftest import contents
from tests.datasets.formats.bop_reader import BopImage, read_bop
from tests.support.command import Ran, scenegate

transformations: Any = trimesh.transformations
pytestmark = pytest.mark.slow

LARGE = 2000
"""Pixels from which a mask is compared by IoU; smaller ones by their boundaries."""


@pytest.fixture(scope="module")
def poses(tmp_path_factory: pytest.TempPathFactory) -> dict[str, NDArray[np.float64]]:
    """Poses of the nodes in the world, Z up."""
    rng = np.random.default_rng(3)
    found = {}
    for k in range(6):
        X = np.asarray(transformations.quaternion_matrix(rng.normal(size=4)))
        X[:3, 3] = (*rng.uniform(-0.15, 0.15, 2), rng.uniform(0.0, 0.1))
        found[f"node-{k}"] = X
    return found


@pytest.fixture(scope="module")
def folder(poses: dict[str, NDArray[np.float64]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bop")
    shapes = {
        "brick": trimesh.creation.box((0.16, 0.1, 0.05)),
        "can": trimesh.creation.cylinder(0.05, 0.16, sections=24),
        "ball": trimesh.creation.icosphere(2, 0.06),
    }
    scene: Any = trimesh.Scene()
    for k, (node, X) in enumerate(poses.items()):
        name = list(shapes)[k % 3]
        if name in scene.geometry:
            scene.graph.update(node, geometry=name, matrix=X)
        else:
            scene.add_geometry(shapes[name], node, name, transform=X)
    scene.apply_transform(transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))  # glTF is Y up
    scene.export(folder / "pile.glb")
    done = render(folder)
    assert done.exit_code == 0, done.stderr
    return folder


def render(folder: Path) -> Ran:
    types = "color,depth,instance,amodal"
    command = ("render", str(folder / "pile.glb"), "-o", str(folder / "out"), "--type", types, "--format", "bop")
    # The second camera is so near that objects reach beyond the image.
    near = "eye=0.3,0.1,0.2;target=0.05,0.05,0;up=0,0,1;fovy=50"
    return scenegate(*command, "--width", "200", "--height", "150", "--camera", "fit", "--camera", near)


@pytest.fixture(scope="module")
def images(folder: Path) -> list[BopImage]:
    return read_bop(folder / "out" / "bop")


def test_masks_are_those_of_the_annotations(images: list[BopImage]) -> None:
    compared = 0
    for image in images:
        assert len(image.objects) >= 4
        for k, item in enumerate(image.objects):
            for mask, again in ((item.mask, np.isfinite(item.rendered)), (item.mask_visib, image.front == k)):
                differ = mask != again
                if mask.sum() >= LARGE:
                    assert (mask & again).sum() / (mask | again).sum() >= 0.99
                assert not (differ & ~boundary(mask)).any()
                compared += int(mask.sum() >= LARGE)
    assert compared >= 4
    assert any(item.info["px_count_all"] > item.mask.sum() for image in images for item in image.objects)


def test_poses_are_those_of_the_file(
    folder: Path, images: list[BopImage], poses: dict[str, NDArray[np.float64]]
) -> None:
    for sample, image in zip(Dataset(folder / "out"), images, strict=True):
        X_camera_world = pose_of(image.camera, "w2c")
        for record, item in zip(sample.objects, image.objects, strict=True):
            expected = X_camera_world @ poses[str(record.path[-1])]
            np.testing.assert_allclose(pose_of(item.gt, "m2c"), expected, atol=1e-6)


def test_the_same_command_writes_the_same_copy(folder: Path) -> None:
    before = contents(folder / "out" / "bop")
    again = render(folder)
    assert "2 of them from before, 0 rendered" in again.stderr
    assert "2 samples as bop, exported before" in again.stderr
    assert contents(folder / "out" / "bop") == before
    assert scenegate("dataset", "check", str(folder / "out")).exit_code == 0


def test_several_formats_classes_and_files_that_are_not_ours(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("pycocotools")
    classes = tmp_path / "classes.toml"
    classes.write_text("".join(f'[[class]]\nname = "{name}"\nmodel = "{name}"\n' for name in ("can", "cann", "mug")))
    formats = ("--format", "coco", "--format", "webdataset")
    size = ("--width", "64", "--height", "48", "--type", "color,instance")
    arguments = (str(folder / "pile.glb"), "-o", str(tmp_path / "out"), "--classes", str(classes))
    command = ("render", *arguments, *size, *formats)
    done = scenegate(*command)
    assert done.exit_code == 0, done.stderr
    assert "--classes: no image has an object of cann, mug\n" in done.stderr
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"coco", "webdataset"}
    (tmp_path / "out" / "coco" / "notes.txt").write_text("mine")
    done = scenegate(*command, "--orbit", "2")
    assert "coco is not as an export wrote it" in done.stderr
    assert "rendered in" not in done.stderr
    assert (tmp_path / "out" / "coco" / "notes.txt").read_text() == "mine"
    assert "--format 'x': must be one of bop" in scenegate(*command, "--format", "x").stderr


def test_types_that_are_missing_are_named_before_rendering(folder: Path) -> None:
    done = scenegate("render", str(folder / "pile.glb"), "-o", str(folder / "other"), "--format", "coco")
    assert done.exit_code == 1
    assert "the format coco needs instance images: render with --type color,instance" in done.stderr
    assert not (folder / "other").exists()


def pose_of(entry: dict[str, Any], name: str) -> NDArray[np.float64]:
    """A pose in an annotation; metres."""
    X = np.eye(4)
    X[:3, :3] = np.reshape(entry[f"cam_R_{name}"], (3, 3))
    X[:3, 3] = np.array(entry[f"cam_t_{name}"]) / 1000.0
    return X


def boundary(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels at most one pixel from the edge of a mask, on both sides."""
    padded = np.pad(mask, 1, mode="edge")
    height, width = mask.shape
    around = [padded[i : i + height, k : k + width] for i in range(3) for k in range(3)]
    return np.asarray(np.logical_or.reduce(around) & ~np.logical_and.reduce(around))
