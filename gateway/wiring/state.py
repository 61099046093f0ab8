"""Connects the persistent state to the live tree; the stereo cameras' parameters are connected in ``wiring.stereo``."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Final

from gateway.runtime.settings import Settings
from gateway.wiring.context import Context

if TYPE_CHECKING:
    from gateway.runtime.state.service import PersistentState

STATE: Final = "state"


def open_state(settings: Settings) -> PersistentState | None:
    """Open the state file, if ``--state`` names one.

    Raises:
        StateError: The file cannot be used.
    """
    if settings.state is None:
        return None
    from gateway.runtime.state.service import PersistentState, StateConfig

    return PersistentState(StateConfig(settings.state))


async def restore_state(context: Context) -> None:
    """Restore the live tree and store its changes from now on. Must run before the interfaces start.

    Raises:
        StateError: The stored tree cannot be read.
    """
    state = context.state
    if state is None:
        return
    from gateway.adapters.drakeviewer.robots import ROOT as DRAKE_ROOT
    from gateway.demo import ROOT as DEMO_ROOT

    excluded = list(DEMO_ROOT) if context.settings.demo else []  # the demo is created at every start
    if context.settings.drake_viewer:  # what ended meanwhile would stay: no later message deletes it
        excluded.append(DRAKE_ROOT)
    await asyncio.to_thread(state.restore_tree, context.tree, excluded)
    state.start()

    def on_problem(problem: str) -> None:
        if problem:
            context.registry.fail(STATE, f"{context.settings.state} cannot be written: {problem}")
        else:
            context.registry.ready(STATE, where=str(context.settings.state), figures=state.status)

    state.on_problem = on_problem
    on_problem("")
    if state.database.loss:
        context.registry.warn(STATE, "file", state.database.loss)
