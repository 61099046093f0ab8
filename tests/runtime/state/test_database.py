"""Locking, migrations, and files that are not ours and stay unchanged."""

import os
import re
import shutil
import sqlite3
from functools import partial
from pathlib import Path

import pytest

from gateway.runtime.state import database as module
from gateway.runtime.state.database import SCHEMA_VERSION, Database, StateError
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
    assert version(path) == SCHEMA_VERSION
    assert [entry.name for entry in tmp_path.iterdir()] == ["state"]


@pytest.mark.parametrize("statement", ["", f"PRAGMA application_id = {int.from_bytes(b'SCGT', 'big')}"])
def test_an_empty_file_or_an_interrupted_creation_is_completed(tmp_path: Path, statement: str) -> None:
    path = tmp_path / "state"
    path.touch()
    connection = sqlite3.connect(path)
    connection.execute(statement)
    connection.close()
    assert version(made(path)) == SCHEMA_VERSION


@pytest.mark.parametrize("content", [b"# a TOML file, named by mistake\n", b"SQLite format 3\0", b"\0" * 4096, b""])
def test_rejects_foreign_files_unchanged(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "state"
    if content:
        path.write_bytes(content)
    else:  # a database of another program
        connection = sqlite3.connect(path)
        connection.execute("CREATE TABLE theirs (it)")
        connection.close()
        content = path.read_bytes()
    with pytest.raises(StateError, match="is not a state of Scenegate"):
        Database(path)
    assert path.read_bytes() == content
    assert [entry.name for entry in tmp_path.iterdir()] == ["state"]


def test_rejects_damaged_files_unchanged(tmp_path: Path) -> None:
    path = made(tmp_path / "state")
    content = bytearray(path.read_bytes())
    content[4096:] = b"\x5a" * (len(content) - 4096)
    path.write_bytes(content)
    with pytest.raises(StateError, match="damaged"):
        Database(path)
    assert path.read_bytes() == content


def test_rejects_other_versions_unchanged(tmp_path: Path) -> None:
    path = made(tmp_path / "state")
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA user_version = 99")
    connection.close()
    with pytest.raises(StateError, match="schema version 99"):
        Database(path)
    assert version(path) == 99


def insert(connection: sqlite3.Connection, rows: list[tuple[str, str, str, str]]) -> bool:
    connection.executemany("INSERT OR REPLACE INTO stereo_parameter VALUES (?, ?, ?, ?)", rows)
    return True


def add(database: Database, count: int) -> None:
    for number in range(count):
        rows = [("0", str(number), str(row), "x" * 999) for row in range(8)]
        assert database.transact(partial(insert, rows=rows))


def killed(folder: Path, count: int) -> Path:
    """Return a copy of a database as ``kill -9`` leaves it after this number of commits."""
    database = Database(folder / "state")
    add(database, count)
    left = folder / "left"
    left.mkdir()
    for suffix in ("", "-wal", "-commits"):
        shutil.copy(folder / f"state{suffix}", left / f"state{suffix}")
    database.close()
    return left / "state"


def lost(path: Path) -> tuple[int, int]:
    """Open a database; return the number of commits that its warning calls lost, and of all."""
    before = {suffix: path.with_name(f"state{suffix}").read_bytes() for suffix in ("", "-wal") if path.exists()}
    database = Database(path)
    loss = database.loss
    database.close()
    if not loss:
        return 0, 0
    aside = path.with_name(loss.rpartition(" ")[2])
    for suffix, content in before.items():
        assert aside.with_name(aside.name + suffix).read_bytes() == content
    numbers = re.match(r"(\d+) of (\d+) commits", loss)
    assert Database(path).loss == "", "said once"
    return int(numbers[1]), int(numbers[2])


def test_a_killed_gateway_loses_nothing(tmp_path: Path) -> None:
    assert lost(killed(tmp_path, 20)) == (0, 0)


def test_a_cut_log_is_reported_and_kept(tmp_path: Path) -> None:
    path = killed(tmp_path, 20)
    log = path.with_name("state-wal")
    os.truncate(log, log.stat().st_size // 2)
    missing, commits = lost(path)
    assert 0 < missing < commits == 20


@pytest.mark.parametrize("offset", [0, 32])
def test_a_damaged_log_is_reported_and_kept(tmp_path: Path, offset: int) -> None:
    path = killed(tmp_path, 20)
    with path.with_name("state-wal").open("r+b") as log:
        log.seek(offset)
        log.write(bytes(64))
    assert lost(path) == (20, 20)


def test_an_empty_file_beside_a_count_is_reported(tmp_path: Path) -> None:
    path = killed(tmp_path, 20)
    path.write_bytes(b"")
    assert lost(path) == (20, 20)


@pytest.mark.parametrize("suffix", ["", "-wal"])
@pytest.mark.parametrize("is_replaced", [False, True])
def test_a_deleted_or_replaced_file_is_noticed(tmp_path: Path, suffix: str, is_replaced: bool) -> None:
    path = tmp_path / "state"
    database = Database(path)
    add(database, 1)
    file = path.with_name(path.name + suffix)
    file.rename(tmp_path / "moved")
    if is_replaced:
        file.write_bytes(b"")
    with pytest.raises(FileNotFoundError, match="deleted or replaced"):
        add(database, 1)
    (tmp_path / "moved").replace(file)
    add(database, 1)
    database.close()


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


def test_rejects_missing_folders_directories_and_pipes(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name, reason in (("nowhere/state", "No such file"), ("", "Is a directory"), ("pipe", "is not a regular file")):
        with pytest.raises(StateError, match=reason):
            Database(tmp_path / name)
