"""The client for asyncio: the same calls, awaited; the waiting happens in threads."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from types import TracebackType

from numpy.typing import ArrayLike

from gateway.client.tree.geometry import Geometry, Transform
from gateway.client.tree.memory import path_of
from gateway.client.tree.viewer import Answer, Batch, Node, TreeViewer


class AsyncNode:
    """A path; see ``Node``."""

    __slots__ = ("_node",)

    def __init__(self, node: Node) -> None:
        self._node = node

    def __getitem__(self, key: str | int | tuple[str | int, ...]) -> AsyncNode:
        return AsyncNode(self._node[key])

    async def set(self, *geometries: Geometry, transform: Transform | ArrayLike | None = None) -> Answer:
        """As ``Node.set``."""
        return await asyncio.to_thread(self._node.set, *geometries, transform=transform)

    async def transform(self, value: Transform | ArrayLike) -> Answer:
        """As ``Node.transform``."""
        return await asyncio.to_thread(self._node.transform, value)

    async def delete(self) -> Answer:
        """As ``Node.delete``."""
        return await asyncio.to_thread(self._node.delete)


class AsyncTreeViewer:
    """As ``TreeViewer``; an asynchronous context manager, which connects on entering."""

    def __init__(self, url: str | None = None, timeout: float = 5.0, binary: bool | None = None) -> None:
        """As of ``TreeViewer``; nothing is connected yet."""
        self._options = (url, timeout, binary)
        self._viewer: TreeViewer | None = None

    async def __aenter__(self) -> AsyncTreeViewer:
        self._viewer = await asyncio.to_thread(TreeViewer, *self._options)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await asyncio.to_thread(self._connected.close)

    def __getitem__(self, key: str | int | tuple[str | int, ...]) -> AsyncNode:
        return AsyncNode(Node(self._connected, path_of(key)))

    async def delete(self) -> Answer:
        """As ``TreeViewer.delete``."""
        return await asyncio.to_thread(self._connected.delete)

    @asynccontextmanager
    async def batch(self) -> AsyncIterator[Batch]:
        """As ``TreeViewer.batch``; what happens to the batch itself is not awaited."""
        batch = Batch()
        yield batch
        batch.answer = await asyncio.to_thread(self._connected.send, batch.changes)

    @property
    def _connected(self) -> TreeViewer:
        if self._viewer is None:
            raise RuntimeError("enter the viewer first: async with AsyncTreeViewer() as viewer")
        return self._viewer
