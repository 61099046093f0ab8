"""Cancelling work when the client disconnects before its response."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, Final, TypeVar

from starlette.requests import ClientDisconnect, Request
from starlette.types import Message

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

    work_task = asyncio.ensure_future(work)
    receive_task: asyncio.Future[Message] | None = None
    try:
        while receive_task is None or receive_task.result()["type"] != "http.disconnect":
            receive_task = asyncio.ensure_future(http.receive())
            await asyncio.wait((work_task, receive_task), return_when=asyncio.FIRST_COMPLETED)
            if work_task.done():
                return work_task.result()
        raise ClientDisconnect
    finally:
        work_task.cancel()
        if receive_task is not None:
            receive_task.cancel()
        del work_task  # a reference cycle otherwise: task, its exception, the traceback, this frame
