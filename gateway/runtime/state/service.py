"""The persistent state of a gateway: opens the file, restores the tree and the parameters, stores their changes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import structlog

from gateway.runtime.state.config import StateConfig
from gateway.runtime.state.database import Database, StateError
from gateway.runtime.state.group_commit import GroupCommit
from gateway.runtime.state.parameter_store import Parameters, ParameterStore
from gateway.scene.tree.live import LiveTree

_log = structlog.get_logger("gateway.state")


class PersistentState:
    """The open state file. It is opened before all interfaces start and closed after they have stopped."""

    def __init__(self, config: StateConfig) -> None:
        """Open the file.

        Raises:
            StateError: The file cannot be used; it is unchanged.
        """
        self._config = config
        self.database = Database(config.path, config.checkpoint_bytes)
        if not self.database.is_locked:
            _log.warning(
                "The file system of the state file has no locks: use it in one gateway only", path=str(config.path)
            )
        self.commits = GroupCommit(self.database, config)
        self._restored_nodes = 0
        self._stop_listening: Callable[[], None] = lambda: None
        self._idle_commits: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Start to commit on the running event loop."""
        self.commits.start()

    def restore_tree(self, live: LiveTree, excluded: Iterable[str] = ()) -> None:
        """Put the stored tree into ``live`` and store the changes of ``live`` from now on.

        Takes up to seconds; may be called in any thread.

        Args:
            live: Empty tree.
            excluded: Children of the root that are neither stored nor restored.

        Raises:
            StateError: The stored tree cannot be read.
        """
        # Imported late: these modules load compiled kernels.
        from gateway.runtime.state.part_codec import DamagedError
        from gateway.runtime.state.tree_store import TreeStore

        store = TreeStore(live, excluded)
        try:
            store.restore(self.database.connection)
        except DamagedError as error:
            raise StateError(f"The state file {self._config.path} is damaged: {error}; it is unchanged.") from None
        self._restored_nodes = store.restored_nodes
        self.commits.add(store)
        if self._restored_nodes:
            _log.info("tree restored", nodes=self._restored_nodes, path=str(self._config.path))

    def store_idle_edits(self, live: LiveTree) -> None:
        """Store edits that no client waits for, too, ``idle_commit_seconds`` after the first of them."""
        loop, edited = asyncio.get_running_loop(), asyncio.Event()
        self._stop_listening = live.listen(partial(loop.call_soon_threadsafe, edited.set))
        self._idle_commits = loop.create_task(self._commit_idle_edits(edited), name="idle commits")

    def restore_parameters(self, camera: str, nodes: Callable[[], list[str]], parameters: Parameters) -> None:
        """Set a camera's stored parameters, and store the parameters of ``nodes()`` from now on."""
        store = ParameterStore(camera, nodes, parameters)
        store.restore(self.database.connection)
        self.commits.add(store)

    def status(self) -> dict[str, Any]:
        """Return figures for health and metrics as plain JSON values."""
        stats = self.commits.stats
        return {
            "restored_nodes": self._restored_nodes,
            "commits": stats.commits,
            "failed_commits": stats.failed,
            "last_commit_ms": round(1e3 * stats.last_commit_seconds, 3),
            "longest_commit_ms": round(1e3 * stats.longest_commit_seconds, 3),
            "waiting_bytes": self.commits.waiting_bytes,
            "file_bytes": self.database.file_bytes(),
            "log_bytes": self.database.log_bytes(),
        }

    async def close(self) -> None:
        """Store the last changes and close the file."""
        self._stop_listening()
        if self._idle_commits is not None:
            self._idle_commits.cancel()
        problem = await self.commits.close()
        if problem:
            _log.error("last edits could not be stored", reason=problem, path=str(self._config.path))
        await asyncio.to_thread(self.database.close)

    async def _commit_idle_edits(self, edited: asyncio.Event) -> None:
        while True:
            await edited.wait()
            await asyncio.sleep(self._config.idle_commit_seconds)
            edited.clear()
            self.commits.call_when_stored(lambda problem: None)
