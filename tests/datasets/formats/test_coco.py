"""COCO, read by pycocotools."""

from pathlib import Path

import numpy as np
import pytest

from scenegate.datasets import Dataset
from scenegate.datasets.formats import export

pytest.importorskip("pycocotools", reason="pycocotools is in the extra formats")


@pytest.fixture(scope="module")
def folder(analytic: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("coco") / "out"
    export(analytic, folder, "coco")
    return folder


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # pycocotools 2.0.11 under NumPy 2.4
def test_instances(analytic: Dataset, folder: Path) -> None:
    from pycocotools import mask as coco_mask
    from pycocotools.coco import COCO

    coco = COCO(folder / "annotations.json")
    assert [category["name"] for category in coco.loadCats(coco.getCatIds())] == ["brick", "plate"]
    assert len(coco.getImgIds()) == len(analytic)
    for index, sample in enumerate(analytic):
        (image,) = coco.loadImgs(index)
        assert (folder / "images" / image["file_name"]).read_bytes() == sample.file_bytes("color")
        annotations = coco.loadAnns(coco.getAnnIds(imgIds=index))
        assert len(annotations) == len(sample.objects)
        for annotation, record in zip(annotations, sample.objects, strict=True):
            mask = coco.annToMask(annotation).astype(bool)
            np.testing.assert_array_equal(mask, sample.instance == record.instance)
            rle = coco.annToRLE(annotation)
            np.testing.assert_array_equal(coco_mask.toBbox(rle), annotation["bbox"])
            assert coco_mask.area(rle) == annotation["area"]
            assert annotation["category_id"] == record.class_id
            assert annotation["iscrowd"] == 0


def test_keypoints_are_projected_corners(analytic: Dataset, folder: Path) -> None:
    from pycocotools.coco import COCO

    coco = COCO(folder / "annotations.json")
    (category,) = coco.loadCats(1)
    names = category["keypoints"]
    sample = analytic[0]
    hiding = sample.objects[1]
    for annotation, record in zip(coco.loadAnns(coco.getAnnIds(imgIds=0)), sample.objects, strict=True):
        points = np.reshape(annotation["keypoints"], (-1, 3))
        low, high = np.array(record.box_3d)
        corner = np.where([bool(int(digit)) for digit in names[4].removeprefix("corner_")], high, low)
        X = np.array(record.X_camera_object)
        u, v, w = sample.K @ (X[:3, :3] @ corner + X[:3, 3])
        # Keypoints count from the centre of the first pixel.
        np.testing.assert_allclose(points[4, :2], (u / w - 0.5, v / w - 0.5), atol=1e-3)
    first, second = coco.loadAnns(coco.getAnnIds(imgIds=0))
    flags = np.reshape(first["keypoints"], (-1, 3))[:, 2]
    places = np.reshape(first["keypoints"], (-1, 3))[:, :2]
    x, y, width, height = hiding.box_visible or (0, 0, 0, 0)
    behind = flags == 1
    assert behind.any()
    assert all(x <= u + 0.5 <= x + width and y <= v + 0.5 <= y + height for u, v in places[behind])
    outside = np.reshape(coco.loadAnns(3)[0]["keypoints"], (-1, 3))
    assert (outside[outside[:, 2] == 0] == 0).all()
    assert coco.loadAnns(3)[0]["num_keypoints"] == (outside[:, 2] > 0).sum() < 9
    edges = {tuple(edge) for edge in category["skeleton"]}
    assert len(edges) == 12
    assert second["num_keypoints"] == 9


def test_an_object_that_is_hidden_has_no_annotation(tmp_path: Path) -> None:
    from pycocotools.coco import COCO

    from tests.datasets.analytic import Box, pose, write_dataset

    above = Box(pose(-0.1, -0.1, 0.2), np.array((3.0, 3.0, 1.0)))
    below = Box(pose(-0.01, -0.01, 0.0), np.array((0.2, 0.2, 0.2)), 2)
    dataset = Dataset(write_dataset(tmp_path / "out", {"one": [(above, below)]}))
    assert dataset[0].objects[1].visible_pixels == 0
    export(dataset, tmp_path / "coco", "coco")
    coco = COCO(tmp_path / "coco" / "annotations.json")
    assert [annotation["category_id"] for annotation in coco.loadAnns(coco.getAnnIds())] == [1]
