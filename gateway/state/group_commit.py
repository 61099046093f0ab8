"""Group commit: what the loop did in one turn is one transaction of a thread of its own; then those who wait are told.

While that thread writes, further turns gather, and the next transaction takes them all: the newest state is compared
with what is stored, so that a flood costs what the tree looks like in the end, not how often it was edited.
"""

from __future__ import annotations

import asyncio
import sqlite3
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import structlog

from gateway.state.config import StateConfig
from gateway.state.database import Database, reason_of

_log = structlog.get_logger("gateway.state")

Done = Callable[[str], None]
"""Told on the event loop when everything before is stored: empty, or the reason why it is not."""


class Store(Protocol):
    """Something that is kept in the database."""

    def capture(self) -> Any:
        """On the event loop: what is there now; quick."""

    def write(self, connection: sqlite3.Connection, captured: Any) -> bool:
        """In the journal's thread, in a transaction: whether anything was to do."""

    def committed(self, captured: Any) -> None:
        """In the journal's thread: the transaction has succeeded."""


@dataclass(slots=True)
class Figures:
    """Since start."""

    commits: int = 0
    failed: int = 0
    last_commit_seconds: float = 0.0
    longest_commit_seconds: float = 0.0


class Journal:
    """Takes stores before ``start``; everything but its thread belongs to the event loop."""

    def __init__(self, database: Database, config: StateConfig) -> None:
        self._database = database
        self._config = config
        self._stores: list[Store] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        self._turn: list[tuple[Done, int]] = []
        self._condition = threading.Condition()
        self._captured: list[tuple[Store, Any]] | None = None
        self._handed: list[tuple[Done, int]] = []
        self._closing = False
        self._checkpointing = threading.Event()
        self._one_checkpoint = threading.Lock()
        """SQLite refuses a second one at a time, so that a log that is too long would stay so."""
        self._threads: list[threading.Thread] = []
        self.waiting_bytes = 0
        """As those who wait said."""
        self.problem = ""
        """Why the newest transaction failed; empty when it did not."""
        self.on_problem: Callable[[str], None] = lambda problem: None
        """Told on the event loop whenever ``problem`` changes."""
        self.figures = Figures()

    def add(self, store: Store) -> None:
        """``store`` is captured with all others from now on."""
        self._stores.append(store)

    def start(self) -> None:
        """Writes from now on, for the running event loop."""
        self._loop = asyncio.get_running_loop()
        for work in (self._write_all, self._checkpoint_all):
            thread = threading.Thread(target=work, name=f"state{work.__name__}", daemon=True)
            self._threads.append(thread)
            thread.start()

    @property
    def full(self) -> bool:
        """Whether so much waits that nothing new should be begun."""
        return self.waiting_bytes > self._config.waiting_answer_bytes

    def after(self, done: Done, size: int = 0) -> None:
        """``done`` is called once everything that happened so far is stored, or could not be; in the order given."""
        assert self._loop is not None
        if not self._turn:
            self._loop.call_soon(self._hand_over)
        self._turn.append((done, size))
        self.waiting_bytes += size

    async def stored(self) -> str:
        """Waits until everything that happened so far is stored: empty, or the reason why it is not."""
        future: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self.after(lambda problem: None if future.done() else future.set_result(problem))
        return await future

    async def close(self) -> str:
        """Stores what is left and ends the threads; the reason if it could not be stored."""
        if self._loop is None:
            return ""
        problem = await self.stored()
        with self._condition:
            self._closing = True
            self._condition.notify()
        self._checkpointing.set()
        for thread in self._threads:
            await asyncio.to_thread(thread.join)
        return problem

    def _hand_over(self) -> None:
        """At the end of the turn in which somebody began to wait."""
        turn, self._turn = self._turn, []
        captured = [(store, store.capture()) for store in self._stores]
        with self._condition:
            self._captured = captured
            self._handed += turn
            self._condition.notify()

    # --- the journal's thread

    def _write_all(self) -> None:
        while True:
            with self._condition:
                while self._captured is None and not self._closing:
                    self._condition.wait()
                captured, handed = self._captured, self._handed
                self._captured, self._handed = None, []
            if captured is None:
                return
            problem = self._commit(captured)
            assert self._loop is not None
            self._loop.call_soon_threadsafe(self._release, handed, problem)

    def _commit(self, captured: list[tuple[Store, Any]]) -> str:
        begin = time.perf_counter()
        connection = self._database.writer
        try:
            connection.execute("BEGIN IMMEDIATE")
            if sum([store.write(connection, state) for store, state in captured]):
                connection.execute("COMMIT")
                self.figures.commits += 1
            else:
                connection.execute("ROLLBACK")
            for store, state in captured:
                store.committed(state)
        except Exception as error:  # a defect must not end the thread  # noqa: BLE001
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            self.figures.failed += 1
            if isinstance(error, (sqlite3.Error, OSError)):
                return reason_of(error) if isinstance(error, sqlite3.Error) else str(error)
            _log.exception("The state could not be written")
            return f"internal error: {type(error).__name__}: {error}"
        self.figures.last_commit_seconds = seconds = time.perf_counter() - begin
        self.figures.longest_commit_seconds = max(self.figures.longest_commit_seconds, seconds)
        self._keep_log_short()
        return ""

    def _keep_log_short(self) -> None:
        size = self._database.log_bytes()
        if size > self._config.most_log_bytes:
            self._checkpoint("TRUNCATE", self._database.writer)
        elif size > self._config.checkpoint_bytes:
            self._checkpointing.set()

    # --- the thread for checkpoints

    def _checkpoint_all(self) -> None:
        while True:
            self._checkpointing.wait()
            self._checkpointing.clear()
            if self._closing:
                return
            self._checkpoint("PASSIVE", self._database.keeper)

    def _checkpoint(self, mode: str, connection: sqlite3.Connection) -> None:
        try:
            with self._one_checkpoint:
                connection.execute(f"PRAGMA wal_checkpoint({mode})").fetchall()
        except sqlite3.Error as error:  # the log has everything; the next time may be better
            _log.warning("The state's log could not be moved into the file", reason=reason_of(error))

    # --- on the loop again

    def _release(self, handed: list[tuple[Done, int]], problem: str) -> None:
        if problem != self.problem:
            if problem:
                _log.error("The state cannot be written", reason=problem, path=str(self._database.path))
            else:
                _log.info("The state is written again; nothing is missing", path=str(self._database.path))
            self.problem = problem
            self.on_problem(problem)
        for done, size in handed:
            self.waiting_bytes -= size
            try:
                done(problem)
            except Exception:  # noqa: BLE001 - the others wait as well
                _log.exception("An answer could not be released")
