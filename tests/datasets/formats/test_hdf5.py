"""HDF5, read by h5py."""

import errno
import shutil
from pathlib import Path

import numpy as np
import pytest

from scenegate.datasets import Dataset
from scenegate.datasets.formats import export
from tests.datasets.analytic import BOXES, write_dataset

h5py = pytest.importorskip("h5py", reason="h5py is in the extra formats")


def test_arrays_come_back(analytic: Dataset, dest: Path) -> None:
    export(analytic, dest, "hdf5")
    with h5py.File(dest / "samples.hdf5") as file:
        assert file.attrs["classes"] == '{"1":"brick","2":"plate"}'
        for sample in analytic:
            group = file[sample.id]
            for name in ("color", "depth", "instance"):
                np.testing.assert_array_equal(group[name][:], getattr(sample, name))
            np.testing.assert_array_equal(group["class"][:], sample.class_ids)
            np.testing.assert_array_equal(group["K"][:], sample.K)
            for k, record in enumerate(sample.objects):
                np.testing.assert_array_equal(group["amodal"][k], sample.amodal_mask(record.instance))
                np.testing.assert_array_equal(group["objects/X_camera_object"][k], record.X_camera_object)
                np.testing.assert_array_equal(group["objects/box_visible"][k], record.box_visible)
                assert group["objects/model"].asstr()[k] == record.model


def test_samples_without_objects_have_the_same_fields(tmp_path: Path) -> None:
    export(Dataset(write_dataset(tmp_path / "out", {"pile": [(), BOXES]})), tmp_path / "dest", "hdf5")
    with h5py.File(tmp_path / "dest" / "samples.hdf5") as file:
        empty, full = file["pile/view-0"], file["pile/view-1"]
        assert set(empty["objects"]) == set(full["objects"])
        pairs = [
            (empty["amodal"], full["amodal"]),
            *((empty["objects"][name], each) for name, each in full["objects"].items()),
        ]
        for none, some in pairs:
            assert none.shape == (0, *some.shape[1:])
            assert none.dtype == some.dtype


def test_a_disk_that_would_be_full_is_an_error(analytic: Dataset, dest: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """HDF5 ends the process with a segmentation fault if it cannot write."""
    usage = shutil.disk_usage(dest.parent)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage._replace(free=1 << 20))
    with pytest.raises(OSError, match="No space left") as refused:
        export(analytic, dest, "hdf5")
    assert (refused.value.errno, refused.value.filename) == (errno.ENOSPC, str(dest))
    assert not any(dest.parent.glob(f"*{dest.name}*"))


def test_no_object_has_a_time(analytic: Dataset, dest: Path) -> None:
    export(analytic, dest, "hdf5")
    times: dict[str, int] = {}
    with h5py.File(dest / "samples.hdf5") as file:
        file.visititems(lambda name, each: times.update({name: h5py.h5o.get_info(each.id).mtime}))
    assert {"K", "objects"} <= {name.rpartition("/")[2] for name in times}
    assert set(times.values()) == {0}
