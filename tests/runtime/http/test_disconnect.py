import asyncio
import gc
import weakref

import pytest
from starlette.requests import ClientDisconnect, Request
from starlette.types import Message

from gateway.runtime.http.disconnect import while_connected


class Client:
    """A GET request's connection, which ``leave`` ends."""

    def __init__(self) -> None:
        self._left = asyncio.Event()
        self._begun = False

    def leave(self) -> None:
        self._left.set()

    async def receive(self) -> Message:
        if not self._begun:
            self._begun = True
            return {"type": "http.request", "body": b"", "more_body": False}
        await self._left.wait()
        return {"type": "http.disconnect"}

    @property
    def request(self) -> Request:
        return Request({"type": "http", "method": "GET", "headers": []}, self.receive)


async def test_returns_the_result_or_raises_the_error_of_the_work() -> None:
    async def fail() -> None:
        raise ZeroDivisionError

    assert await while_connected(Client().request, asyncio.sleep(0, "done")) == "done"
    with pytest.raises(ZeroDivisionError):
        await while_connected(Client().request, fail())


@pytest.mark.parametrize("disconnects", [True, False])
async def test_cancels_the_work_when_the_client_disconnects_or_the_caller_is_cancelled(disconnects: bool) -> None:
    client, begun, cancelled = Client(), asyncio.Event(), asyncio.Event()

    async def work() -> None:
        begun.set()
        try:
            await asyncio.Event().wait()
        finally:
            cancelled.set()

    waiting = asyncio.create_task(while_connected(client.request, work()))
    await begun.wait()
    client.leave() if disconnects else waiting.cancel()
    with pytest.raises(ClientDisconnect if disconnects else asyncio.CancelledError):
        await waiting
    await cancelled.wait()


async def test_an_error_is_freed_without_the_garbage_collector() -> None:
    """A stopped render's error may keep gigabytes alive."""

    class Failure(Exception):  # unlike built-in exceptions, it can be referred to weakly
        pass

    async def fail() -> None:
        raise Failure

    async def freed() -> weakref.ref[BaseException]:
        try:
            await while_connected(Client().request, fail())
        except Failure as error:
            return weakref.ref(error)
        raise AssertionError

    gc.collect()
    gc.disable()
    try:
        error = await freed()
        await asyncio.sleep(0)
        assert error() is None
    finally:
        gc.enable()
