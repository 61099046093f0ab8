"""The gateway of the soak: as ``scenegate serve``, with lines of JSON: its HTTP port, then its figures once a second.

python -m tests.soak.server FLAGS…
"""

import asyncio
import contextlib
import json
import os
import re
import sys
import threading
import time
from pathlib import Path
from typing import Any

import uvloop

from gateway.app import create_app
from gateway.runtime import settings as options
from gateway.runtime.http import http_server
from gateway.runtime.logs import log_setup
from gateway.runtime.workers import process_tuning
from gateway.wiring.state import open_state

TICK = 0.001
"""Seconds between two looks of the ticker whose delays are the loop's stalls."""
POOL_THREAD = re.compile(r"[_-]\d+$")
"""Suffix of a pool's thread names. They are not counted: a pool is bounded and grows with concurrent demand."""


async def tell() -> None:
    """Prints figures until cancelled: what a leak would show in, and the stalls of the last second.

    A stall is how late the ticker is, whoever is to blame: a turn of ours, a thread that holds the interpreter, other
    programs on the machine. A turn is the CPU time that the loop's own thread took between two ticks: ours alone.
    """
    while True:
        stalls, turns = [], []
        end = time.perf_counter() + 1.0
        while (begin := time.perf_counter()) < end:
            cpu = time.thread_time()
            await asyncio.sleep(TICK)
            turns.append(1e3 * (time.thread_time() - cpu))
            stalls.append(1e3 * (time.perf_counter() - begin - TICK))
        stalls.sort()
        turns.sort()
        names = [thread.name for thread in threading.enumerate() if not POOL_THREAD.search(thread.name)]
        figures: dict[str, Any] = {
            "tasks": len(asyncio.all_tasks()),
            "threads": len(names),
            "thread_names": sorted(names),
            "files": len(os.listdir("/proc/self/fd")),  # noqa: PTH208 - names only
            "rss_mb": int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6,  # noqa: ASYNC240 - no disk
            "cpu_s": time.process_time(),
            "stall_p99_ms": stalls[int(0.99 * len(stalls))],
            "stall_max_ms": stalls[-1],
            "turn_p99_ms": turns[int(0.99 * len(turns))],
            "turn_max_ms": turns[-1],
            "load": os.getloadavg()[0],
        }
        print(json.dumps(figures), flush=True)


async def serve(flags: dict[str, Any]) -> None:
    """Until SIGTERM."""
    settings = options.load(flags)
    log_setup.configure("json", "error")
    app = create_app(settings, open_state(settings), on_started=process_tuning.freeze_gc)
    listener = process_tuning.listen(settings.host, settings.http_port)
    print(json.dumps({"http_port": listener.getsockname()[1]}), flush=True)
    server = http_server.MainServer(http_server.server_config(app, settings.shutdown_seconds, lifespan=True))
    app.state.closing = lambda: server.should_exit
    ticker = asyncio.create_task(tell())
    await server.serve(sockets=[listener])
    ticker.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await ticker


if __name__ == "__main__":
    uvloop.run(serve(dict(pair.split("=", 1) for pair in sys.argv[1:])))
