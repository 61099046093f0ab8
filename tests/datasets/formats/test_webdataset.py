"""WebDataset, read by its own package."""

import gzip
import io
import tarfile
from pathlib import Path

import msgspec
import numpy as np
import pytest

from scenegate.datasets import Dataset
from scenegate.datasets.formats import export
from scenegate.datasets.manifest import SampleRecord
from tests.datasets.analytic import ASIDE, BOXES, HEIGHT, WIDTH, Box, write_dataset

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


def _sample_files(path: Path) -> dict[str, set[str]]:
    """Names of the files of each sample of a shard, in their order."""
    names: dict[str, set[str]] = {}
    with tarfile.open(path) as tar:
        for member in tar.getmembers():
            key, _, extension = member.name.partition(".")
            names.setdefault(key, set()).add(extension)
    return names


def test_the_first_samples_have_all_that_others_lack(tmp_path: Path) -> None:
    """Hugging Face's datasets takes the types of columns from the first five samples."""
    empty_scenes: dict[str, list[tuple[Box, ...]]] = {f"empty-{k}": [()] for k in range(6)}
    folder = write_dataset(tmp_path / "out", {**empty_scenes, "pile": [BOXES, ASIDE]})
    lines = [msgspec.json.decode(line) for line in (folder / "manifest.jsonl").read_bytes().splitlines()]
    for line in lines[:-1]:
        line["camera"]["far"] = None
    (folder / "manifest.jsonl").write_bytes(b"".join(msgspec.json.encode(line) + b"\n" for line in lines))
    export(Dataset(folder), tmp_path / "dest", "webdataset")
    assert list(_sample_files(tmp_path / "dest" / "shard-000000.tar"))[:3] == ["00000006", "00000007", "00000000"]


def test_all_samples_have_the_same_files(tmp_path: Path) -> None:
    """The last view of a scene has no flow: an array of NaN."""
    folder = write_dataset(tmp_path / "out")
    description = msgspec.json.decode((folder / "dataset.json").read_bytes())
    description["settings"]["types"].append("flow")
    (folder / "dataset.json").write_bytes(msgspec.json.encode(description))
    export(Dataset(folder), tmp_path / "dest", "webdataset")
    files = _sample_files(tmp_path / "dest" / "shard-000000.tar").values()
    arrays = {f"{name}.npy.gz" for name in ("depth", "instance", "class", "flow")}
    assert len(files) == 3
    assert all(names == {"json", "color.png", "amodal.json", *arrays} for names in files)
    with tarfile.open(tmp_path / "dest" / "shard-000000.tar") as tar:
        file = tar.extractfile("00000002.flow.npy.gz")
        assert file is not None
        flow = np.load(io.BytesIO(gzip.decompress(file.read())))
    assert flow.shape == (HEIGHT, WIDTH, 2)
    assert np.isnan(flow).all()


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
