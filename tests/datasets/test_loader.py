"""Datasets as data loaders use them: arrays in batches, transforms, processes."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from scenegate.datasets import Dataset, Sample
from tests.datasets.analytic import HEIGHT, WIDTH, write_dataset


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    return Dataset(write_dataset(tmp_path / "out"))


def red(sample: Sample) -> NDArray[np.uint8]:
    return sample.color[..., 0]


def test_transformed_samples_are_a_sequence(dataset: Dataset) -> None:
    reds = dataset.map(red)
    assert len(reds) == 3
    np.testing.assert_array_equal(reds[-1], dataset[2].color[..., 0])
    assert np.stack(reds[0:2]).shape == (2, HEIGHT, WIDTH)
    assert [image.shape for image in reds] == [(HEIGHT, WIDTH)] * 3
    with pytest.raises(IndexError):
        _ = reds[3]


def test_worker_processes_can_have_them(dataset: Dataset) -> None:
    again = pickle.loads(pickle.dumps(dataset.map(red)))
    np.testing.assert_array_equal(again[1], red(dataset[1]))
    assert [sample.id for sample in pickle.loads(pickle.dumps(dataset))] == [sample.id for sample in dataset]


def test_arrays_of_a_sample(dataset: Dataset) -> None:
    sample = dataset[0]
    arrays = sample.arrays()
    assert {"color", "depth", "instance", "class", "amodal", "K", "X_world_camera", "objects/path"} <= set(arrays)
    assert arrays["amodal"].shape == (2, HEIGHT, WIDTH)
    assert arrays["objects/box_visible"].tolist() == [list(record.box_visible or ()) for record in sample.objects]
    assert arrays["objects/path"].tolist() == ['["boxes",1]', '["boxes",2]']


def test_images_can_be_written_to(dataset: Dataset) -> None:
    """Tensors share their memory with arrays, and have to be writable."""
    sample = dataset[0]
    for name in ("color", "depth", "instance", "class_ids"):
        assert getattr(sample, name).flags.writeable
