"""Asyncio version of the tree viewer client. Each coroutine runs a blocking method in a thread."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from contextlib import asynccontextmanager
from functools import wraps
from types import TracebackType
from typing import Any, Concatenate, Final, Generic, ParamSpec, TypeVar

from scenegate.messages.arguments import describe
from scenegate.messages.changes import Key, Path, path_of
from scenegate.tree.callbacks import Callback
from scenegate.tree.control_panel import ControlHandle, JointSliders, V
from scenegate.tree.controls import ButtonHandle, ControlFolder, MaybePose, PlotHandle
from scenegate.tree.node_handles import Batch, NodeHandle, PublishedRobot
from scenegate.tree.viewer import TreeViewer

Blocking = TypeVar("Blocking")
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
Converted = TypeVar("Converted")
Wrapped = TypeVar("Wrapped")
NodeType = TypeVar("NodeType", bound=NodeHandle)


def _in_thread_as(
    convert: Callable[[Result], Converted], method: Callable[Concatenate[Blocking, Arguments], Result]
) -> Callable[Concatenate[Any, Arguments], Coroutine[Any, Any, Converted]]:
    """Return a coroutine method that calls a method of ``self._blocking`` in a thread, and converts its result."""

    @wraps(method)
    async def call(self: Any, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Converted:
        blocking_method = getattr(self._blocking, method.__name__)  # of its own class, which may override ``method``
        return convert(await asyncio.to_thread(blocking_method, *args, **kwargs))

    return call


def _in_thread(
    method: Callable[Concatenate[Blocking, Arguments], Result],
) -> Callable[Concatenate[Any, Arguments], Coroutine[Any, Any, Result]]:
    return _in_thread_as(lambda result: result, method)


class _Wrapper(Generic[Wrapped]):
    """An object whose methods call those of a blocking one."""

    def __init__(self, blocking: Wrapped) -> None:
        self._blocking = blocking


class AsyncNode(_Wrapper[NodeType]):
    """``NodeHandle`` whose methods are coroutines."""

    def __getitem__(self, key: Key) -> AsyncNode[NodeHandle]:
        return AsyncNode(self._blocking[key])

    set = _in_thread(NodeHandle.set)
    transform = _in_thread(NodeHandle.transform)
    set_visible = _in_thread(NodeHandle.set_visible)
    set_opacity = _in_thread(NodeHandle.set_opacity)
    delete = _in_thread(NodeHandle.delete)


class AsyncRobot(AsyncNode[PublishedRobot]):
    """``PublishedRobot`` whose methods are coroutines."""

    @property
    def published(self) -> PublishedRobot:
        """The robot, for its links, joints and warnings."""
        return self._blocking

    set_joints = _in_thread(PublishedRobot.set_joints)


_callback_tasks: Final[set[asyncio.Task[None]]] = set()
"""Coroutines of callbacks that run."""


def _on_loop(callback: Callable[..., Any], method: str) -> Callable[..., None]:
    """Return a function that makes the running event loop call ``callback``, which may be a coroutine."""
    loop = asyncio.get_running_loop()
    if not callable(callback):
        raise TypeError(f"a callback of {method} must be a function, not {describe(callback)}")

    def call(*args: object) -> None:
        result = callback(*args)
        if inspect.iscoroutine(result):
            task = loop.create_task(result)
            _callback_tasks.add(task)
            task.add_done_callback(_callback_tasks.discard)

    def schedule(*args: object) -> None:
        loop.call_soon_threadsafe(call, *args)

    return schedule


class AsyncControl(_Wrapper[ControlHandle[V]]):
    """``ControlHandle`` whose methods that send are coroutines. The event loop calls the callbacks."""

    @property
    def path(self) -> Path:
        """See ``ControlHandle``."""
        return self._blocking.path

    @property
    def value(self) -> V:
        """Current value."""
        return self._blocking.value

    def on_update(self, callback: Callable[[V], Any]) -> Callable[[], None]:
        """See ``ControlHandle.on_update``. ``callback`` may be a coroutine."""
        return self._blocking.on_update(_on_loop(callback, "on_update"))

    set = _in_thread(ControlHandle.set)
    delete = _in_thread(ControlHandle.delete)


class AsyncButton(AsyncControl[int]):
    """``ButtonHandle`` for asyncio."""

    _blocking: ButtonHandle

    def on_click(self, callback: Callable[[], Any]) -> Callable[[], None]:
        """See ``ButtonHandle.on_click``. ``callback`` may be a coroutine."""
        return self._blocking.on_click(_on_loop(callback, "on_click"))


class AsyncPlot(AsyncControl[None]):
    """``PlotHandle`` for asyncio."""

    _blocking: PlotHandle
    add = _in_thread(PlotHandle.add)
    add_samples = _in_thread(PlotHandle.add_samples)


class AsyncJointSliders(_Wrapper[JointSliders]):
    """``JointSliders`` whose methods that send are coroutines."""

    @property
    def values(self) -> dict[str, float]:
        """See ``JointSliders``."""
        return self._blocking.values

    set = _in_thread(JointSliders.set)
    reset = _in_thread(JointSliders.reset)
    delete = _in_thread(JointSliders.delete)


class AsyncControlFolder(_Wrapper[ControlFolder]):
    """``ControlFolder`` whose methods are coroutines."""

    def __getitem__(self, key: Key) -> AsyncControlFolder:
        return AsyncControlFolder(self._blocking[key])

    add_button = _in_thread_as(AsyncButton, ControlFolder.add_button)
    add_slider = _in_thread_as(AsyncControl[float], ControlFolder.add_slider)
    add_number = _in_thread_as(AsyncControl[float], ControlFolder.add_number)
    add_text = _in_thread_as(AsyncControl[str], ControlFolder.add_text)
    add_checkbox = _in_thread_as(AsyncControl[bool], ControlFolder.add_checkbox)
    add_dropdown = _in_thread_as(AsyncControl[str], ControlFolder.add_dropdown)
    add_color = _in_thread_as(AsyncControl[tuple[float, float, float]], ControlFolder.add_color)
    add_plot = _in_thread_as(AsyncPlot, ControlFolder.add_plot)
    add_gizmo = _in_thread_as(AsyncControl[MaybePose], ControlFolder.add_gizmo)
    delete = _in_thread(ControlFolder.delete)

    async def add_joint_sliders(self, robot: AsyncRobot, name: Key | None = None) -> AsyncJointSliders:
        """See ``ControlFolder.add_joint_sliders``."""
        return AsyncJointSliders(await asyncio.to_thread(self._blocking.add_joint_sliders, robot.published, name))


class AsyncTreeViewer:
    """``TreeViewer`` for asyncio. It is a context manager, and connects when the context is entered."""

    def __init__(self, url: str | None = None, timeout: float = 5.0, binary: bool | None = None) -> None:
        """Accept the arguments of ``TreeViewer``."""
        self._arguments = (url, timeout, binary)
        self._viewer: TreeViewer | None = None

    async def __aenter__(self) -> AsyncTreeViewer:
        self._viewer = await asyncio.to_thread(TreeViewer, *self._arguments)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await asyncio.to_thread(self._blocking.close)

    def __getitem__(self, key: Key) -> AsyncNode[NodeHandle]:
        return AsyncNode(NodeHandle(self._blocking, path_of(key)))

    set = _in_thread(TreeViewer.set)
    delete = _in_thread(TreeViewer.delete)
    set_transforms = _in_thread(TreeViewer.set_transforms)
    set_view = _in_thread(TreeViewer.set_view)
    show = _in_thread(TreeViewer.show)
    image = _in_thread(TreeViewer.image)
    robot = _in_thread_as(AsyncRobot, TreeViewer.robot)

    async def on_click(self, path: Key, callback: Callback) -> Callable[[], Awaitable[None]]:
        """See ``TreeViewer.on_click``. The event loop calls ``callback``, which may be a coroutine."""
        call = _on_loop(callback, "on_click")
        stop = await asyncio.to_thread(self._blocking.on_click, path, call)
        return lambda: asyncio.to_thread(stop)

    @property
    def controls(self) -> AsyncControlFolder:
        """See ``TreeViewer.controls``."""
        return AsyncControlFolder(self._blocking.controls)

    @property
    def page_url(self) -> str:
        """See ``TreeViewer.page_url``."""
        return self._blocking.page_url

    @page_url.setter
    def page_url(self, url: str) -> None:
        self._blocking.page_url = url

    def _repr_html_(self) -> str:
        return self._blocking.show().html

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
