"""The time limit of all tests, and polling for conditions without an event."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Final, TypeVar

Found = TypeVar("Found")

SECONDS: Final = 900.0
"""Time limit of every wait of a test: clients, processes, messages, browsers.

Only a hang takes longer. The longest wait that succeeds compiles all kernels on a busy machine: minutes.
"""
MILLISECONDS: Final = int(1000 * SECONDS)
"""The same for liblcm and Playwright."""
PAUSE: Final = 0.02
"""Seconds between two looks at a condition in another process or thread."""


async def until(condition: Callable[[], object]) -> None:
    """Returns when the condition holds; it is looked at between all other things that the loop does."""
    async with asyncio.timeout(SECONDS):
        while not condition():  # noqa: ASYNC110 - what changes has no event to wait for
            await asyncio.sleep(0)


def wait_until(condition: Callable[[], Found]) -> Found:
    """Return the condition's first true value; it changes in another process or thread.

    Raises:
        AssertionError: it has not become true within ``SECONDS``.
    """
    end = time.monotonic() + SECONDS
    while not (found := condition()):
        assert time.monotonic() < end, f"the condition still does not hold after {SECONDS:.0f} s"
        time.sleep(PAUSE)
    return found
