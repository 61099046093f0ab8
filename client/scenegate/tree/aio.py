"""Asyncio version of the tree viewer client. Each coroutine runs a blocking method in a thread."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from contextlib import asynccontextmanager
from functools import wraps
from types import TracebackType
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar, overload

from scenegate.messages.changes import Key, path_of
from scenegate.tree.clicks import Callback, Click
from scenegate.tree.nodes import Batch, Node
from scenegate.tree.robot import PublishedRobot
from scenegate.tree.viewer import TreeViewer

Blocking = TypeVar("Blocking")
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
Converted = TypeVar("Converted")


class _InThread(Generic[Arguments, Result]):
    """A method that is a coroutine, which calls a blocking method of ``_blocking`` in a thread."""

    def __init__(self, method: Callable[Concatenate[Blocking, Arguments], Result]) -> None:
        self._method: Callable[..., Result] = method
        self.__doc__ = method.__doc__

    @overload
    def __get__(self, instance: None, owner: type) -> _InThread[Arguments, Result]: ...
    @overload
    def __get__(self, instance: object, owner: type) -> Callable[Arguments, Coroutine[Any, Any, Result]]: ...
    def __get__(
        self, instance: Any, owner: type
    ) -> _InThread[Arguments, Result] | Callable[Arguments, Coroutine[Any, Any, Result]]:
        if instance is None:
            return self
        blocking = instance._blocking  # noqa: SLF001 - of the class with this method

        @wraps(self._method)
        async def call(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
            return await asyncio.to_thread(self._method, blocking, *args, **kwargs)

        return call


class AsyncNode:
    """``Node`` whose methods are coroutines."""

    __slots__ = ("_blocking",)

    def __init__(self, node: Node) -> None:
        self._blocking = node

    def __getitem__(self, key: Key) -> AsyncNode:
        return AsyncNode(self._blocking[key])

    set = _InThread(Node.set)
    transform = _InThread(Node.transform)
    set_visible = _InThread(Node.set_visible)
    set_opacity = _InThread(Node.set_opacity)
    delete = _InThread(Node.delete)


class AsyncRobot:
    """``PublishedRobot`` whose methods are coroutines."""

    __slots__ = ("_blocking",)

    def __init__(self, robot: PublishedRobot) -> None:
        self._blocking = robot

    @property
    def published(self) -> PublishedRobot:
        """The robot, for its links, joints and warnings."""
        return self._blocking

    set_joints = _InThread(PublishedRobot.set_joints)
    transform = _InThread(PublishedRobot.transform)
    delete = _InThread(PublishedRobot.delete)


def _returning(
    convert: Callable[[Result], Converted], method: Callable[Concatenate[Blocking, Arguments], Result]
) -> Callable[Concatenate[Blocking, Arguments], Converted]:
    """Return a method with another type of result."""

    def call(blocking: Blocking, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Converted:
        return convert(method(blocking, *args, **kwargs))

    call.__doc__ = method.__doc__
    return call


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
        await asyncio.to_thread(self._blocking.close)

    def __getitem__(self, key: Key) -> AsyncNode:
        return AsyncNode(Node(self._blocking, path_of(key)))

    delete = _InThread(TreeViewer.delete)
    set_transforms = _InThread(TreeViewer.set_transforms)
    set_view = _InThread(TreeViewer.set_view)
    robot = _InThread(_returning(AsyncRobot, TreeViewer.robot))

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
            self._blocking.on_click, path, lambda click: loop.call_soon_threadsafe(call, click)
        )
        return lambda: asyncio.to_thread(stop)

    @asynccontextmanager
    async def batch(self) -> AsyncIterator[Batch]:
        """See ``TreeViewer.batch``. The methods of the batch's nodes are not coroutines: they send nothing."""
        batch = Batch()
        yield batch
        batch.answer = await asyncio.to_thread(self._blocking.send, batch.changes)

    @property
    def _blocking(self) -> TreeViewer:
        """The viewer; raises RuntimeError before the context is entered."""
        if self._viewer is None:
            raise RuntimeError("enter the viewer first: async with AsyncTreeViewer() as viewer")
        return self._viewer
