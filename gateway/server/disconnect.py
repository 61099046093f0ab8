"""Cancelling work when the client disconnects before its response."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, Final, TypeVar

from starlette.requests import ClientDisconnect, Request

T = TypeVar("T")

CLIENT_GONE: Final = 499
"""Status that proxies log for a client that disconnected; it is never sent."""


async def while_connected(http: Request, work: Coroutine[Any, Any, T]) -> T:
    """Return the result of ``work``, which is cancelled when the client disconnects.

    Args:
        http: a request without a body, or whose body has been read.

    Raises:
        ClientDisconnect: the client disconnected first.
        Exception: raised by ``work``.
    """

    async def disconnected() -> None:
        while (await http.receive())["type"] != "http.disconnect":
            pass

    work_task, disconnect_task = asyncio.ensure_future(work), asyncio.create_task(disconnected())
    try:
        await asyncio.wait((work_task, disconnect_task), return_when=asyncio.FIRST_COMPLETED)
        if not work_task.done():
            raise ClientDisconnect
        return work_task.result()
    finally:
        work_task.cancel()
        disconnect_task.cancel()
        del work_task  # a reference cycle otherwise: task, its exception, the traceback, this frame
