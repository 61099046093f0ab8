"""``scenegate serve --only render --workers 2``: real processes on one port."""

import os
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path
from threading import Event
from typing import TypeVar

import httpx2
import pytest

from gateway.cli import serve_workers
from tests.support import clients, forms
from tests.support.clients import figures
from tests.support.gateway_process import GatewayProcess, gateway_process, refused
from tests.support.waiting import SECONDS, wait_until

pytestmark = pytest.mark.slow

Answer = TypeVar("Answer")
WORKERS = ("--only", "render", "--workers", "2")
RENDERS = 24
CLIENTS = 4
BODY = forms.body(forms.gltf(), forms.drake_fields("label"))


def render(url: str, content: bytes = BODY) -> httpx2.Response:
    return clients.post(f"{url}/render", content=content, headers={"Content-Type": forms.CONTENT_TYPE})


def states(url: str) -> dict[str, str]:
    found: dict[str, str] = clients.get(f"{url}/healthz").json()["workers"]["states"]
    return found


def all_ready(url: str) -> list[int]:
    """Wait until both processes are ready; return their numbers."""

    def ready() -> list[int]:
        answer = clients.get(f"{url}/readyz")
        return [int(pid) for pid in answer.json()["workers"]["states"]] if answer.json()["status"] == "ready" else []

    return wait_until(ready)


def ended(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


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
            wait_until(lambda: str(before[0]) not in while_killed(states, url))
            after = while_killed(all_ready, url)
        finally:
            killed.set()
        results = [each.result() for each in sent]
    assert before[0] not in after
    assert before[1] in after
    assert all(errors <= 1 for _, errors in results), "more was lost than what the killed process had"
    # Half a second of a killed process's counts may be missing; what it had reported is not.
    assert wait_until(lambda: figures(url)["scenegate_workers_ready"] == 2.0)
    assert counted < rendered(url) <= counted + sum(images + errors for images, errors in results)
    assert process.wait_for("A process has ended")["pid"] == before[0]


def while_killed(ask: Callable[[str], Answer], url: str) -> Answer:
    """Ask twice if the first connection is one that the killed process had accepted."""
    try:
        return ask(url)
    except httpx2.TransportError:
        return ask(url)


def test_log_lines_name_the_process(running: tuple[GatewayProcess, str]) -> None:
    process, url = running
    pids = all_ready(url)
    render(url)
    entry = process.wait_for("request")
    assert entry["path"] == "/render"
    assert isinstance(entry["worker"], int)
    assert pids


def test_a_hung_process_is_replaced_and_all_end_with_a_killed_supervisor() -> None:
    with gateway_process(*WORKERS, "--unresponsive-seconds", "2") as (process, url):
        pids = all_ready(url)
        os.kill(pids[0], signal.SIGSTOP)
        assert process.wait_for("A process does not respond and is killed")["pid"] == pids[0]
        assert process.wait_for("A process has ended")["exit_code"] == -signal.SIGKILL
        wait_until(lambda: pids[1] in (now := all_ready(url)) and pids[0] not in now)
        now = all_ready(url)
        process.process.kill()
        wait_until(lambda: all(map(ended, now)))


def test_sighup_replaces_all_processes_and_an_interrupt_ends_them() -> None:
    """SIGTERM does so, too: see ``test_sigterm``."""
    with gateway_process(*WORKERS) as (process, url):
        pids = all_ready(url)
        process.process.send_signal(signal.SIGHUP)
        wait_until(lambda: len(now := all_ready(url)) == 2 and not set(pids) & set(now))
        process.process.send_signal(signal.SIGHUP)
        process.wait_for("All processes are replaced")
        process.wait_for("All processes are replaced")
        pids = all_ready(url)
        process.process.send_signal(signal.SIGINT)
        assert process.process.wait(SECONDS) == 0
        log = process.rest_of_log()
    assert not [entry for entry in log if entry["level"] in ("error", "critical", "raw")]
    assert log[-1]["event"] == "Scenegate has stopped"
    assert all(map(ended, pids))


def test_all_processes_end_with_an_error_if_the_kernels_cannot_be_compiled(tmp_path: Path) -> None:
    tmp_path.joinpath("kernels").write_text("not a folder")
    code, log = refused("--http-port", "0", *WORKERS, env={"NUMBA_CACHE_DIR": str(tmp_path / "kernels")})
    assert code == 1
    assert any("kernels" in entry["event"] and entry["level"] == "error" for entry in log)
    assert not any("started" in entry["event"] for entry in log)


def test_the_folder_of_a_killed_supervisor_is_removed_at_the_next_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    killed, running = tmp_path / "scenegate-workers-killed", tmp_path / "scenegate-workers-running"
    with serve_workers.reports_folder() as folder:
        folder.rename(running)
        shutil.copytree(running, killed)
        for old in (killed, running):
            os.utime(old, (0, 0))
        with serve_workers.reports_folder() as other:
            assert sorted(tmp_path.iterdir()) == sorted((running, other))


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
