"""Program that ``limited_process`` starts: limits its own resources, then runs another program.

    python limited_process_child.py MEMORY_BYTES SECONDS PROGRAM [ARGUMENT …]

It imports nothing of this project.
"""

from __future__ import annotations

import resource
import runpy
import sys


def limit_this_process(memory_bytes: int, seconds: int) -> None:
    """Limit the address space and the CPU time of this process, and forbid it to write files."""
    limits = {
        resource.RLIMIT_AS: (memory_bytes, memory_bytes),
        resource.RLIMIT_CPU: (seconds, seconds + 1),  # SIGXCPU at the first, SIGKILL at the second
        resource.RLIMIT_FSIZE: (0, 0),
    }
    for limit, values in limits.items():
        try:
            resource.setrlimit(limit, values)
        except (OSError, ValueError):  # macOS refuses limits on memory
            continue


if __name__ == "__main__":
    limit_this_process(int(sys.argv[1]), int(sys.argv[2]))
    del sys.argv[:3]
    runpy.run_path(sys.argv[0], run_name="__main__")
