"""Locking, migrations, and files that are not ours and stay unchanged."""

from __future__ import annotations

import os
import sqlite3
from pathlib import Path

import pytest

from gateway.runtime.state import database as module
from gateway.runtime.state.database import MIGRATIONS, Database, StateError
from tests.support.locks import refuse_locks


def made(path: Path) -> Path:
    Database(path).close()
    return path


def version(path: Path) -> int:
    connection = sqlite3.connect(path)
    try:
        return int(connection.execute("PRAGMA user_version").fetchone()[0])
    finally:
        connection.close()


def test_new_file_has_the_current_version_and_no_log(tmp_path: Path) -> None:
    path = made(tmp_path / "state")
    assert version(path) == len(MIGRATIONS)
    assert [entry.name for entry in tmp_path.iterdir()] == ["state"]


def test_accepts_an_empty_file(tmp_path: Path) -> None:
    path = tmp_path / "state"
    path.touch()
    assert version(made(path)) == len(MIGRATIONS)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"# a TOML file that somebody named by mistake\n", "is not a state of Scenegate"),
        (b"SQLite format 3\0", "is not a state of Scenegate"),
        (b"\0" * 4096, "is not a state of Scenegate"),
    ],
)
def test_rejects_foreign_files_unchanged(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "state"
    path.write_bytes(content)
    with pytest.raises(StateError, match=says):
        Database(path)
    assert path.read_bytes() == content
    assert [entry.name for entry in tmp_path.iterdir()] == ["state"]


def test_rejects_a_pipe(tmp_path: Path) -> None:
    path = tmp_path / "state"
    os.mkfifo(path)
    with pytest.raises(StateError, match="is not a regular file"):
        Database(path)


def test_rejects_databases_of_other_programs_unchanged(tmp_path: Path) -> None:
    path = tmp_path / "state"
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE theirs (it)")
    connection.close()
    content = path.read_bytes()
    with pytest.raises(StateError, match="a database of another program; it is unchanged"):
        Database(path)
    assert path.read_bytes() == content


def test_rejects_damaged_files_unchanged(tmp_path: Path) -> None:
    path = made(tmp_path / "state")
    content = bytearray(path.read_bytes())
    content[4096:] = b"\x5a" * (len(content) - 4096)
    path.write_bytes(content)
    with pytest.raises(StateError, match="damaged"):
        Database(path)
    assert path.read_bytes() == content


def test_rejects_newer_versions_unchanged(tmp_path: Path) -> None:
    path = made(tmp_path / "state")
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA user_version = 99")
    connection.close()
    with pytest.raises(StateError, match=r"newer Scenegate \(schema version 99"):
        Database(path)
    assert version(path) == 99


def test_older_versions_are_migrated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = made(tmp_path / "state")
    steps = (*MIGRATIONS, ("CREATE TABLE later (it)", "INSERT INTO later VALUES (7)"))
    monkeypatch.setattr(module, "MIGRATIONS", steps)
    database = Database(path)
    assert database.connection.execute("SELECT it FROM later").fetchall() == [(7,)]
    database.close()
    assert version(path) == len(steps)
    Database(path).close()


def test_failed_migration_is_rolled_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = made(tmp_path / "state")
    monkeypatch.setattr(module, "MIGRATIONS", (*MIGRATIONS, ("CREATE TABLE later (it)", "no SQL")))
    with pytest.raises(StateError, match="cannot be used: near"):
        Database(path)
    monkeypatch.undo()
    assert version(path) == len(MIGRATIONS)
    Database(path).close()


def test_rejects_a_file_in_use(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LOCK_SECONDS", 0.05)
    first = Database(tmp_path / "state")
    with pytest.raises(StateError, match="in use by another gateway"):
        Database(tmp_path / "state")
    first.close()
    Database(tmp_path / "state").close()


def test_without_locks_the_file_is_used_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = made(tmp_path / "state")
    refuse_locks(monkeypatch)
    other = sqlite3.connect(path)
    other.execute("BEGIN EXCLUSIVE")  # SQLite takes its locks by another call, which then fails, too
    database = Database(path)
    assert not database.is_locked
    database.connection.execute("CREATE TABLE later (it)")
    database.close()
    other.close()
    monkeypatch.undo()
    again = Database(path)
    assert again.is_locked
    again.connection.execute("SELECT it FROM later")
    again.close()
    assert [entry.name for entry in tmp_path.iterdir()] == ["state"]


def test_rejects_missing_folders_and_directories(tmp_path: Path) -> None:
    with pytest.raises(StateError, match="cannot be opened: No such file or directory"):
        Database(tmp_path / "nowhere" / "state")
    with pytest.raises(StateError, match="cannot be opened: Is a directory"):
        Database(tmp_path)
