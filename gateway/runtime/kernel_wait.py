"""Waiting on the event loop for kernels that are compiled in the background (``gateway.wiring.warmup``)."""

from __future__ import annotations

import asyncio
from typing import Final

from renderers.compiler.pending import is_compiling

_POLL_SECONDS: Final = 0.1


async def until_compiled(*parts: str) -> None:
    """Return once none of these parts is being compiled.

    A call that needs a part waits for it by itself, but in a worker thread, which other calls could use meanwhile.
    """
    while any(is_compiling(part) for part in parts):  # noqa: ASYNC110 - other threads load them
        await asyncio.sleep(_POLL_SECONDS)


def parts_of_look(look: str, samples: int) -> tuple[str, ...]:
    """Return the parts that a colour image needs besides those of the default settings."""
    return (*(("studio",) if look == "studio" else ()), *(("antialiasing",) if samples > 1 else ()))
