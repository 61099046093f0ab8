"""What all formats have in common: determinism, errors, and a folder that is complete or missing."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from scenegate.datasets import Dataset, RecordError
from scenegate.datasets.formats import FORMATS, ExportError, FormatName, export
from tests.datasets.analytic import write_dataset
from tests.datasets.conftest import Draw, contents, job_of
from tests.support.command import scenegate

PACKAGES = {"bop": "numpy", "coco": "pycocotools", "webdataset": "webdataset", "hdf5": "h5py"}


@pytest.mark.parametrize("name", FORMATS)
def test_two_exports_have_the_same_bytes(analytic: Dataset, tmp_path: Path, name: FormatName) -> None:
    pytest.importorskip(PACKAGES[name])
    done: list[int] = []
    export(analytic, tmp_path / "a", name, done.append)
    export(analytic, tmp_path / "b", name)
    assert contents(tmp_path / "a") == contents(tmp_path / "b") != {}
    assert done == [0, 1, 2, 3]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_a_folder_with_files_is_left_alone(analytic: Dataset, tmp_path: Path) -> None:
    (tmp_path / "dest").mkdir()
    (tmp_path / "dest" / "mine").write_text("x")
    with pytest.raises(ExportError, match="dest is there and not empty; name another folder"):
        export(analytic, tmp_path / "dest", "bop")
    assert contents(tmp_path / "dest") == {"mine": b"x"}


def test_what_a_killed_export_left_is_removed(analytic: Dataset, tmp_path: Path) -> None:
    left = tmp_path / ".dest.scenegate-export"
    left.mkdir()
    (left / "half").write_text("x")
    export(analytic, tmp_path / "dest", "bop")
    assert [path.name for path in tmp_path.iterdir()] == ["dest"]
    assert not (tmp_path / "dest" / "half").exists()
    (tmp_path / "dest" / "old").write_text("x")
    export(analytic, tmp_path / "dest", "bop", replace=True)
    assert not (tmp_path / "dest" / "old").exists()


def test_a_failure_leaves_nothing(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "out")
    (folder / "scenes" / "pile" / "view-1.instance.png").unlink()
    with pytest.raises(RecordError, match=r"view-1\.instance\.png: No such file"):
        export(Dataset(folder), tmp_path / "dest", "bop")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_types_of_images_that_a_format_needs(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    draw(job_of(scenes / "deep", tmp_path / "out"))
    with pytest.raises(
        ExportError, match=r"bop needs instance, amodal images: render with --type color,depth,label,instance,amodal"
    ):
        export(Dataset(tmp_path / "out"), tmp_path / "dest", "bop")


def test_a_missing_package_is_named(analytic: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    monkeypatch.delitem(sys.modules, "scenegate.datasets.formats.hdf5_format", raising=False)
    with pytest.raises(ImportError, match=r"format hdf5 needs pip install 'scenegate-client\[formats\]'"):
        export(analytic, tmp_path / "dest", "hdf5")


def test_an_image_outside_of_the_dataset_is_not_read(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "out")
    manifest = folder / "manifest.jsonl"
    manifest.write_text(manifest.read_text().replace("scenes/pile/view-0.color.png", "../secret.png"))
    with pytest.raises(RecordError, match=r"the color image '\.\./secret\.png' lies outside of the dataset"):
        export(Dataset(folder), tmp_path / "dest", "coco")


def test_the_command(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "out")
    ran = scenegate("dataset", "export", str(folder), str(tmp_path / "bop"), "--format", "bop")
    assert ran.exit_code == 0, ran.stderr
    assert "3 samples as bop" in ran.stderr
    assert (tmp_path / "bop" / "train_pbr" / "000001" / "rgb" / "000000.png").is_file()
    again = scenegate("dataset", "export", str(folder), str(tmp_path / "bop"), "--format", "bop")
    assert again.exit_code == 1
    assert "not empty" in again.stderr
