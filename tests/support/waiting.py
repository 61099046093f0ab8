"""The time limit of all tests, and polling for conditions without an event."""

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
"""Seconds between two checks of a condition in another process or thread."""


async def until(condition: Callable[[], object]) -> None:
    """Return once the condition holds. It is checked in every iteration of the event loop."""
    async with asyncio.timeout(SECONDS):
        while not condition():  # noqa: ASYNC110 - there is no event to wait for
            await asyncio.sleep(0)


def wait_until(condition: Callable[[], Found], seconds: float = SECONDS) -> Found:
    """Return the first true value of a condition that another process or thread changes.

    Raises:
        AssertionError: it has not become true in time.
    """
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, f"the condition still does not hold after {seconds:.0f} s"
        time.sleep(PAUSE)
    return found
