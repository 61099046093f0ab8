"""Cancelling work when the client disconnects before its response."""

import asyncio
from collections.abc import Coroutine
from typing import Any, Final, TypeVar

from starlette.requests import ClientDisconnect, Request
from starlette.types import Message

from gateway.runtime.http.http_protocol import CONNECTION, BoundedHttpProtocol

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

    connection: BoundedHttpProtocol | None = http.scope.get(CONNECTION)
    if connection is not None:
        return await _while_open(connection, work)
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


async def _while_open(connection: BoundedHttpProtocol, work: Coroutine[Any, Any, T]) -> T:
    """``while_connected`` without further tasks: the connection cancels this one."""
    task = asyncio.current_task()
    assert task is not None
    if connection.is_disconnected():
        work.close()
        raise ClientDisconnect
    connection.on_disconnect = task.cancel
    connection.flow.resume_reading()  # else the end of the connection is not seen behind a large body
    try:
        return await work
    except asyncio.CancelledError:
        if connection.is_disconnected() and task.uncancel() == 0:
            raise ClientDisconnect from None
        raise
    finally:
        connection.on_disconnect = None
