"""A request's connection, for an application that wants the body where it lies, and to know when the client leaves.

By ASGI alone each byte is copied four times on its way, every piece wakes a task through a dozen middlewares, and
another task has to wait for the end. The application is still asked as ever: it finds this among the extensions of its
scope, and may use it in place of ``receive``.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, Final

from starlette.requests import ClientDisconnect
from starlette.types import Scope

from gateway.server.alarms import Alarm, alarms_of

EXTENSION: Final = "scenegate.direct"

Into = Callable[[bytes | bytearray, int], None]
"""Given a buffer and how many of its first bytes have come; it is used again when the call returns."""


class Direct:
    """Of one request that says how long its body is. Belongs to the event loop."""

    __slots__ = (
        "_begin",
        "_ended",
        "_gone",
        "_into",
        "_last",
        "_loop",
        "_lost",
        "_patience",
        "_timer",
        "left",
        "taken",
    )

    def __init__(self, loop: asyncio.AbstractEventLoop, length: int, begin: Callable[[], bytes]) -> None:
        """``begin``: has the connection read on, and gives what has come already."""
        self.left = length
        """Bytes of the body that have not come yet."""
        self.taken = False
        """Whether they are for the application, in person."""
        self._loop = loop
        self._begin: Callable[[], bytes] | None = begin
        self._into: Into | None = None
        self._ended: asyncio.Future[None] | None = None
        self._timer: Alarm | asyncio.TimerHandle
        self._patience = self._last = 0.0
        self._gone: Callable[[], None] | None = None
        self._lost = False

    @staticmethod
    def of(scope: Scope) -> Direct | None:
        """Of a request, if its server has one."""
        found: Any = scope.get("extensions", {}).get(EXTENSION)
        return found if isinstance(found, Direct) else None

    async def pour(self, into: Into, patience: float) -> None:
        """Has ``into`` called with the whole body, piece by piece, and returns when that is all. To be called once.

        Args:
            patience: seconds to wait for a byte.

        Raises:
            TimeoutError: none came for so long.
            ClientDisconnect: the client has left.
            Exception: whatever ``into`` raised. In each of these cases the rest of the body is thrown away.
        """
        begin, self._begin = self._begin, None  # it leads back here, by the request's scope
        if begin is None:
            raise ClientDisconnect
        self.taken = True
        self._into = into
        self._ended = ended = self._loop.create_future()
        self._patience, self._last = patience, self._loop.time()
        self._timer = alarms_of(self._loop).later(patience, self._look)
        try:
            if come := begin():
                into(come, len(come))
            if self.left > 0:
                await ended
        finally:
            self._into = self._ended = None
            self._timer.cancel()

    def watch(self, gone: Callable[[], None] | None) -> None:
        """Has ``gone`` called when the client leaves, at once if it has left already; None: nobody any more."""
        self._gone = gone
        if self._lost and gone is not None:
            gone()

    def feed(self, buffer: bytearray, count: int) -> None:
        """For the connection: bytes of the body have come."""
        self.left -= count
        if self._into is None or self._ended is None or self._ended.done():
            return  # whoever asked for them has answered already
        self._last = self._loop.time()
        try:
            self._into(buffer, count)
        except Exception as error:  # noqa: BLE001 - the application gets it
            self._ended.set_exception(error)
        else:
            if self.left == 0:
                self._ended.set_result(None)

    def lose(self) -> None:
        """For the connection: it has ended."""
        self._lost = True
        self._begin = None
        if self._ended is not None and not self._ended.done():
            self._ended.set_exception(ClientDisconnect())
        if self._gone is not None:
            self._gone()

    def _look(self) -> None:
        remaining = self._last + self._patience - self._loop.time()
        if remaining > 0.0:
            self._timer = alarms_of(self._loop).later(remaining, self._look)
        elif self._ended is not None and not self._ended.done():
            self._ended.set_exception(TimeoutError())
