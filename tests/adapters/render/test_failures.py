"""The folder of failed requests: names, descriptions, limits."""

import json
from pathlib import Path
from typing import Any

import pytest

from gateway.adapters.render.failures import FailureStore


def stored(folder: Path) -> list[bytes]:
    return [path.read_bytes() for path in sorted(folder.iterdir()) if path.suffix != ".json"]


def store(failures: FailureStore, *body: bytes, request_id: str = "id") -> Path | None:
    return failures.store(body, "text/plain", 400, "no width", request_id)


def test_a_request_is_stored_with_its_description(tmp_path: Path) -> None:
    path: Any = store(FailureStore(tmp_path / "new", 2, 100), b"one ", b"two")
    assert path.read_bytes() == b"one two"
    description = json.loads(path.with_suffix(".json").read_text())
    names = ("status", "reason", "content_type", "request_id", "bytes")
    assert [description[name] for name in names] == [400, "no width", "text/plain", "id", 7]
    assert "-400-id." in path.name


@pytest.mark.parametrize(
    ("request_id", "name"),
    [("../../evil", "evil"), ("", "0"), ("../", "0"), ("a" * 40, "a" * 32), ("drake-7", "drake7")],
)
def test_names_have_letters_and_digits_of_the_id(tmp_path: Path, request_id: str, name: str) -> None:
    path: Any = store(FailureStore(tmp_path, 2, 100), b"x", request_id=request_id)
    assert path.stem.endswith(f"-400-{name}")
    assert path.parent == tmp_path


@pytest.mark.parametrize(("size", "kept"), [(100, True), (101, False)])
def test_a_body_larger_than_the_folder_is_not_stored(tmp_path: Path, size: int, kept: bool) -> None:
    assert (store(FailureStore(tmp_path, 2, 100), bytes(size)) is not None) == kept


def test_without_a_count_nothing_is_stored(tmp_path: Path) -> None:
    assert store(FailureStore(tmp_path, 0, 100), b"x") is None
    assert store(FailureStore(tmp_path, 1, 100), b"x") is not None


def test_the_oldest_are_deleted_beyond_the_count(tmp_path: Path) -> None:
    failures = FailureStore(tmp_path, 2, 100)
    for body in (b"1", b"2", b"3"):
        store(failures, body)
    assert stored(tmp_path) == [b"2", b"3"]
    assert len(list(tmp_path.iterdir())) == 4


def test_the_oldest_are_deleted_beyond_the_bytes(tmp_path: Path) -> None:
    failures = FailureStore(tmp_path, 10, 100)
    for size in (50, 50):
        store(failures, bytes(size))
    assert [len(body) for body in stored(tmp_path)] == [50, 50], "exactly the limit"
    store(failures, bytes(1))
    assert [len(body) for body in stored(tmp_path)] == [50, 1]
    store(failures, bytes(100))
    assert [len(body) for body in stored(tmp_path)] == [100]


def test_other_files_of_the_folder_stay(tmp_path: Path) -> None:
    failures = FailureStore(tmp_path, 1, 100)
    (tmp_path / "notes.txt").write_text("mine")
    first: Any = store(failures, b"1")
    first.with_suffix(".json").unlink()
    store(failures, b"2")
    assert not first.exists()
    assert (tmp_path / "notes.txt").read_text() == "mine"
