"""The persistent state of a gateway: restores the tree and the parameters, and stores their changes.

One transaction, on a thread for commits only, stores all changes since the last one. It writes the differences between
the newest and the stored state, so its cost does not depend on the number of edits.
"""

import asyncio
import contextlib
import sqlite3
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final, Protocol

import structlog

from gateway.runtime.state.database import Database, StateError, reason_of
from scenegate.lcm.transport import MIB

_log = structlog.get_logger("gateway.state")

MAX_WAITING_BYTES: Final = 64 * MIB
"""Maximum bytes of responses that wait for a commit. Further requests are rejected before they change the tree."""
IDLE_COMMIT_SECONDS: Final = 1.0
"""Maximum time until an edit is stored that no client waits for."""

OnStored = Callable[[str], None]
"""Callback on the event loop. Its argument is the reason why the changes could not be stored, empty if they are."""


class Store(Protocol):
    """A part of the state. ``capture`` is called on the event loop, the others in other threads."""

    def restore(self, connection: sqlite3.Connection) -> Any:
        """Apply the stored state, and return it as ``capture`` does. Called once, before all other methods."""

    def capture(self) -> Any:
        """Return the current state; must be fast."""

    def write(self, connection: sqlite3.Connection, stored: Any, captured: Any) -> bool:
        """Write the differences between the stored and a captured state in a transaction; return False if none."""


class PersistentState:
    """The open state file. It is opened before all interfaces start and closed after they have stopped.

    Runs on the event loop, except ``add``, and ``_commit``, which runs on the commit thread.
    """

    def __init__(self, path: Path) -> None:
        """Open the file; raise ``StateError`` if it cannot be used."""
        self.database = Database(path)
        self._log = _log.bind(path=str(path))
        if not self.database.is_locked:
            self._log.warning("The file system of the state file has no locks: use it in one gateway only")
        if self.database.loss:
            _log.error(self.database.loss)
        self.waiting_bytes = 0
        """Bytes of responses that wait for a commit."""
        self.problem = ""
        """Reason why the last transaction failed; empty if it succeeded."""
        self.on_problem: Callable[[str], None] = lambda problem: None
        """Called on the event loop when ``problem`` changes."""
        self._stored: dict[Store, Any] = {}
        """The state in the file, by store."""
        self._waiting: list[tuple[OnStored, int]] = []
        self._requested = asyncio.Event()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="state")
        self._task: asyncio.Task[None] | None = None
        self._commits = self._failed_commits = 0
        self._last_seconds = self._longest_seconds = 0.0

    def add(self, store: Store) -> None:
        """Restore a store, and include it in all further transactions. Takes up to seconds; any thread may call it.

        Raises StateError if the stored state cannot be read.
        """
        try:
            self._stored[store] = store.restore(self.database.connection)
        except MemoryError:
            raise
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            raise StateError(f"The state file {self.database.path} is damaged ({reason}); it is unchanged.") from error

    def start(self) -> None:
        """Start to commit on the running event loop."""
        self._task = asyncio.get_running_loop().create_task(self._run(), name="state commits")

    @property
    def full(self) -> bool:
        """True while more than ``MAX_WAITING_BYTES`` wait, so that new requests should be rejected."""
        return self.waiting_bytes > MAX_WAITING_BYTES

    def call_when_stored(self, on_stored: OnStored, nbytes: int = 0) -> None:
        """Commit all changes so far, then call ``on_stored``. Callbacks run in the order of these calls.

        ``nbytes``: bytes that the caller holds until the callback.
        """
        self._waiting.append((on_stored, nbytes))
        self.waiting_bytes += nbytes
        self._requested.set()

    async def wait_until_stored(self) -> str:
        """Commit all changes so far; return an empty string, or the reason why they could not be stored."""
        future: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self.call_when_stored(lambda problem: None if future.done() else future.set_result(problem))
        return await future

    def status(self) -> dict[str, Any]:
        """Return figures for health and metrics as plain JSON values."""
        file_bytes, log_bytes = self.database.nbytes()
        return {
            "commits": self._commits,
            "failed_commits": self._failed_commits,
            "last_commit_ms": round(1e3 * self._last_seconds, 3),
            "longest_commit_ms": round(1e3 * self._longest_seconds, 3),
            "waiting_bytes": self.waiting_bytes,
            "file_bytes": file_bytes,
            "log_bytes": log_bytes,
        }

    async def close(self) -> None:
        """Store the last changes and close the file."""
        if self._task is not None:
            if problem := await self.wait_until_stored():
                self._log.error("last edits could not be stored", reason=problem)
            self._task.cancel()
        self._thread.shutdown()
        await asyncio.to_thread(self.database.close)

    async def _run(self) -> None:
        """Commit when a caller waits, and every ``IDLE_COMMIT_SECONDS``."""
        while True:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._requested.wait(), IDLE_COMMIT_SECONDS)
            self._requested.clear()
            waiting, self._waiting = self._waiting, []
            captured = {store: store.capture() for store in self._stored}
            problem = await asyncio.get_running_loop().run_in_executor(self._thread, self._commit, captured)
            self._report(waiting, problem)

    def _commit(self, captured: dict[Store, Any]) -> str:
        """Write the captured states in one transaction; return an empty string, or the reason of a failure."""
        begin = time.perf_counter()
        try:
            self._commits += self.database.transact(
                lambda database: sum(each.write(database, self._stored[each], captured[each]) for each in captured) > 0
            )
        except Exception as error:  # noqa: BLE001 - later transactions must still run
            self._failed_commits += 1
            if isinstance(error, (sqlite3.Error, OSError)):
                return reason_of(error)  # without a path, for clients
            _log.exception("state commit failed")
            return f"internal error: {type(error).__name__}: {error}"
        self._stored |= captured
        self._last_seconds = time.perf_counter() - begin
        self._longest_seconds = max(self._longest_seconds, self._last_seconds)
        return ""

    def _report(self, waiting: list[tuple[OnStored, int]], problem: str) -> None:
        """Report the result of a transaction to the log, to ``on_problem`` and to the waiting callbacks."""
        if problem != self.problem:
            if problem:
                self._log.error("state cannot be written", reason=problem)
            else:
                self._log.info("state is written again, nothing is missing")
            self.problem = problem
            self.on_problem(problem)
        for on_stored, nbytes in waiting:
            self.waiting_bytes -= nbytes
            try:
                on_stored(problem)
            except Exception:  # noqa: BLE001 - the remaining callbacks must run
                _log.exception("callback after a state commit failed")
