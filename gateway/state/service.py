"""The state of one gateway: the file, what is kept in it, and who waits for that."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from typing import Any

import structlog

from gateway.scene.live import LiveTree, Snapshot
from gateway.state.config import StateConfig
from gateway.state.database import Database
from gateway.state.errors import StateError
from gateway.state.group_commit import Journal
from gateway.state.parameter_store import ParameterStore, Settable

_log = structlog.get_logger("gateway.state")


class State:
    """Opened before everything else, closed after everything else."""

    def __init__(self, config: StateConfig) -> None:
        """Opens the file.

        Raises:
            StateError: it cannot be used; nothing in it was changed.
        """
        self._config = config
        self._database = Database(config.path, config.checkpoint_bytes)
        self.journal = Journal(self._database, config)
        self._nodes = 0
        self._lazy: asyncio.TimerHandle | None = None
        self._stop: Callable[[], None] = lambda: None

    def start(self) -> None:
        """Writes from now on, for the running event loop."""
        self.journal.start()

    def restore_tree(self, live: LiveTree, without: Iterable[str] = ()) -> None:
        """Puts the stored tree into ``live``; may take seconds, in any thread. ``keep_tree`` comes after it.

        Args:
            without: children of the root that are neither stored nor restored.

        Raises:
            StateError: what is stored cannot be read.
        """
        # Imported here: it loads what needs the kernels.
        from gateway.state.parts import DamagedError
        from gateway.state.tree_store import TreeStore

        store = TreeStore(live, without)
        try:
            store.restore(self._database.writer)
        except DamagedError as error:
            raise StateError(f"The state file {self._config.path} is damaged: {error}; it was left as it is.") from None
        self._nodes = store.restored
        self.journal.add(store)
        if self._nodes:
            _log.info("The tree is as it was", nodes=self._nodes, path=str(self._config.path))

    def keep_tree(self, live: LiveTree) -> None:
        """Stores edits that nobody waits for, too, a moment later."""
        loop = asyncio.get_running_loop()
        self._stop = live.listen(lambda snapshot: self._edited(loop, snapshot))

    def keep_parameters(self, camera: str, nodes: Callable[[], list[str]], parameters: Settable) -> None:
        """Sets the stored parameters, and keeps those of ``nodes`` from now on."""
        store = ParameterStore(camera, nodes, parameters)
        store.restore(self._database.keeper)
        self.journal.add(store)

    def status(self) -> dict[str, Any]:
        """Plain JSON values."""
        figures = self.journal.figures
        return {
            "restored_nodes": self._nodes,
            "commits": figures.commits,
            "failed_commits": figures.failed,
            "last_commit_ms": round(1e3 * figures.last_commit_seconds, 3),
            "longest_commit_ms": round(1e3 * figures.longest_commit_seconds, 3),
            "waiting_bytes": self.journal.waiting_bytes,
            "file_bytes": self._database.file_bytes(),
            "log_bytes": self._database.log_bytes(),
        }

    async def close(self) -> None:
        """Stores what is left and closes the file."""
        self._stop()
        if self._lazy is not None:
            self._lazy.cancel()
        problem = await self.journal.close()
        if problem:
            _log.error("The last edits could not be stored", reason=problem, path=str(self._config.path))
        await asyncio.to_thread(self._database.close)

    def _edited(self, loop: asyncio.AbstractEventLoop, _: Snapshot) -> None:
        if self._lazy is None:  # a race costs a second timer
            loop.call_soon_threadsafe(self._later, loop)

    def _later(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._lazy is None:
            self._lazy = loop.call_later(self._config.lazy_seconds, self._now)

    def _now(self) -> None:
        self._lazy = None
        self.journal.after(lambda problem: None)
