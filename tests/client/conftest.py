"""Fixtures of the client's tests."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

from gateway.adapters.treeviewer.service import TreeViewerService
from scenegate import TreeViewer
from tests.support.liblcm import liblcm
from tests.support.waiting import SECONDS


@pytest.fixture(autouse=True)
def soon_connected_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Try a lost connection again at once, not after a second."""
    monkeypatch.setattr("scenegate.lcm.tcpq_transport.RETRY_SECONDS", 0.05)


@pytest.fixture
def lcm() -> None:
    liblcm()


async def in_thread(function: Callable[..., Any], *args: Any) -> Any:
    return await asyncio.to_thread(function, *args)


def hub_of(service: TreeViewerService) -> str:
    return f"tcpq://localhost:{service.tcpq_port}"


async def talk_to(service: TreeViewerService, talk: Callable[[TreeViewer], object]) -> None:
    """Call a function with a client of a service, in a thread."""

    def call() -> None:
        with TreeViewer(hub_of(service), timeout=SECONDS) as viewer:
            talk(viewer)

    await in_thread(call)


@asynccontextmanager
async def connected(service: TreeViewerService) -> AsyncIterator[TreeViewer]:
    """A client of a service, whose methods block: call them ``in_thread``."""
    viewer: TreeViewer = await in_thread(lambda: TreeViewer(hub_of(service), timeout=SECONDS))
    try:
        yield viewer
    finally:
        await in_thread(viewer.close)
