"""The database file: locked by one process, checked, and with a count of its commits.

It uses a write-ahead log with ``synchronous = NORMAL``. A committed transaction survives the end of the process,
``kill -9`` included. It is not flushed to the disk at once, so a power failure or a kernel crash can lose the last
transactions; the file stays consistent.

SQLite reads a log up to its first damaged page and drops the rest in silence. The file ``PATH-commits`` therefore has
the number of the last commit, and an opened database with a smaller number has lost some.
"""

import contextlib
import errno
import os
import shutil
import sqlite3
import stat
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from gateway.runtime.file_lock import Lock, try_lock

CHECKPOINT_BYTES: Final = 16 << 20
"""Size of the write-ahead log at which a commit copies it into the database file."""
LOCK_SECONDS: Final = 2.0
"""Maximum seconds to wait until another gateway releases the file, so that a supervisor can restart a killed gateway
without a delay."""
_MAGIC: Final = b"SQLite format 3\0"
_APPLICATION_ID: Final = b"SCGT"
"""Bytes 68 to 71 of the file's header (sqlite.org/fileformat2.html, 1.3)."""
SCHEMA_VERSION: Final = 4

_SCHEMA: Final = f"""
BEGIN IMMEDIATE;
-- path is JSON. seq orders siblings. parts: digest of the geometry (part_codec.py), NULL if none. transform: NULL for
-- the identity, 56 bytes for a pose, 128 for a matrix (little-endian doubles).
CREATE TABLE tree_node (
    path TEXT PRIMARY KEY, seq INTEGER NOT NULL, parts BLOB, transform BLOB, visible INTEGER NOT NULL,
    opacity REAL NOT NULL
) WITHOUT ROWID;
INSERT INTO tree_node VALUES ('[]', 0, NULL, NULL, 1, 1);
-- digest is the SHA-256 of data. tree_use has the nodes whose geometry needs a blob.
CREATE TABLE tree_blob (digest BLOB PRIMARY KEY, data BLOB NOT NULL);
CREATE TABLE tree_use (path TEXT, digest BLOB, PRIMARY KEY (path, digest)) WITHOUT ROWID;
CREATE INDEX tree_use_digest ON tree_use (digest);
-- Parameters of the stereo cameras; value is JSON.
CREATE TABLE stereo_parameter (
    camera TEXT, node TEXT, name TEXT, value TEXT NOT NULL, PRIMARY KEY (camera, node, name)
) WITHOUT ROWID;
CREATE TABLE commits (number INTEGER NOT NULL);
INSERT INTO commits VALUES (0);
PRAGMA application_id = {int.from_bytes(_APPLICATION_ID, "big")};
PRAGMA user_version = {SCHEMA_VERSION};
COMMIT;
"""  # noqa: S608 - constants


class StateError(RuntimeError):
    """The state file cannot be used. The message is one sentence with the file's path; the file is unchanged."""


class Database:
    """An open database file. Its connection may be used from one thread at a time."""

    def __init__(self, path: Path) -> None:
        """Open the file, or create it; raise ``StateError`` if it cannot be used."""
        self.path = path
        self._log_path, self._count_path = (path.with_name(path.name + suffix) for suffix in ("-wal", "-commits"))
        self.loss = ""
        """Sentence about committed changes that could not be read; empty if there are none."""
        with contextlib.ExitStack() as undo, _state_errors(path):
            self._lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            undo.callback(os.close, self._lock)
            self.is_locked = _lock(path, self._lock)
            """False if the file system has no locks, so that nothing keeps a second gateway away."""
            is_new, confirmed = _is_new(path, self._lock), self._confirmed_commits()
            if is_new and confirmed:  # SQLite would delete the log
                self._report_loss(0, confirmed)
            self.connection = _connect(path, with_locks=self.is_locked)
            undo.callback(self.connection.close)
            _create_or_check(path, self.connection)
            self.connection.execute("PRAGMA journal_mode = WAL")
            (self._commits,) = self.connection.execute("SELECT number FROM commits").fetchone()
            if not is_new and self._commits < confirmed:
                self._report_loss(self._commits, confirmed)
            self._count = os.open(self._count_path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
            undo.callback(os.close, self._count)
            self._write_count()
            self._files = self._current_files()
            undo.pop_all()

    def transact(self, write: Callable[[sqlite3.Connection], bool]) -> bool:
        """Call ``write`` in a transaction; return its result, which is False if it has written nothing.

        Raises OSError if the file is not the opened one any more.
        """
        if self._current_files() != self._files:
            raise FileNotFoundError(errno.ENOENT, "the state file was deleted or replaced while Scenegate ran")
        with self.connection:
            self.connection.execute("BEGIN IMMEDIATE")
            if has_written := write(self.connection):
                self.connection.execute("UPDATE commits SET number = ?", (self._commits + 1,))
        if has_written:
            self._commits += 1
            with contextlib.suppress(OSError):  # its space is taken since it was opened
                self._write_count()
        return has_written

    def close(self) -> None:
        """Copy the write-ahead log into the file and close it; the log and the count are removed."""
        is_ours = self._current_files() == self._files
        with contextlib.suppress(sqlite3.Error):
            self.connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        # Closing any descriptor of the file releases SQLite's locks, so the descriptor of our lock is closed last.
        self.connection.close()
        os.close(self._count)
        if is_ours and not self._log_path.exists():
            self._count_path.unlink(missing_ok=True)
        os.close(self._lock)

    def nbytes(self) -> tuple[int, int]:
        """Return the sizes of the file and of its log."""
        sizes = [path.stat().st_size if path.exists() else 0 for path in (self.path, self._log_path)]
        return sizes[0], sizes[1]

    def _write_count(self) -> None:
        os.pwrite(self._count, b"%020d\n" % self._commits, 0)

    def _confirmed_commits(self) -> int:
        """Return the number of the last commit before an unclean end; 0 after a clean one."""
        try:
            return int(self._count_path.read_bytes()[:21])
        except (OSError, ValueError):
            return 0

    def _current_files(self) -> list[tuple[int, int] | None]:
        """Return device and inode of the file and its log as they are now; None for a missing one."""
        found = [path.stat() if path.exists() else None for path in (self.path, self._log_path)]
        return [status and (status.st_dev, status.st_ino) for status in found]

    def _report_loss(self, readable: int, confirmed: int) -> None:
        """Copy the file and its log to ``PATH.damaged-TIME`` before they are written to, and set ``loss``."""
        aside = self.path.with_name(f"{self.path.name}.damaged-{time.strftime('%Y%m%d-%H%M%S')}")
        # Closing another descriptor of the file would release SQLite's locks.
        with open(self._lock, "rb", closefd=False) as source, aside.open("wb") as target:
            shutil.copyfileobj(source, target)
        if self._log_path.exists():
            shutil.copyfile(self._log_path, aside.with_name(aside.name + "-wal"))
        self.loss = (
            f"{confirmed - readable} of {confirmed} commits of the state file {self.path} cannot be read: the file or "
            f"its log is damaged, cut or missing; a copy is kept as {aside.name}"
        )


def reason_of(error: sqlite3.Error | OSError) -> str:
    """Return the cause of an error of the database or its file, without a path."""
    return error.strerror or type(error).__name__ if isinstance(error, OSError) else str(error)


@contextlib.contextmanager
def _state_errors(path: Path) -> Iterator[None]:
    """Turn errors of SQLite and of files into ``StateError``."""
    try:
        yield
    except (sqlite3.Error, OSError) as error:
        raise StateError(f"The state file {path} cannot be used: {reason_of(error)}.") from None


def _lock(path: Path, descriptor: int) -> bool:
    """Take the lock, which only one gateway can hold; return False if the file system has no locks."""
    deadline = time.monotonic() + LOCK_SECONDS
    while (lock := try_lock(descriptor)) is Lock.TAKEN:
        if time.monotonic() >= deadline:
            raise StateError(f"The state file {path} is in use by another gateway.")
        time.sleep(0.02)
    return lock is Lock.HELD


def _is_new(path: Path, descriptor: int) -> bool:
    """Return True if the file is empty; raise ``StateError`` if it is not ours.

    Runs before SQLite opens the file, because SQLite would create a log even beside the file of another program.
    """
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        raise StateError(f"The state file {path} is not a regular file.")
    header = os.pread(descriptor, 72, 0)
    if header and (not header.startswith(_MAGIC) or header[68:] != _APPLICATION_ID):
        raise StateError(f"The state file {path} is not a state of Scenegate; it is unchanged.")
    return not header


def _connect(path: Path, *, with_locks: bool) -> sqlite3.Connection:
    uri = path.absolute().as_uri() + ("" if with_locks else "?vfs=unix-none")  # the latter asks for no locks
    connection = sqlite3.connect(uri, uri=True, isolation_level=None, check_same_thread=False)
    (page_bytes,) = connection.execute("PRAGMA page_size").fetchone()
    if not with_locks:  # which the write-ahead log needs otherwise
        connection.execute("PRAGMA locking_mode = EXCLUSIVE")
    for pragma in (
        "synchronous = NORMAL",
        f"wal_autocheckpoint = {max(1, CHECKPOINT_BYTES // page_bytes)}",
        f"journal_size_limit = {CHECKPOINT_BYTES}",  # otherwise the log never shrinks
        "temp_store = MEMORY",
        "busy_timeout = 5000",
    ):
        connection.execute(f"PRAGMA {pragma}")
    return connection


def _create_or_check(path: Path, connection: sqlite3.Connection) -> None:
    """Create the tables, in the file itself: it must be known as ours without its log. Or check the file."""
    (result,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if result != "ok":
        raise StateError(f"The state file {path} is damaged ({' '.join(str(result).split())}); it is unchanged.")
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if version == 0:  # new, or the process was killed while it created the tables
        connection.executescript(_SCHEMA)
    elif version != SCHEMA_VERSION:
        needs = f"this Scenegate reads {SCHEMA_VERSION}"
        raise StateError(f"The state file {path} has schema version {version}, {needs}; it is unchanged.")
