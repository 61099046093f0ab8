"""``scenegate serve --only render --workers 2``: real processes on one port."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path
from threading import Event

import httpx2
import pytest

from tests.support import clients, forms
from tests.support.gateway_process import GatewayProcess, gateway_process
from tests.support.waiting import SECONDS, wait_until

pytestmark = pytest.mark.slow

WORKERS = ("--only", "render", "--workers", "2")
RENDERS = 24
CLIENTS = 4
BODY = forms.body(forms.gltf(), forms.drake_fields("label"))


def render(url: str, content: bytes = BODY) -> httpx2.Response:
    """Post an image on a new connection."""
    return clients.post(f"{url}/render", content=content, headers={"Content-Type": forms.CONTENT_TYPE})


def states(url: str) -> dict[str, str]:
    """State of each process, by its number."""
    found: dict[str, str] = clients.get(f"{url}/healthz").json()["workers"]["states"]
    return found


def all_ready(url: str) -> list[int]:
    """Wait until both processes are ready; return their numbers."""

    def ready() -> list[int]:
        answer = clients.get(f"{url}/readyz")
        return [int(pid) for pid in answer.json()["workers"]["states"]] if answer.json()["status"] == "ready" else []

    return wait_until(ready)


def figures(url: str) -> dict[str, float]:
    """Return all metrics, by name and labels."""
    lines = clients.get(f"{url}/metrics").text.splitlines()
    return {name: float(value) for name, _, value in (line.rpartition(" ") for line in lines) if name[:1] != "#"}


def rendered(url: str) -> float:
    return sum(value for name, value in figures(url).items() if name.startswith("scenegate_renders_total"))


@pytest.fixture(scope="module")
def running() -> Iterator[tuple[GatewayProcess, str]]:
    with gateway_process(*WORKERS, "--threads", "1") as (process, url):
        all_ready(url)
        yield process, url


def test_health_lists_all_processes(running: tuple[GatewayProcess, str]) -> None:
    process, url = running
    pids = all_ready(url)
    assert len(pids) == 2
    assert process.process.pid not in pids
    workers = clients.get(f"{url}/healthz").json()["workers"]
    assert workers["count"] == 2
    assert workers["this"] in pids
    assert workers["states"] == dict.fromkeys(map(str, sorted(pids)), "ready")


def test_metrics_are_summed(running: tuple[GatewayProcess, str]) -> None:
    _, url = running
    before = rendered(url)
    with ThreadPoolExecutor(CLIENTS) as pool:
        assert {answer.status_code for answer in pool.map(lambda _: render(url), range(RENDERS))} == {200}
    stage = 'scenegate_render_stage_duration_seconds_count{stage="render"}'
    # Reports are half a second apart, and either process may answer, with a report of the other that is that old.
    wait_until(lambda: rendered(url) == before + RENDERS and figures(url)[stage] == before + RENDERS)
    now = figures(url)
    assert now["scenegate_workers_ready"] == 2.0
    assert now["scenegate_render_threads"] == 2.0
    assert now['scenegate_interface_ready{interface="render"}'] == 1.0


def test_a_killed_process_is_replaced_and_only_its_requests_are_lost(running: tuple[GatewayProcess, str]) -> None:
    process, url = running
    before = all_ready(url)
    wait_until(lambda: figures(url)["scenegate_workers_ready"] == 2.0)
    counted = rendered(url)
    finished, killed = count(), Event()
    enough = Event()

    def client(_: int) -> tuple[int, int]:
        """Send requests, ``RENDERS`` of them after the process was killed; return numbers of images and of errors."""
        images = errors = after = 0
        while after < RENDERS:
            after += killed.is_set()
            try:
                assert render(url).status_code == 200
                images += 1
            except httpx2.TransportError:
                assert killed.is_set()
                errors += 1
            if next(finished) == RENDERS:
                enough.set()
        return images, errors

    with ThreadPoolExecutor(CLIENTS) as pool:
        sent = [pool.submit(client, number) for number in range(CLIENTS)]
        try:
            assert enough.wait(SECONDS)
            killed.set()
            os.kill(before[0], signal.SIGKILL)
            wait_until(lambda: str(before[0]) not in states_while_killed(url))
            after = all_ready_while_killed(url)
        finally:
            killed.set()
        results = [each.result() for each in sent]
    assert before[0] not in after
    assert before[1] in after
    assert all(errors <= 1 for _, errors in results), "more was lost than what the killed process had"
    # Half a second of a killed process's counts may be missing; what it had reported is not.
    assert wait_until(lambda: figures(url)["scenegate_workers_ready"] == 2.0)
    assert counted < rendered(url) <= counted + sum(images + errors for images, errors in results)
    entry = process.wait_for("Child process")
    assert entry["event"] == f"Child process [{before[0]}] died"


def states_while_killed(url: str) -> dict[str, str]:
    """``states``; the connection may be one that the killed process had accepted."""
    try:
        return states(url)
    except httpx2.TransportError:
        return states(url)


def all_ready_while_killed(url: str) -> list[int]:
    """``all_ready``, likewise."""
    try:
        return all_ready(url)
    except httpx2.TransportError:
        return all_ready(url)


def test_log_lines_name_the_process(running: tuple[GatewayProcess, str]) -> None:
    process, url = running
    pids = all_ready(url)
    render(url)
    entry = process.wait_for("request")
    assert entry["path"] == "/render"
    assert isinstance(entry["worker"], int)
    assert pids


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_all_processes_with_exit_code_0(number: signal.Signals) -> None:
    with gateway_process(*WORKERS) as (process, url):
        pids = all_ready(url)
        process.process.send_signal(number)
        assert process.process.wait(SECONDS) == 0
        log = process.rest_of_log()
    assert not [entry for entry in log if entry["level"] in ("error", "critical", "raw")]
    assert log[-1]["event"] == "Scenegate has stopped"
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_processes_end_with_a_killed_supervisor() -> None:
    def ended(pid: int) -> bool:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        return False

    with gateway_process(*WORKERS) as (process, url):
        pids = all_ready(url)
        process.process.kill()
        wait_until(lambda: all(map(ended, pids)))


PATIENT_SUPERVISOR = """
import sys
from gateway.cli import main
from uvicorn.supervisors.multiprocess import Process

ping_once = Process.ping

def ping(process, timeout):
    if ping_once(process, 1.0):
        return True
    print("waiting for", process.pid, file=sys.stderr, flush=True)
    return ping_once(process, 1e6)

Process.ping = ping
main()
"""
"""Program that serves, and says when uvicorn's supervisor waits for a process. It waits without a timeout."""


def test_a_process_that_ends_while_the_supervisor_waits_for_it_is_replaced() -> None:
    with gateway_process(*WORKERS, command=(sys.executable, "-c", PATIENT_SUPERVISOR)) as (process, url):
        pids = all_ready(url)
        os.kill(pids[0], signal.SIGSTOP)
        process.wait_for(f"waiting for {pids[0]}")
        os.kill(pids[0], signal.SIGKILL)
        entry = process.wait_for("Child process")
    assert entry["event"] == f"Child process [{pids[0]}] died"


def test_a_process_that_cannot_start_leaves_the_others_and_is_tried_again(tmp_path: Path) -> None:
    tokens = tmp_path / "tokens"
    tokens.write_text("a-token-of-many-characters")
    with gateway_process(*WORKERS, "--http-token-file", str(tokens)) as (process, url):
        pids = all_ready(url)
        tokens.rename(tmp_path / "elsewhere")
        os.kill(pids[0], signal.SIGKILL)
        entry = process.wait_for("This process cannot start")
        assert entry["level"] == "error"
        assert str(tokens) in entry["event"]
        (tmp_path / "elsewhere").rename(tokens)
        assert pids[1] in wait_until(lambda: all_ready(url))
        assert process.stop() == 0
        log = process.rest_of_log()
    assert not [entry for entry in log if entry["level"] == "raw"]
