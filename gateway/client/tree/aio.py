"""Asyncio version of the tree viewer client. Each coroutine runs a blocking call of ``viewer`` in a thread."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Mapping, Sequence
from contextlib import asynccontextmanager
from functools import partial
from os import PathLike
from types import EllipsisType, TracebackType
from typing import TYPE_CHECKING, Literal

from numpy.typing import ArrayLike

from gateway.client.tree.answer import Answer
from gateway.client.tree.clicks import Callback, Click
from gateway.client.tree.geometry import Geometry, Transform
from gateway.client.tree.nodes import Batch, Node
from gateway.client.tree.published import Key, path_of
from gateway.client.tree.robot import PublishedRobot
from gateway.client.tree.viewer import TreeViewer

if TYPE_CHECKING:
    from gateway.robots.robot import JointValue


class AsyncNode:
    """``Node`` whose methods are coroutines."""

    __slots__ = ("_node",)

    def __init__(self, node: Node) -> None:
        self._node = node

    def __getitem__(self, key: Key) -> AsyncNode:
        return AsyncNode(self._node[key])

    async def set(self, *geometries: Geometry, transform: Transform | ArrayLike | None = None) -> Answer:
        """See ``Node.set``."""
        return await asyncio.to_thread(self._node.set, *geometries, transform=transform)

    async def transform(self, value: Transform | ArrayLike) -> Answer:
        """See ``Node.transform``."""
        return await asyncio.to_thread(self._node.transform, value)

    async def set_visible(self, visible: bool) -> Answer:
        """See ``Node.set_visible``."""
        return await asyncio.to_thread(self._node.set_visible, visible)

    async def set_opacity(self, opacity: float) -> Answer:
        """See ``Node.set_opacity``."""
        return await asyncio.to_thread(self._node.set_opacity, opacity)

    async def delete(self) -> Answer:
        """See ``Node.delete``."""
        return await asyncio.to_thread(self._node.delete)


class AsyncRobot:
    """``PublishedRobot`` whose methods are coroutines."""

    __slots__ = ("published",)

    def __init__(self, published: PublishedRobot) -> None:
        self.published = published
        """The robot, for its links, joints and warnings."""

    async def set_joints(self, values: Mapping[str, JointValue]) -> Answer:
        """See ``PublishedRobot.set_joints``."""
        return await asyncio.to_thread(self.published.set_joints, values)

    async def transform(self, value: Transform | ArrayLike) -> Answer:
        """See ``PublishedRobot.transform``."""
        return await asyncio.to_thread(self.published.transform, value)

    async def delete(self) -> Answer:
        """See ``PublishedRobot.delete``."""
        return await asyncio.to_thread(self.published.delete)


class AsyncTreeViewer:
    """``TreeViewer`` for asyncio. It is a context manager, and connects when the context is entered."""

    def __init__(self, url: str | None = None, timeout: float = 5.0, binary: bool | None = None) -> None:
        """Accept the arguments of ``TreeViewer``."""
        self._arguments = (url, timeout, binary)
        self._viewer: TreeViewer | None = None
        self._callback_tasks: set[asyncio.Task[None]] = set()
        """Coroutines of ``on_click`` that run."""

    async def __aenter__(self) -> AsyncTreeViewer:
        self._viewer = await asyncio.to_thread(TreeViewer, *self._arguments)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await asyncio.to_thread(self._connected_viewer.close)

    def __getitem__(self, key: Key) -> AsyncNode:
        return AsyncNode(Node(self._connected_viewer, path_of(key)))

    async def delete(self) -> Answer:
        """See ``TreeViewer.delete``."""
        return await asyncio.to_thread(self._connected_viewer.delete)

    async def set_transforms(self, paths: Iterable[Key], poses: ArrayLike) -> Answer:
        """See ``TreeViewer.set_transforms``."""
        return await asyncio.to_thread(self._connected_viewer.set_transforms, paths, poses)

    async def set_view(
        self,
        *,
        background: ArrayLike | EllipsisType | None = ...,
        grid: bool | EllipsisType | None = ...,
        home: Sequence[ArrayLike] | EllipsisType | None = ...,
    ) -> Answer:
        """See ``TreeViewer.set_view``."""
        return await asyncio.to_thread(self._connected_viewer.set_view, background=background, grid=grid, home=home)

    async def on_click(self, path: Key, callback: Callback) -> Callable[[], Awaitable[None]]:
        """See ``TreeViewer.on_click``. The event loop calls ``callback``, which may be a coroutine."""
        loop = asyncio.get_running_loop()

        def call(click: Click) -> None:
            result = callback(click)
            if inspect.iscoroutine(result):
                task = loop.create_task(result)
                self._callback_tasks.add(task)
                task.add_done_callback(self._callback_tasks.discard)

        if not callable(callback):
            raise TypeError(f"a callback of on_click must be a function, not a {type(callback).__name__}")
        stop = await asyncio.to_thread(
            self._connected_viewer.on_click, path, lambda click: loop.call_soon_threadsafe(call, click)
        )
        return lambda: asyncio.to_thread(stop)

    async def robot(
        self,
        path: Key,
        file: str | PathLike[str],
        *,
        joints: Mapping[str, JointValue] | None = None,
        roots: Iterable[str | PathLike[str]] = (),
        geometry: Literal["visual", "collision"] = "visual",
        textures: bool = True,
        keyframe: str = "",
        gltf_up: Literal["y", "z", "auto"] = "y",
        strict: bool = False,
    ) -> AsyncRobot:
        """See ``TreeViewer.robot``."""
        viewer = self._connected_viewer
        publish = partial(
            viewer.robot,
            path,
            file,
            joints=joints,
            roots=roots,
            geometry=geometry,
            textures=textures,
            keyframe=keyframe,
            gltf_up=gltf_up,
            strict=strict,
        )
        return AsyncRobot(await asyncio.to_thread(publish))

    @asynccontextmanager
    async def batch(self) -> AsyncIterator[Batch]:
        """See ``TreeViewer.batch``. The methods of the batch's nodes are not coroutines: they send nothing."""
        batch = Batch()
        yield batch
        batch.answer = await asyncio.to_thread(self._connected_viewer.send, batch.changes)

    @property
    def _connected_viewer(self) -> TreeViewer:
        """The viewer; raises RuntimeError before the context is entered."""
        if self._viewer is None:
            raise RuntimeError("enter the viewer first: async with AsyncTreeViewer() as viewer")
        return self._viewer
