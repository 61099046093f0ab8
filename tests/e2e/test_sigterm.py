"""SIGTERM at any moment of ``scenegate serve`` ends all of its processes with exit code 0."""

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from gateway.cli.first_line import STOPPED
from tests.support import clients, forms
from tests.support.gateway_process import GatewayProcess
from tests.support.waiting import wait_until

pytestmark = pytest.mark.slow

Moment = Callable[[GatewayProcess], None]
ONE = ("--only", "render")
TWO = (*ONE, "--workers", "2")
EMPTY_CACHE = "the empty cache of kernels"


def at_once(_: GatewayProcess) -> None:
    """While modules are imported."""


def listening(process: GatewayProcess) -> None:
    process.wait_for("Scenegate listens")


def compiling(process: GatewayProcess) -> None:
    process.wait_for("Compiling the rendering kernels")


def ready(process: GatewayProcess) -> tuple[str, list[int]]:
    url = str(process.wait_for("Scenegate listens")["url"])
    health = wait_until(lambda: (now := clients.get(f"{url}/readyz").json())["status"] == "ready" and now)
    return url, [int(pid) for pid in health.get("workers", {}).get("states", ())]


def rendering(process: GatewayProcess) -> None:
    url, _ = ready(process)
    fields = {**forms.drake_fields("color"), "width": "4096", "height": "4096"}
    content = forms.body(forms.gltf(), fields)
    headers = {"Content-Type": forms.CONTENT_TYPE}
    pool = ThreadPoolExecutor(8)
    for _ in range(8):
        pool.submit(clients.post, f"{url}/render", content=content, headers=headers)
    pool.shutdown(wait=False)
    wait_until(lambda: "scenegate_render_running 0.0" not in clients.get(f"{url}/metrics").text)


def hung(process: GatewayProcess) -> None:
    _, pids = ready(process)
    os.kill(pids[0], signal.SIGSTOP)


def all_hung(process: GatewayProcess) -> None:
    for pid in ready(process)[1]:
        os.kill(pid, signal.SIGSTOP)


def restarting(process: GatewayProcess) -> None:
    _, pids = ready(process)
    os.kill(pids[0], signal.SIGKILL)
    process.wait_for("A process has ended")


def replacing(process: GatewayProcess) -> None:
    ready(process)
    process.process.send_signal(signal.SIGHUP)
    process.wait_for("All processes are replaced")


MOMENTS: dict[str, tuple[tuple[str, ...], Moment]] = {
    "one process, imports": (ONE, at_once),
    "one process, compilation": ((*ONE, EMPTY_CACHE), compiling),
    "one process, renders": (ONE, rendering),
    "all interfaces, start": (("--grpc-port", "0", "--tcpq-port", "0", "--lcm-url", "off", "--demo"), listening),
    "two processes, imports": (TWO, at_once),
    "two processes, start": (TWO, listening),
    "two processes, compilation": ((*TWO, EMPTY_CACHE), compiling),
    "two processes, one hangs": ((*TWO, "--shutdown-seconds", "1"), hung),
    "two processes, both hang": ((*TWO, "--shutdown-seconds", "1"), all_hung),
    "two processes, one restarts": (TWO, restarting),
    "two processes, all are replaced": (TWO, replacing),
}


@pytest.mark.parametrize("name", MOMENTS)
def test_sigterm_ends_all_processes(name: str, tmp_path: Path) -> None:
    flags, reach = MOMENTS[name]
    environment = {"NUMBA_CACHE_DIR": str(tmp_path)} if EMPTY_CACHE in flags else {}
    given = [flag for flag in flags if flag != EMPTY_CACHE]
    process = GatewayProcess("--http-port", "0", *given, env=environment)
    try:
        reach(process)
        children = [*_descendants(process.process.pid)]
        assert process.stop() in (0, -signal.SIGTERM if reach is at_once else 0)
        log = process.rest_of_log()
        if reach is not at_once:
            assert log[-1]["event"] == STOPPED
        if reach is hung:
            assert len([entry for entry in log if "not ended in time" in entry["event"]]) == 1
        wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in children))
    finally:
        process.kill()


def _descendants(pid: int) -> Iterator[int]:
    """Yield the processes that a process has started, and those that they have started."""
    for children in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, children.read_text().split()):
            yield child
            yield from _descendants(child)
