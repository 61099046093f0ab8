"""The database file: its tables; locked by one process, checked, and migrated to the current schema.

It uses a write-ahead log with ``synchronous = NORMAL``. A committed transaction survives the end of the process,
``kill -9`` included. It is not flushed to the disk at once, so a power failure or a kernel crash can lose the last
transactions; the file stays consistent.
"""

from __future__ import annotations

import contextlib
import os
import sqlite3
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from gateway.runtime.file_lock import Lock, try_lock

LOCK_SECONDS: Final = 2.0
"""Maximum seconds to wait until another gateway releases the file, so that a supervisor can restart a killed gateway
without a delay."""
_MAGIC: Final = b"SQLite format 3\0"
_HEADER_BYTES: Final = 100
_APPLICATION_ID_OFFSET: Final = 68
"""Offset of the application id in the header (sqlite.org/fileformat2.html, 1.3)."""
APPLICATION_ID: Final = 0x53434754
"""The bytes "SCGT" in the file's header."""

MIGRATIONS: Final[tuple[tuple[str, ...], ...]] = (
    (
        # The live tree. ``path``: see keys.py. ``seq`` orders siblings. ``parts``: NULL if no geometry was ever set.
        # ``transform``: NULL for the identity, 56 bytes for a pose, 128 for a matrix (little-endian doubles).
        """CREATE TABLE tree_node (
            path BLOB PRIMARY KEY, seq INTEGER NOT NULL, parts BLOB, transform BLOB, visible INTEGER NOT NULL
        ) WITHOUT ROWID""",
        "INSERT INTO tree_node VALUES (x'', 0, NULL, NULL, 1)",
        "CREATE INDEX tree_node_by_parts ON tree_node (parts) WHERE parts IS NOT NULL",
        # Geometry: see part_codec.py. ``digest`` is the SHA-256 of ``data``.
        "CREATE TABLE tree_parts (digest BLOB PRIMARY KEY, data BLOB NOT NULL)",
        "CREATE TABLE tree_blob (digest BLOB PRIMARY KEY, data BLOB NOT NULL)",
        "CREATE TABLE tree_use (parts BLOB NOT NULL, blob BLOB NOT NULL, PRIMARY KEY (parts, blob)) WITHOUT ROWID",
        "CREATE INDEX tree_use_by_blob ON tree_use (blob)",
        # Parameters of the stereo cameras; ``value`` is JSON.
        """CREATE TABLE stereo_parameter (
            camera TEXT NOT NULL, node TEXT NOT NULL, name TEXT NOT NULL, value TEXT NOT NULL,
            PRIMARY KEY (camera, node, name)
        ) WITHOUT ROWID""",
    ),
    ("ALTER TABLE tree_node ADD COLUMN opacity REAL NOT NULL DEFAULT 1",),
)
"""Statements of each migration. Migration number N, counted from 1, leads to schema version N."""
_REASONS: Final = {
    "SQLITE_FULL": "the disk is full",
    "SQLITE_READONLY": "it may not be written to",
    "SQLITE_CANTOPEN": "it cannot be opened",
    "SQLITE_CORRUPT": "it is damaged",
    "SQLITE_NOTADB": "it is damaged",
    "SQLITE_BUSY": "another program has locked it",
}
"""Causes by the beginning of SQLite's name of the error."""


class StateError(RuntimeError):
    """The state file cannot be used. The message is one sentence with the file's path; the file is unchanged."""


class Database:
    """An open database file. Its connection may be used from one thread at a time."""

    def __init__(self, path: Path, checkpoint_bytes: int = 16 << 20) -> None:
        """Open the file, or create it.

        Args:
            checkpoint_bytes: Size of the write-ahead log at which a commit copies it into the database file.

        Raises:
            StateError: The file belongs to another program, is damaged, has a newer schema, is in use or cannot be
                written.
        """
        self.path = path
        with contextlib.ExitStack() as undo:
            self._lock, lock = _lock_file(path)
            self.is_locked = lock is Lock.HELD
            """False if the file system has no locks, so that nothing keeps a second gateway away."""
            undo.callback(os.close, self._lock)
            is_new = _check_header(path, self._lock)
            with _state_errors(path):
                self.connection = _connect(path, checkpoint_bytes, with_locks=self.is_locked)
                undo.callback(self.connection.close)
                if not is_new:
                    (result,) = self.connection.execute("PRAGMA quick_check(1)").fetchone()
                    if result != "ok":
                        damage = " ".join(str(result).split())
                        raise StateError(f"The state file {path} is damaged ({damage}); it is unchanged.")
                _migrate(path, self.connection)
            undo.pop_all()

    def close(self) -> None:
        """Copy the write-ahead log into the file and close it; the log is removed."""
        with contextlib.suppress(sqlite3.Error):
            self.connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        # Closing any descriptor of the file releases SQLite's locks, so the descriptor of our lock is closed last.
        self.connection.close()
        os.close(self._lock)

    def log_bytes(self) -> int:
        """Return the size of the write-ahead log."""
        return _size(self.path.with_name(self.path.name + "-wal"))

    def file_bytes(self) -> int:
        """Return the size of the file without its log."""
        return _size(self.path)


def reason_of(error: sqlite3.Error) -> str:
    """Return the cause of a database error, worded as the end of a sentence."""
    name = getattr(error, "sqlite_errorname", "")
    for prefix, reason in _REASONS.items():
        if name.startswith(prefix):
            return reason
    return f"{error} ({name})" if name else str(error)


@contextlib.contextmanager
def _state_errors(path: Path) -> Iterator[None]:
    """Turn SQLite's errors into ``StateError``."""
    try:
        yield
    except sqlite3.Error as error:
        raise StateError(f"The state file {path} cannot be used: {reason_of(error)}.") from None


def _lock_file(path: Path) -> tuple[int, Lock]:
    """Return a descriptor of the file, and whether it holds the lock, which only one gateway can hold."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise StateError(f"The state file {path} cannot be opened: {error.strerror}.") from None
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise StateError(f"The state file {path} is not a regular file.")
    deadline = time.monotonic() + LOCK_SECONDS
    while (lock := try_lock(descriptor)) is Lock.TAKEN:
        if time.monotonic() >= deadline:
            os.close(descriptor)
            raise StateError(f"The state file {path} is in use by another gateway.")
        time.sleep(0.02)
    return descriptor, lock


def _check_header(path: Path, descriptor: int) -> bool:
    """Return True if the file is new.

    Runs before SQLite opens the file, because SQLite would create a log even beside the file of another program.
    """
    header = os.pread(descriptor, _HEADER_BYTES, 0)
    if not header:
        return True
    if not header.startswith(_MAGIC) or len(header) < _HEADER_BYTES:
        raise StateError(f"The state file {path} is not a state of Scenegate (not an SQLite file); it is unchanged.")
    application_id = header[_APPLICATION_ID_OFFSET : _APPLICATION_ID_OFFSET + 4]
    if int.from_bytes(application_id, "big") != APPLICATION_ID:
        raise StateError(f"The state file {path} is a database of another program; it is unchanged.")
    return False


def _connect(path: Path, checkpoint_bytes: int, *, with_locks: bool) -> sqlite3.Connection:
    uri = path.absolute().as_uri() + ("" if with_locks else "?vfs=unix-none")  # the latter asks for no locks
    connection = sqlite3.connect(uri, uri=True, isolation_level=None, check_same_thread=False)
    (page_bytes,) = connection.execute("PRAGMA page_size").fetchone()
    for pragma in (
        *(() if with_locks else ("locking_mode = EXCLUSIVE",)),  # the write-ahead log needs locks otherwise
        "synchronous = NORMAL",
        f"wal_autocheckpoint = {max(1, checkpoint_bytes // page_bytes)}",
        f"journal_size_limit = {checkpoint_bytes}",  # otherwise the log never shrinks
        "temp_store = MEMORY",
        "busy_timeout = 5000",
    ):
        connection.execute(f"PRAGMA {pragma}")
    return connection


def _migrate(path: Path, connection: sqlite3.Connection) -> None:
    """Run the migrations that the file lacks, each in one transaction with the update of its version number."""
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if version > len(MIGRATIONS):
        raise StateError(
            f"The state file {path} was written by a newer Scenegate (schema version {version}, this one reads up to "
            f"{len(MIGRATIONS)}); it is unchanged."
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
