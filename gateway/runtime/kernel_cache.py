"""Filling the kernel cache, and refusing to compile while serving.

Compiling holds the GIL for many seconds, so the serving process never does it: child processes fill the cache, the
server loads it. ``renderers.compiler.cache_folder`` says where the cache is and whether it is complete.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import json
import os
import signal
import sys
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager, asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

from gateway.runtime.kernel_progress import Progress
from gateway.runtime.worker_pool import usable_cpus
from renderers.compiler import cache_folder

_MAX_CHILDREN = 3
"""Maximum number of children: the largest part takes a third of the time, and each child up to 0.6 GB."""
_LOCK_SECONDS = 0.1
"""Interval at which the lock of another compiling process is polled."""


OnCached = Callable[[str], Awaitable[None]]
"""Called with the name of a part."""


async def _ignore(part: str) -> None:
    """An ``OnCached`` that does nothing."""


class KernelError(RuntimeError):
    """The kernels could not be compiled or loaded; the message is one sentence."""


def configure() -> Path:
    """Choose the cache folder for this process and its children; return that of this version's kernels.

    NUMBA_CACHE_DIR set by the user wins. Call this before any kernel is imported.
    """
    os.environ["NUMBA_CACHE_DIR"] = str(cache_folder.root())
    return cache_folder.folder()


def are_cached(parts: Collection[str] | None = None) -> bool:
    """Return whether the kernels of parts (None: of all compiled so far) are cached for this CPU and these sources."""
    configure()
    return not cache_folder.missing(parts=parts)


def ensure_cached(
    parts: Mapping[str, int],
    show: Callable[[Progress], AbstractContextManager[None]] = lambda progress: contextlib.nullcontext(),
) -> None:
    """Compile the parts that are not cached; of several processes of a machine only one does it.

    Call it before any kernel is imported, and not in a running event loop.

    Args:
        parts: approximate number of functions of each part (``warmup.FUNCTIONS``), the scale of the progress.
        show: context manager that shows the progress.

    Raises:
        KernelError: they could not be compiled.
    """
    if are_cached(parts):
        return
    progress = Progress(parts)
    with show(progress):
        asyncio.run(compile_missing(parts, progress))


async def compile_missing(parts: Collection[str], progress: Progress, on_cached: OnCached = _ignore) -> None:
    """Compile the parts that are not cached, after any other process of this machine that compiles.

    Args:
        parts, progress: as for ``compile_in_children``.
        on_cached: awaited with each part, at once for parts that are in the cache already.

    Raises:
        KernelError: the kernels could not be compiled, or the cache cannot be written.
    """
    async with _exclusive(progress):
        missing = []
        for part in parts:
            if await asyncio.to_thread(are_cached, [part]):
                await on_cached(part)
            else:
                missing.append(part)
        if missing:
            progress.expected = {part: progress.expected[part] for part in missing}
            await compile_in_children(missing, progress, on_cached)


@asynccontextmanager
async def _exclusive(progress: Progress) -> AsyncIterator[None]:
    """Hold the lock of the cache folder."""
    folder = configure()
    if not cache_folder.is_writable(folder):
        raise KernelError(
            f"the rendering kernels in {folder} are not complete ({cache_folder.missing()}), and the folder cannot be "
            "written: NUMBA_CACHE_DIR chooses another one"
        )
    with (folder / "lock").open("wb") as lock:
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                progress.set_waiting(True)
                await asyncio.sleep(_LOCK_SECONDS)
        progress.set_waiting(False)
        yield


async def compile_in_children(parts: Collection[str], progress: Progress, on_cached: OnCached = _ignore) -> None:
    """Compile parts in child processes, at most one per processor, and list them in the cache's manifest.

    The children, ``python -P -m gateway.wiring.warmup FD PART ..``, read from a pipe which part is the next.

    Args:
        parts: names in ``warmup.PARTS``; at most 255.
        progress: updated with every compiled function.
        on_cached: awaited with each part that is compiled.

    Raises:
        KernelError: a child failed; with its last line.
    """
    compiled: dict[str, list[str]] = {}
    queue, queue_input = os.pipe()
    try:
        os.write(queue_input, bytes(range(len(parts))))
        os.close(queue_input)  # children read the end of the file when all parts are taken
        children = min(usable_cpus(), len(parts), _MAX_CHILDREN)
        tasks = [
            asyncio.create_task(_compile_in_child(queue, tuple(parts), compiled, progress, on_cached))
            for _ in range(children)
        ]
        try:
            await asyncio.gather(*tasks)
        finally:
            for task in tasks:  # one has failed, or this process is stopping
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
    finally:
        os.close(queue)
    if unfinished := set(parts) - set(compiled):
        raise KernelError(f"the rendering kernels could not be compiled: {sorted(unfinished)} did not end")
    await asyncio.to_thread(cache_folder.write_manifest, compiled)


async def _compile_in_child(
    queue: int, parts: tuple[str, ...], compiled: dict[str, list[str]], progress: Progress, on_cached: OnCached
) -> None:
    """Run one child to its end.

    Args:
        queue: file descriptor of the pipe with the numbers of the parts to compile.
        compiled: part -> cache folders of its kernels; extended here.
    """
    child = await asyncio.create_subprocess_exec(
        *(sys.executable, "-P", "-m", "gateway.wiring.warmup", str(queue), *parts),
        # The same modules as here, whatever lies in the current folder: it may be a clone of another version.
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache_folder.root()), "PYTHONPATH": os.pathsep.join(sys.path)},
        pass_fds=(queue,),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    assert child.stdout is not None
    assert child.stderr is not None
    errors = asyncio.create_task(child.stderr.read())
    try:
        async for line in child.stdout:
            report = json.loads(line)
            if "kernels" in report:
                compiled[report["part"]] = report["kernels"]
                progress.add_part(report["part"])
                await on_cached(report["part"])
            else:
                progress.add_function(report["part"])
        await child.wait()
    except BaseException:
        if child.returncode is None:
            child.terminate()
        while child.returncode is None:
            # Ctrl+C ends children as well: the first that has ended cancels the others, then this process is cancelled.
            with contextlib.suppress(asyncio.CancelledError):
                await child.wait()
        raise
    finally:
        output = await errors
    if child.returncode:
        lines = output.decode(errors="replace").strip().splitlines() or [_description(child.returncode)]
        raise KernelError(f"the rendering kernels could not be compiled into {cache_folder.folder()}: {lines[-1]}")


def _description(returncode: int) -> str:
    """Return how a child ended that wrote no error."""
    if returncode == -signal.SIGKILL:
        return "a compiling process was killed, perhaps for lack of memory, of which each needs 0.6 GB"
    return f"a compiling process ended with {f'signal {-returncode}' if returncode < 0 else f'exit code {returncode}'}"


@contextmanager
def compiling_refused() -> Iterator[None]:
    """Raise KernelError where this process would compile a kernel, so that it only loads them from the cache.

    The cache is incomplete then, whatever its manifest says: the manifest is removed, so that the next start compiles.
    """

    def refuse(kernel: str, depth: int) -> None:
        if depth > 1:
            return
        with contextlib.suppress(OSError):
            cache_folder.remove_manifest()
        raise KernelError(
            f"the kernel {kernel} could not be loaded from {cache_folder.folder()}, and the server compiles none: "
            "`scenegate warmup`, or another start, compiles all of them"
        )

    with _watched(refuse):
        yield


@contextmanager
def compiling_reported(report: Callable[[str], object]) -> Iterator[None]:
    """Call ``report`` with the name of every kernel that this process compiles, before it is compiled."""
    with _watched(lambda function, depth: report(function) if depth == 1 else None):
        yield


@contextmanager
def functions_reported(report: Callable[[], object]) -> Iterator[None]:
    """Call ``report`` for every function that this process compiles, kernels and those that they call."""
    with _watched(lambda function, depth: report()):
        yield


@contextmanager
def _watched(on_compile: Callable[[str, int], object]) -> Iterator[None]:
    """Call ``on_compile`` at the start of each compilation with the function's name and depth; 1: nothing calls it."""
    from numba.core import event

    depth = threading.local()

    class Watch(event.Listener):
        def on_start(self, event: Any) -> None:
            depth.value = getattr(depth, "value", 0) + 1
            function = event.data["dispatcher"].py_func
            on_compile(f"{function.__module__}.{function.__qualname__}", depth.value)

        def on_end(self, event: Any) -> None:
            depth.value = getattr(depth, "value", 1) - 1

    watch = Watch()
    event.register("numba:compile", watch)
    try:
        yield
    finally:
        event.unregister("numba:compile", watch)
