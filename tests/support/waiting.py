"""Waiting for what tells nobody when it is so."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

SECONDS = 30.0
"""A test that waits longer has failed."""


async def until(condition: Callable[[], object]) -> None:
    """Returns when the condition holds; it is looked at between all other things that the loop does."""
    async with asyncio.timeout(SECONDS):
        while not condition():  # noqa: ASYNC110 - what changes has no event to wait for
            await asyncio.sleep(0)
