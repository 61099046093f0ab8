"""Group commit: one transaction stores all changes since the last one, on a thread for commits only.

Changes during a transaction are stored by the next one. A transaction writes the differences between the newest state
and the stored state, so its cost does not depend on the number of edits.
"""

from __future__ import annotations

import asyncio
import sqlite3
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol

import structlog

from gateway.runtime.state.config import StateConfig
from gateway.runtime.state.database import Database, reason_of

_log = structlog.get_logger("gateway.state")

OnStored = Callable[[str], None]
"""Callback on the event loop. Its argument is the reason why the changes could not be stored, empty if they are."""


class Store(Protocol):
    """A state that is stored in the database."""

    def capture(self) -> Any:
        """Return the current state. Called on the event loop; must be fast."""

    def write(self, connection: sqlite3.Connection, captured: Any) -> bool:
        """Write a captured state within a transaction; return False if it is already stored.

        Called on the commit thread.
        """

    def committed(self, captured: Any) -> None:
        """Note that the transaction with this state succeeded. Called on the commit thread."""


@dataclass(slots=True)
class CommitStats:
    """Counters and durations of transactions since start."""

    commits: int = 0
    """Number of transactions that wrote something."""
    failed: int = 0
    """Number of failed transactions."""
    last_commit_seconds: float = 0.0
    longest_commit_seconds: float = 0.0


class GroupCommit:
    """Commits the states of all stores. Runs on the event loop, except ``_commit``, which runs on the commit thread."""

    def __init__(self, database: Database, config: StateConfig) -> None:
        self._database = database
        self._config = config
        self._stores: list[Store] = []
        self._waiting: list[tuple[OnStored, int]] = []
        self._requested = asyncio.Event()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="state")
        self._task: asyncio.Task[None] | None = None
        self.waiting_bytes = 0
        """Bytes of responses that wait for a commit."""
        self.problem = ""
        """Reason why the last transaction failed; empty if it succeeded."""
        self.on_problem: Callable[[str], None] = lambda problem: None
        """Called on the event loop when ``problem`` changes."""
        self.stats = CommitStats()

    def add(self, store: Store) -> None:
        """Include this store in all further transactions."""
        self._stores.append(store)

    def start(self) -> None:
        """Start to commit on the running event loop."""
        self._task = asyncio.get_running_loop().create_task(self._run(), name="state commits")

    @property
    def full(self) -> bool:
        """True while more than ``max_waiting_bytes`` wait, so that new requests should be rejected."""
        return self.waiting_bytes > self._config.max_waiting_bytes

    def call_when_stored(self, on_stored: OnStored, nbytes: int = 0) -> None:
        """Commit all changes so far, then call ``on_stored``. Callbacks run in the order of these calls.

        Args:
            nbytes: Bytes that the caller holds until the callback.
        """
        self._waiting.append((on_stored, nbytes))
        self.waiting_bytes += nbytes
        self._requested.set()

    async def wait_until_stored(self) -> str:
        """Commit all changes so far; return an empty string, or the reason why they could not be stored."""
        future: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self.call_when_stored(lambda problem: None if future.done() else future.set_result(problem))
        return await future

    async def close(self) -> str:
        """Commit the last changes and end the thread; return an empty string, or the reason why they are not stored."""
        if self._task is None:
            return ""
        problem = await self.wait_until_stored()
        self._task.cancel()
        self._thread.shutdown()
        return problem

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            await self._requested.wait()
            self._requested.clear()
            waiting, self._waiting = self._waiting, []
            captured = [(store, store.capture()) for store in self._stores]
            problem = await loop.run_in_executor(self._thread, self._commit, captured)
            self._report(waiting, problem)

    def _commit(self, captured: list[tuple[Store, Any]]) -> str:
        """Write the captured states in one transaction; return an empty string, or the reason of a failure."""
        start_time = time.perf_counter()
        connection = self._database.connection
        try:
            connection.execute("BEGIN IMMEDIATE")
            has_written = [store.write(connection, state) for store, state in captured]
            if any(has_written):
                connection.execute("COMMIT")
                self.stats.commits += 1
            else:
                connection.execute("ROLLBACK")
            for store, state in captured:
                store.committed(state)
        except Exception as error:  # noqa: BLE001 - later transactions must still run
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            self.stats.failed += 1
            if isinstance(error, sqlite3.Error):
                return reason_of(error)
            if isinstance(error, OSError):
                return error.strerror or type(error).__name__  # without a path, for clients
            _log.exception("state commit failed")
            return f"internal error: {type(error).__name__}: {error}"
        self.stats.last_commit_seconds = seconds = time.perf_counter() - start_time
        self.stats.longest_commit_seconds = max(self.stats.longest_commit_seconds, seconds)
        return ""

    def _report(self, waiting: list[tuple[OnStored, int]], problem: str) -> None:
        """Report the result of a transaction to the log, to ``on_problem`` and to the waiting callbacks."""
        if problem != self.problem:
            if problem:
                _log.error("state cannot be written", reason=problem, path=str(self._database.path))
            else:
                _log.info("state is written again, nothing is missing", path=str(self._database.path))
            self.problem = problem
            self.on_problem(problem)
        for on_stored, nbytes in waiting:
            self.waiting_bytes -= nbytes
            try:
                on_stored(problem)
            except Exception:  # noqa: BLE001 - the remaining callbacks must run
                _log.exception("callback after a state commit failed")
