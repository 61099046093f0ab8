"""WebDataset, read by its own package."""

from __future__ import annotations

import tarfile
from pathlib import Path

import msgspec
import numpy as np
import pytest

from scenegate.datasets import Dataset
from scenegate.datasets.formats import export
from scenegate.datasets.manifest import SampleRecord
from tests.datasets.analytic import HEIGHT, WIDTH, write_dataset

webdataset = pytest.importorskip("webdataset", reason="webdataset is in the extra formats")


@pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning"
)  # its reader leaves files to the collector
def test_samples_come_back(analytic: Dataset, dest: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from scenegate.datasets.formats import webdataset_format

    monkeypatch.setattr(webdataset_format, "SHARD_SAMPLES", 2)
    export(analytic, dest, "webdataset")
    assert sorted(path.name for path in dest.glob("*.tar")) == ["shard-000000.tar", "shard-000001.tar"]
    pipeline = webdataset.WebDataset(str(dest / "shard-{000000..000001}.tar"), shardshuffle=False).decode("rgb8")
    read = list(pipeline)
    assert len(read) == len(analytic)
    for sample, found in zip(analytic, read, strict=True):
        np.testing.assert_array_equal(found["color.png"], sample.color)
        record = msgspec.convert(found["json"], SampleRecord)
        assert [each.path for each in record.objects] == [tuple(map(str, each.path)) for each in sample.objects]
        assert msgspec.structs.replace(record, objects=sample.objects) == sample.record
        # The decoder of images would make 8-bit RGB of these.
        for name, pixels in (("depth", sample.depth), ("instance", sample.instance), ("class", sample.class_ids)):
            np.testing.assert_array_equal(found[f"{name}.npy.gz"], pixels)
            assert found[f"{name}.npy.gz"].dtype == pixels.dtype
        assert [each["size"] for each in found["amodal.json"]] == [[HEIGHT, WIDTH]] * len(found["json"]["objects"])


def test_the_first_sample_has_objects(tmp_path: Path) -> None:
    """Hugging Face's datasets takes the types of columns from the first five samples."""
    folder = write_dataset(tmp_path / "out")
    first, *others = (folder / "manifest.jsonl").read_bytes().splitlines()
    empty = msgspec.json.encode({**msgspec.json.decode(first), "objects": []})
    (folder / "manifest.jsonl").write_bytes(b"".join(line + b"\n" for line in (empty, *others)))
    export(Dataset(folder), tmp_path / "dest", "webdataset")
    with tarfile.open(tmp_path / "dest" / "shard-000000.tar") as tar:
        keys = [member.name.removesuffix(".json") for member in tar.getmembers() if member.name.count(".") == 1]
    assert keys == ["00000001", "00000000", "00000002"]


def test_headers_have_no_times(analytic: Dataset, dest: Path) -> None:
    export(analytic, dest, "webdataset")
    with tarfile.open(dest / "shard-000000.tar") as tar:
        assert {member.mtime for member in tar.getmembers()} == {0}


def test_the_destination_is_never_a_command(analytic: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """webdataset runs what follows "pipe:" in the name of a file."""
    monkeypatch.chdir(tmp_path)
    export(analytic, Path("pipe:touch owned 100%"), "webdataset")
    assert not (tmp_path / "owned").exists()
    assert (tmp_path / "pipe:touch owned 100%" / "shard-000000.tar").is_file()
