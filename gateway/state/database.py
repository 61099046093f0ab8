"""The file: opened by one process at a time, told apart from others' files, brought to this version's tables.

Write-ahead log with ``synchronous = NORMAL``: what was committed survives the end of the process, however sudden. It is
not forced to the disk, so that a power failure or a crash of the kernel can take the last moments with it; the file
itself stays whole.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import sqlite3
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from gateway.state.errors import StateError
from gateway.state.schema import APPLICATION_ID, MIGRATIONS

LOCK_SECONDS: Final = 2.0
"""For a gateway that is being killed to be gone, when whoever watches over it starts the next one at once."""
_MAGIC: Final = b"SQLite format 3\0"
_HEADER_BYTES: Final = 100
_ID_AT: Final = 68
"""Of the application id in the header (sqlite.org/fileformat2.html, 1.3)."""
_REASONS: Final = {
    "SQLITE_FULL": "the disk is full",
    "SQLITE_READONLY": "it may not be written to",
    "SQLITE_CANTOPEN": "it cannot be opened",
    "SQLITE_CORRUPT": "it is damaged",
    "SQLITE_NOTADB": "it is damaged",
    "SQLITE_BUSY": "another program has locked it",
}


class Database:
    """Two connections to one file: ``writer`` for the journal's thread, ``keeper`` for checkpoints beside it."""

    def __init__(self, path: Path, log_bytes: int = 16 << 20) -> None:
        """Opens or creates the file.

        Args:
            log_bytes: the write-ahead log is cut to it when all of it is in the file.

        Raises:
            StateError: it is somebody else's, damaged, of a newer version, in use, or cannot be written.
        """
        self.path = path
        self._lock = -1
        with contextlib.ExitStack() as undo:
            self._lock = _locked(path)
            undo.callback(os.close, self._lock)
            is_new = _recognise(path, self._lock)
            with _sentences(path):
                self.writer = _connect(path, log_bytes)
                undo.callback(self.writer.close)
                if not is_new:
                    _check(path, self.writer)
                _migrate(path, self.writer)
                self.keeper = _connect(path, log_bytes)
            undo.pop_all()

    def close(self) -> None:
        """Moves the log into the file, which is then all there is."""
        with contextlib.suppress(sqlite3.Error):
            self.keeper.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        # SQLite's locks end when any descriptor of the file is closed, so ours goes last.
        self.keeper.close()
        self.writer.close()
        os.close(self._lock)

    def log_bytes(self) -> int:
        """Of the write-ahead log."""
        return _size(self.path.with_name(self.path.name + "-wal"))

    def file_bytes(self) -> int:
        """Of the file without its log."""
        return _size(self.path)


def reason_of(error: sqlite3.Error) -> str:
    """Why something failed, as a sentence's end."""
    name = getattr(error, "sqlite_errorname", "")
    for known, reason in _REASONS.items():
        if name.startswith(known):
            return reason
    return f"{error} ({name})" if name else str(error)


@contextlib.contextmanager
def _sentences(path: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.Error as error:
        raise StateError(f"The state file {path} cannot be used: {reason_of(error)}.") from None


def _locked(path: Path) -> int:
    """A descriptor of the file that no other process has locked in the same way."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise StateError(f"The state file {path} cannot be opened: {error.strerror}.") from None
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise StateError(f"The state file {path} is no regular file.")
    end = time.monotonic() + LOCK_SECONDS
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            if time.monotonic() < end:
                time.sleep(0.02)
                continue
            os.close(descriptor)
            raise StateError(f"The state file {path} is in use by another gateway.") from None
        return descriptor


def _recognise(path: Path, descriptor: int) -> bool:
    """Whether the file is new. Looked at before SQLite, which would write its log beside a file of somebody else."""
    header = os.pread(descriptor, _HEADER_BYTES, 0)
    if not header:
        return True
    if not header.startswith(_MAGIC) or len(header) < _HEADER_BYTES:
        raise StateError(f"The state file {path} is no state of Scenegate (no SQLite file); it was left as it is.")
    if int.from_bytes(header[_ID_AT : _ID_AT + 4], "big") != APPLICATION_ID:
        raise StateError(f"The state file {path} is a database of another program; it was left as it is.")
    return False


def _connect(path: Path, log_bytes: int) -> sqlite3.Connection:
    connection = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    for pragma in (
        "synchronous = NORMAL",
        "wal_autocheckpoint = 0",
        f"journal_size_limit = {log_bytes}",  # else the log keeps the size of its largest moment
        "temp_store = MEMORY",
        "busy_timeout = 5000",
    ):
        connection.execute(f"PRAGMA {pragma}")
    return connection


def _check(path: Path, connection: sqlite3.Connection) -> None:
    (found,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if found != "ok":
        raise StateError(f"The state file {path} is damaged ({' '.join(str(found).split())}); it was left as it is.")


def _migrate(path: Path, connection: sqlite3.Connection) -> None:
    """Each step is one transaction with the new version in it, so that a crash leaves a whole step."""
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if version > len(MIGRATIONS):
        raise StateError(
            f"The state file {path} was written by a newer Scenegate (version {version} of its tables, this one knows "
            f"{len(MIGRATIONS)}); it was left as it is."
        )
    if version == 0:
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.execute("PRAGMA journal_mode = WAL")
    for number, statements in enumerate(MIGRATIONS[version:], version + 1):
        connection.execute("BEGIN IMMEDIATE")
        try:
            for statement in statements:
                connection.execute(statement)
            connection.execute(f"PRAGMA user_version = {number}")
        except BaseException:
            connection.execute("ROLLBACK")
            raise
        connection.execute("COMMIT")


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0
