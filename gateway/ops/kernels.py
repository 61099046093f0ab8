"""The compiled kernels: where they are kept, whether they are there, and compiling them in a child process.

Compiling holds the interpreter's lock for many seconds, so the serving process never does it: children fill the cache,
the server loads it. Numba cannot see that a function in another file changed, so the folder is keyed by the content of
the sources.
"""

from __future__ import annotations

import asyncio
import atexit
import fcntl
import hashlib
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable
from functools import cache
from importlib.metadata import version
from pathlib import Path

import gateway
import renderers

CACHE_ENV = "SCENEGATE_CACHE_DIR"
_KEPT = 4
"""Folders of other versions that stay; each holds a few MB."""


_MOST_CHILDREN = 3
"""More would not be ready sooner: the largest part takes a third of the time. Each holds up to 0.6 GB."""


class KernelError(RuntimeError):
    """The kernels could not be compiled; the message is one sentence."""


@cache
def folder() -> Path:
    """The folder of this version's kernels, made if need be; a private temporary one where none can be written."""
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 - or as it is: no home
    base = os.environ.get(CACHE_ENV) or Path(caches, "scenegate")
    path = Path(base) / "kernels" / sources_digest()
    try:
        path.mkdir(parents=True, exist_ok=True)
        if os.access(path, os.W_OK | os.X_OK):
            return path
    except OSError:
        pass
    # Numba insists on writing. Never a guessable name in a shared folder: it runs what it finds there.
    private = Path(tempfile.mkdtemp(prefix="scenegate-kernels-"))
    atexit.register(shutil.rmtree, private, ignore_errors=True)
    if path.is_dir():
        shutil.copytree(path, private, dirs_exist_ok=True)
    return private


def configure() -> Path:
    """Points Numba at the folder; call before anything imports Numba. NUMBA_CACHE_DIR set by the user wins."""
    path = Path(os.environ.setdefault("NUMBA_CACHE_DIR", str(folder())))
    loaded = sys.modules.get("numba.core.config")
    if loaded is not None:
        loaded.CACHE_DIR = str(path)  # type: ignore[attr-defined]  # any module, for all that is known
    return path


def are_cached() -> bool:
    """Whether a warm-up for this machine's CPU has ended well before."""
    return _marker(configure()).exists()


def ensure_cached(parts: Iterable[str], say: Callable[[], object] = lambda: None) -> None:
    """Compiles all kernels unless they are cached; of several processes of a machine only one does it.

    Call it before anything imports Numba, and not where an event loop runs.

    Args:
        parts: as ``compile_in_children``.
        say: called before compiling.

    Raises:
        KernelError: they could not be compiled.
    """
    if are_cached():
        return
    with (configure() / "compiling").open("wb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not are_cached():
            say()
            asyncio.run(compile_in_children(parts))


def mark_cached() -> None:
    """Notes that the warm-up ended well, and removes the oldest folders of other versions."""
    path = configure()
    _marker(path).touch()
    if path == folder():
        others = sorted((p for p in path.parent.iterdir() if p != path), key=lambda p: p.stat().st_mtime)
        for other in others[:-_KEPT]:
            shutil.rmtree(other, ignore_errors=True)


async def compile_in_children(parts: Iterable[str]) -> None:
    """Compiles all parts in as many children as there are processors, and notes that it is done.

    The children, ``python -m gateway.warmup N``, read from a pipe which part is the next.

    Args:
        parts: ``warmup.PARTS``; at most 255.

    Raises:
        KernelError: a child failed; with its last line.
    """
    count = len(tuple(parts))
    numbers, told = os.pipe()
    try:
        os.write(told, bytes(range(count)))
        os.close(told)  # who reads finds the end when all parts are taken
        children = min(_processors(), count, _MOST_CHILDREN)
        await asyncio.gather(*(_compile_in_child(numbers) for _ in range(children)))
    finally:
        os.close(numbers)
    mark_cached()


def _processors() -> int:
    """That this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


async def _compile_in_child(numbers: int) -> None:
    child = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "gateway.warmup", str(numbers)),
        env={**os.environ, "NUMBA_CACHE_DIR": str(configure())},
        pass_fds=(numbers,),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        _, errors = await child.communicate()
    except asyncio.CancelledError:
        child.terminate()
        await child.wait()
        raise
    if child.returncode:
        lines = errors.decode(errors="replace").strip().splitlines() or [f"exit code {child.returncode}"]
        raise KernelError(f"the rendering kernels could not be compiled: {lines[-1]}")


@cache
def sources_digest() -> str:
    """Of everything that kernels are made of: all of ``renderers``, and what names Numba in ``gateway``."""
    digest = hashlib.sha256()
    for package in (renderers, gateway):
        root = Path(package.__path__[0])
        for path in sorted(root.rglob("*.py")):
            source = path.read_bytes()
            if package is renderers or b"numba" in source:
                digest.update(f"{path.relative_to(root)}\0".encode() + source)
    return digest.hexdigest()[:16]


def _cpu_digest() -> str:
    """Numba keys its entries by these, so a cache filled on another kind of CPU is cold here."""
    from llvmlite.binding import get_host_cpu_features, get_host_cpu_name

    asked = (os.environ.get("NUMBA_CPU_NAME", ""), os.environ.get("NUMBA_CPU_FEATURES", ""))  # for another CPU
    here = (get_host_cpu_name(), get_host_cpu_features().flatten())
    key = (*asked, *here, version("numba"), version("llvmlite"), sys.version)
    return hashlib.sha256("\0".join(key).encode()).hexdigest()[:16]


def _marker(path: Path) -> Path:
    return path / f"warm-{sources_digest()}-{_cpu_digest()}"
