"""The join of the state with the live tree; rooms with something of their own to keep do that in their joins."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Final

from gateway.settings import Settings
from gateway.wiring.context import Context

if TYPE_CHECKING:
    from gateway.state.service import State

STATE: Final = "state"


def open_state(settings: Settings) -> State | None:
    """The state, if there is one; raises StateError."""
    if settings.state is None:
        return None
    from gateway.state.config import StateConfig
    from gateway.state.service import State

    return State(StateConfig(settings.state))


async def restore_state(context: Context) -> None:
    """Puts what was stored into the context, before the rooms are joined; raises StateError."""
    state = context.state
    if state is None:
        return
    from gateway.demo import ROOT as DEMO_ROOT

    # The demo is made anew at every start; what clients put beside it is theirs.
    without = DEMO_ROOT if context.settings.demo else ()
    await asyncio.to_thread(state.restore_tree, context.tree, without)
    state.start()
    state.keep_tree(context.tree)

    def told(problem: str) -> None:
        if problem:
            context.services.fail(STATE, f"{context.settings.state} cannot be written: {problem}")
        else:
            context.services.ready(STATE, where=str(context.settings.state), figures=state.status)

    state.journal.on_problem = told
    told("")
