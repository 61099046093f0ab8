"""What all formats have in common: determinism, errors, and a folder that is complete or missing."""

import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from PIL import Image

from gateway.datasets.check import check_dataset
from scenegate.datasets import Dataset, RecordError, manifest
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


def test_a_folder_with_files_is_left_alone(analytic: Dataset, dest: Path) -> None:
    dest.mkdir()
    (dest / "mine").write_text("x")
    with pytest.raises(ExportError, match=r"dest .*not empty"):
        export(analytic, dest, "bop")
    assert contents(dest) == {"mine": b"x"}


def test_what_a_killed_export_left_is_removed(analytic: Dataset, tmp_path: Path) -> None:
    left = tmp_path / ".dest.scenegate-export"
    left.mkdir()
    (left / "half").write_text("x")
    export(analytic, tmp_path / "dest", "bop")
    assert [path.name for path in tmp_path.iterdir()] == ["dest"]
    assert not (tmp_path / "dest" / "half").exists()


def add_file(dest: Path) -> None:
    (dest / "mine").write_text("x")


def edit_models(dest: Path) -> None:
    path = dest / "models" / "models_info.json"
    path.write_text(path.read_text().replace("1", "2"))  # of the same size


def remove_file(dest: Path) -> None:
    (dest / "camera.json").unlink()


def remove_record(dest: Path) -> None:
    (dest / "export.json").unlink()


@pytest.mark.parametrize("change", [add_file, edit_models, remove_file, remove_record])
def test_only_what_an_export_wrote_is_replaced(tmp_path: Path, change: Callable[[Path], None]) -> None:
    dataset = Dataset(write_dataset(tmp_path / "out"))
    dest = tmp_path / "out" / "bop"
    assert export(dataset, dest, "bop", replace=True)
    before = contents(dest)
    assert not export(dataset, dest, "bop", replace=True)
    assert contents(dest) == before
    path = dataset.folder / "manifest.jsonl"
    path.write_text(path.read_text().replace('"pile/view-1"', '"pile/x"'))
    dataset = Dataset(dataset.folder)
    (dest / "train_pbr" / "000000" / "link").symlink_to(dest)
    with pytest.raises(ExportError, match="files were added, changed or removed"):
        export(dataset, dest, "bop", replace=True)
    (dest / "train_pbr" / "000000" / "link").unlink()
    assert export(dataset, dest, "bop", replace=True)
    change(dest)
    before = contents(dest)
    with pytest.raises(ExportError, match="bop is not as an export wrote it"):
        export(dataset, dest, "bop", replace=True)
    assert contents(dest) == before


def test_an_export_of_another_format_is_replaced(tmp_path: Path) -> None:
    pytest.importorskip("pycocotools")
    dataset = Dataset(write_dataset(tmp_path / "out"))
    export(dataset, tmp_path / "dest", "bop")
    assert export(dataset, tmp_path / "dest", "coco", replace=True)
    assert (tmp_path / "dest" / "annotations.json").is_file()
    assert not export(dataset, tmp_path / "dest", "coco", replace=True)


def test_links_and_folders_of_the_dataset_are_refused(tmp_path: Path) -> None:
    dataset = Dataset(write_dataset(tmp_path / "out"))
    (tmp_path / "mine").mkdir()
    (tmp_path / "out" / "bop").symlink_to(tmp_path / "mine")
    with pytest.raises(ExportError, match="bop is a symbolic link"):
        export(dataset, tmp_path / "out" / "bop", "bop", replace=True)
    for folder in ("models/x", "scenes/pile/x", "bop2", "coco"):
        with pytest.raises(ExportError, match=r"where only .*/out/bop can be"):
            export(dataset, tmp_path / "out" / folder, "bop")
    assert list((tmp_path / "mine").iterdir()) == []


def test_a_failure_leaves_nothing(dataset: Path, tmp_path: Path) -> None:
    (dataset / "scenes" / "pile" / "view-1.instance.png").unlink()
    with pytest.raises(RecordError, match=r"view-1\.instance\.png: No such file"):
        export(Dataset(dataset), tmp_path / "dest", "bop")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_types_of_images_that_a_format_needs(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    draw(job_of(scenes / "deep", tmp_path / "out"))
    with pytest.raises(ExportError, match=r"bop .*--type color,depth,label,instance,amodal"):
        export(Dataset(tmp_path / "out"), tmp_path / "dest", "bop")


def test_a_missing_package_is_named(analytic: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    monkeypatch.delitem(sys.modules, "scenegate.datasets.formats.hdf5_format", raising=False)
    with pytest.raises(ImportError, match=r"hdf5 .*'scenegate-client\[formats\]'"):
        export(analytic, tmp_path / "dest", "hdf5")


def test_an_image_outside_of_the_dataset_is_not_read(dataset: Path, tmp_path: Path) -> None:
    path = dataset / "manifest.jsonl"
    path.write_text(path.read_text().replace("scenes/pile/view-0.color.png", "../secret.png"))
    with pytest.raises(RecordError, match=r"'\.\./secret\.png' .*outside"):
        export(Dataset(dataset), tmp_path / "dest", "coco")


@pytest.mark.parametrize("path", ["scenes/pile/view-0.color.png", "scenes/pile", "models/block.ply", "models"])
def test_nothing_behind_links_is_exported(dataset: Path, tmp_path: Path, path: str) -> None:
    (dataset / path).rename(tmp_path / "secret")
    (dataset / path).symlink_to(tmp_path / "secret")
    with pytest.raises(RecordError, match=r"outside .*symbolic link"):
        export(Dataset(dataset), tmp_path / "dest", "bop")
    assert any("outside" in problem or "missing" in problem for problem in check_dataset(dataset, 1).problems)


def test_a_scene_outside_of_the_dataset_is_not_read(dataset: Path, tmp_path: Path) -> None:
    (dataset / "scenes" / "pile").rename(tmp_path / "pile")
    for name in ("../../pile", "a\0b"):
        with pytest.raises(RecordError, match="lies outside of the dataset"):
            Dataset(dataset).scene(name)


@pytest.mark.parametrize("name", ["bop", "coco"])
@pytest.mark.parametrize("images", [{}, {"depth": manifest.ImageFile("x", "", 0)}])
def test_samples_without_color(
    dataset: Path, tmp_path: Path, name: FormatName, images: dict[str, manifest.ImageFile]
) -> None:
    path = dataset / "manifest.jsonl"
    records = list(manifest.read_lines(path, manifest.SampleRecord))
    records[0] = msgspec.structs.replace(records[0], images=images)
    path.write_bytes(b"".join(manifest.encode(record) + b"\n" for record in records))
    with pytest.raises(RecordError, match="pile/view-0 has no color image, only"):
        export(Dataset(dataset), tmp_path / "dest", name)


@pytest.mark.parametrize("image_type", ["color", "instance", "depth"])
def test_images_of_another_size_are_refused(dataset: Path, tmp_path: Path, image_type: str) -> None:
    path = next((dataset / "scenes" / "pile").glob(f"view-0.{image_type}.*"))
    Image.new("L", (5000, 4000)).save(path)
    with pytest.raises(RecordError, match=f"view-0.{image_type}.*: 5000x4000 pixels, the camera has 64x48"):
        export(Dataset(dataset), tmp_path / "dest", "bop")


def test_the_command(dataset: Path, tmp_path: Path) -> None:
    ran = scenegate("dataset", "export", str(dataset), str(tmp_path / "bop"), "--format", "bop")
    assert ran.exit_code == 0, ran.stderr
    assert "3 samples as bop" in ran.stderr
    assert (tmp_path / "bop" / "train_pbr" / "000001" / "rgb" / "000000.png").is_file()
    again = scenegate("dataset", "export", str(dataset), str(tmp_path / "bop"), "--format", "bop")
    assert again.exit_code == 1
    assert "not empty" in again.stderr
