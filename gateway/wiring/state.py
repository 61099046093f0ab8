"""Connects the persistent state to the live tree; the stereo cameras' parameters are connected in ``wiring.stereo``."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Final

import structlog

from gateway.runtime.settings import Settings
from gateway.wiring.context import Context

if TYPE_CHECKING:
    from gateway.runtime.state.service import PersistentState

_log = structlog.get_logger("gateway.state")

STATE: Final = "state"


def open_state(settings: Settings) -> PersistentState | None:
    """Open the state file, if ``--state`` names one. Raises StateError if it cannot be used."""
    if settings.state is None:
        return None
    from gateway.runtime.state.service import PersistentState

    return PersistentState(settings.state)


async def restore_state(context: Context) -> None:
    """Restore the live tree and store its changes from now on. Runs before the interfaces start. Raises StateError."""
    state = context.state
    if state is None:
        return
    # Imported late: they load compiled kernels.
    from gateway.adapters.drakeviewer.robots import ROOT as DRAKE_ROOT
    from gateway.demo import ROOT as DEMO_ROOT
    from gateway.runtime.state.tree_store import TreeStore

    excluded = list(DEMO_ROOT) if context.settings.demo else []  # the demo is created at every start
    if context.settings.drake_viewer:  # what ended meanwhile would stay: no later message deletes it
        excluded.append(DRAKE_ROOT)
    await asyncio.to_thread(state.add, TreeStore(context.tree, excluded))
    restored_nodes = context.tree.snapshot.root.node_count - 1
    if restored_nodes:
        _log.info("tree restored", nodes=restored_nodes, path=str(state.database.path))
    state.start()

    def on_problem(problem: str) -> None:
        if problem:
            context.registry.fail(STATE, f"{state.database.path} cannot be written: {problem}")
        else:
            figures = {"restored_nodes": restored_nodes}
            context.registry.ready(STATE, where=str(state.database.path), figures=lambda: figures | state.status())

    state.on_problem = on_problem
    on_problem("")
    if state.database.loss:
        context.registry.warn(STATE, "file", state.database.loss)
