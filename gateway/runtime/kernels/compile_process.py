"""Child process that compiles kernels: ``python -m gateway.runtime.kernels.compile_process FD PART ...``."""

import json
import os
import sys
from typing import Any

from gateway.runtime.kernels import cache
from gateway.runtime.kernels.parts import BACKGROUND, PARTS
from gateway.runtime.workers import process_tuning


def compile_parts(parts_fd: int, names: tuple[str, ...]) -> None:
    """Compile parts until none is left. Report each compiled function and part on stdout, as JSON lines.

    ``parts_fd``: pipe, from which several processes read, with the index in ``names`` of each part to compile. Raises
    KernelError if Numba has not stored a kernel in the cache.
    """
    cache.configure()
    if set(names) <= set(BACKGROUND):
        os.nice(10)  # the server already runs
    process_tuning.pause_gc()  # compiling makes millions of objects that live until the end
    from renderers.compiler.cache_locator import watch_compiler

    reported_ids: set[int] = set()
    while index := os.read(parts_fd, 1):
        part = names[index[0]]
        with watch_compiler(lambda *_, part=part: _report(part=part)):
            PARTS[part].compile_or_load()
        _report(part=part, kernels=_take_new_folders(reported_ids))


def _report(**fields: Any) -> None:
    """Write a JSON line: ``part`` and the fields of a compiled function, or ``part`` and its ``kernels``."""
    sys.stdout.write(json.dumps(fields) + "\n")
    sys.stdout.flush()


def _take_new_folders(reported_ids: set[int]) -> list[str]:
    """Return the cache folders of the kernels that were compiled since the last call, whose ids are kept in the set."""
    from renderers.compiler.cache_locator import CACHED_KERNELS, folder_of

    folders: list[str] = []
    for dispatcher in CACHED_KERNELS:
        if dispatcher.signatures and id(dispatcher) not in reported_ids:
            reported_ids.add(id(dispatcher))
            path = folder_of(dispatcher)
            if not any(path.glob("*.nbi")):
                raise cache.KernelError(f"Numba has not stored {path.name} in the cache")
            folders.append(path.name)
    return folders


if __name__ == "__main__":
    compile_parts(int(sys.argv[1]), tuple(sys.argv[2:]))
