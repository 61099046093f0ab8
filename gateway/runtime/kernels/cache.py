"""Fills the kernel cache, and keeps a server from compiling.

Compiling holds the GIL for many seconds, so the serving process never does it: child processes fill the cache, and the
server loads from it. ``renderers.compiler.cache_folder`` says where the cache is and whether it is complete.
"""

import asyncio
import contextlib
import json
import logging
import os
import signal
import sys
from collections.abc import Awaitable, Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from gateway.runtime.file_lock import Lock, try_lock
from gateway.runtime.kernels.progress import KernelProgress
from gateway.runtime.workers.scheduling import usable_cpus
from renderers.compiler import cache_folder

_MAX_CHILDREN = 5
"""Maximum number of children: the largest part takes a quarter of the time, and each child up to 0.6 GB."""
_LOCK_SECONDS = 0.1
"""Interval between attempts to lock the cache folder, while another process compiles."""

_log = logging.getLogger("gateway")

OnCached = Callable[[str], Awaitable[None]]
"""Called with the name of a part."""


async def _ignore(part: str) -> None:
    """An ``OnCached`` that does nothing."""


class KernelError(RuntimeError):
    """The kernels could not be compiled or loaded; the message is one sentence."""


class KernelLoadError(KernelError):
    """A kernel could not be loaded from the cache, which should have it: it is damaged, or could not be read."""


def configure() -> Path:
    """Set the cache folder of this process and its children, and return the folder of this version's kernels.

    It sets NUMBA_CACHE_DIR, unless the user has. Call it before any kernel is imported.
    """
    os.environ["NUMBA_CACHE_DIR"] = str(cache_folder.root())
    return cache_folder.folder()


def are_cached(parts: Collection[str] | None = None) -> bool:
    """Return whether the kernels of parts (None: of the cache's manifest) are cached for this CPU and these sources."""
    configure()
    return not cache_folder.missing(parts=parts)


async def compile_missing(parts: Collection[str], progress: KernelProgress, on_cached: OnCached = _ignore) -> None:
    """Compile the parts that are not cached. If another process of this machine compiles, wait for its end first.

    Arguments as for ``compile_in_children``. Raises KernelError if that fails, or the cache cannot be written.
    """
    folder = configure()
    if reason := cache_folder.unusable(folder):
        raise KernelError(
            f"the rendering kernels are not complete ({cache_folder.missing(parts=parts)}) in {folder}, {reason}: "
            "make it writable and run `scenegate warmup`, or choose another folder with NUMBA_CACHE_DIR"
        )
    with (folder / "lock").open("wb") as lock:
        # On a file system without locks, two processes compile the same kernels at the same time.
        while try_lock(lock.fileno()) is Lock.TAKEN:
            progress.set_waiting(True)
            await asyncio.sleep(_LOCK_SECONDS)
        progress.set_waiting(False)
        try:
            damaged = await asyncio.to_thread(cache_folder.remove_damaged)
        except OSError as error:
            raise KernelError(
                f"a damaged file of the kernel cache {folder} cannot be deleted ({error.strerror}): delete the folder, "
                "or choose another one with NUMBA_CACHE_DIR"
            ) from None
        if damaged:
            _log.warning("Damaged kernels in the cache %s are compiled again: %s", folder, ", ".join(damaged))
        missing = []
        for part in parts:
            if await asyncio.to_thread(are_cached, [part]):
                await on_cached(part)
            else:
                missing.append(part)
        if missing:
            progress.expected = {part: progress.expected[part] for part in missing}
            await compile_in_children(missing, progress, on_cached)


async def compile_in_children(parts: Collection[str], progress: KernelProgress, on_cached: OnCached = _ignore) -> None:
    """Compile parts in child processes, at most one per processor, and list them in the cache's manifest.

    The children (``compile_process``) read the index of their next part from a pipe; there are at most 255.
    ``on_cached`` is awaited with each part that is compiled. Raises KernelError, with the last line of a child's
    stderr.
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
    queue: int, parts: tuple[str, ...], compiled: dict[str, list[str]], progress: KernelProgress, on_cached: OnCached
) -> None:
    """Run one child to its end.

    The child writes JSON to stdout: ``{"part": PART}`` for each compiled function, and ``{"part": PART, "kernels":
    [FOLDER, ...]}`` for each compiled part. ``queue``: pipe with the index in ``parts`` of each part to compile.
    ``compiled``: cache folders of the kernels, by part; extended here.
    """
    child = await asyncio.create_subprocess_exec(
        *(sys.executable, "-P", "-m", "gateway.runtime.kernels.compile_process", str(queue), *parts),
        # Import the same modules as this process; the current folder may be a clone of another version.
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache_folder.root()), "PYTHONPATH": os.pathsep.join(sys.path)},
        pass_fds=(queue,),
        start_new_session=True,  # Ctrl+C ends this process, which then ends the child, rather than both at once
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
            part, kernels = report["part"], report.get("kernels")
            progress.add(part, complete=kernels is not None)
            if kernels is not None:
                compiled[part] = kernels
                await on_cached(part)
        await child.wait()
    except BaseException:
        if child.returncode is None:
            child.terminate()
        while child.returncode is None:
            # This task may be cancelled twice: because another child failed, and because the process stops.
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
def forbid_compiling() -> Iterator[None]:
    """Raise KernelLoadError if this process compiles a kernel inside the block, instead of loading it from the cache.

    The manifest of the cache is wrong then. It is removed, so that the next start compiles the kernels.
    """
    from renderers.compiler.cache_locator import watch_compiler

    def refuse(kernel: str, depth: int) -> None:
        if depth > 1:
            return
        with contextlib.suppress(OSError):
            cache_folder.remove_manifest()
        raise KernelLoadError(
            f"the kernel {kernel} could not be loaded from {cache_folder.folder()}, and the server compiles none: "
            "`scenegate warmup`, or another start, compiles all of them"
        )

    with watch_compiler(refuse):
        yield
