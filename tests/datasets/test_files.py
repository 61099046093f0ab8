"""Atomic writes, locks, digests and the journal."""

import hashlib
import io
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.datasets.errors import DatasetError
from gateway.datasets.files import locked, remove_temporary_files, temporary_name, write_atomically
from gateway.datasets.job import Job
from gateway.datasets.run import Journal
from gateway.datasets.scene_sources import Source, SourceKind
from gateway.datasets.views import View
from scenegate.datasets.manifest import CameraRecord, SampleRecord, encode, pose_rows
from scenegate.regular_files import sha256_of
from tests.datasets.conftest import SETTINGS


@pytest.mark.parametrize("data", [b"content", [b"con", b"tent"]])
def test_atomic_writes_replace_the_file(tmp_path: Path, data: bytes | list[bytes]) -> None:
    path = tmp_path / "new" / "file"
    for _ in range(2):
        write_atomically(path, data)
        assert path.read_bytes() == b"content"
    assert list(path.parent.iterdir()) == [path]


def test_an_error_leaves_the_old_file_and_no_temporary_one(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"old")

    def fill() -> None:
        with temporary_name(path) as temporary:
            temporary.write_bytes(b"half")
            assert temporary.name == f"file.{os.getpid()}.part"
            raise OSError("full")

    with pytest.raises(OSError, match="full"):
        fill()
    assert [each.read_bytes() for each in tmp_path.iterdir()] == [b"old"]


def test_only_temporary_files_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They may vanish meanwhile."""
    for name in ("a.7.part", "part", "b.png"):
        (tmp_path / name).write_bytes(b"")
    remove_temporary_files(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.png", "part"]
    monkeypatch.setattr(Path, "glob", lambda self, _: iter([self / "a.7.part"]))
    remove_temporary_files(tmp_path)


def test_a_lock_is_exclusive_and_released(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(DatasetError, match=f"another run works on {tmp_path}"), locked(tmp_path):
        pass
    with locked(tmp_path):
        pass


def test_digest_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"content")
    assert sha256_of(path) == hashlib.sha256(b"content").hexdigest()
    assert sha256_of(tmp_path / "missing") is None
    assert sha256_of(tmp_path) is None


def sample(view: str, digest: str = "0") -> SampleRecord:
    lens: Any = {"width": 1, "height": 1, "fx": 1.0, "fy": 1.0, "cx": 0.5, "cy": 0.5, "near": 0.1, "far": None}
    camera = CameraRecord(**lens, X_world_camera=pose_rows(np.eye(4)))
    names: Any = {"id": f"a.stl/{view}", "scene": "a.stl", "view": view, "view_description": "fit"}
    return SampleRecord(**names, scene_sha256=digest, camera=camera, images={})


def test_the_journal_yields_samples_in_the_order_of_the_job() -> None:
    views = tuple(View(name, "fit") for name in "abcd")
    job = Job((Source("a.stl", "/a.stl", SourceKind.FILE),), views, {}, SETTINGS, Path("/out"))
    file = io.BytesIO()
    journal = Journal(job, file)
    assert list(journal.lines_in_job_order()) == []
    for name in "dab":
        journal.add(sample(name))
    journal.add(sample("a", "1"))
    assert [journal.has_sample(number) for number in range(4)] == [True, True, False, True]
    assert journal.count == 3
    expected = [encode(each) + b"\n" for each in (sample("a", "1"), sample("b"), sample("d"))]
    assert list(journal.lines_in_job_order()) == expected
    journal.add(sample("c"))
    assert list(journal.lines_in_job_order()) == [expected[0], expected[1], encode(sample("c")) + b"\n", expected[2]]
    assert journal.count == 4
    assert len(file.getvalue().splitlines()) == 5
