"""Renders that would take minutes end at --render-seconds, when their clients disconnect, and at SIGTERM."""

import http.client
import re
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager

import pytest

from tests.support import forms
from tests.support.gateway_process import gateway_process
from tests.support.slow import one_pixel_body, slow_body
from tests.support.waiting import SECONDS

pytestmark = pytest.mark.slow

TIMEOUT = 300.0
"""Timeout of clients in seconds; only a hang takes longer."""


def connect(url: str) -> closing[http.client.HTTPConnection]:
    return closing(http.client.HTTPConnection(url.removeprefix("http://"), timeout=TIMEOUT))


def send(client: http.client.HTTPConnection, body: bytes) -> None:
    client.request("POST", "/render", body, {"Content-Type": forms.CONTENT_TYPE})


def post(url: str, body: bytes) -> tuple[int, str, str | None]:
    """Return status, text of the error, and Retry-After."""
    with connect(url) as client:
        send(client, body)
        response = client.getresponse()
        content = response.read()
        return response.status, "" if response.status == 200 else content.decode(), response.headers["retry-after"]


def get(url: str, path: str) -> tuple[int, str]:
    with connect(url) as client:
        client.request("GET", path)
        response = client.getresponse()
        return response.status, response.read().decode()


def until_answer(url: str, path: str, status: int, text: str) -> None:
    """Wait until a GET has this status and contains this text."""
    end = time.monotonic() + 10 * SECONDS
    while (answer := get(url, path))[0] != status or text not in answer[1]:
        assert time.monotonic() < end, answer
        time.sleep(0.01)


def until_figure(url: str, name: str, value: float) -> None:
    """Wait until a metric has this value."""
    until_answer(url, "/metrics", 200, f"\n{name} {value}")


@contextmanager
def posted(url: str, body: bytes, count: int) -> Iterator[list[Future[tuple[int, str, str | None]]]]:
    with ThreadPoolExecutor(count) as pool:
        yield [pool.submit(post, url, body) for _ in range(count)]


@pytest.mark.parametrize("flags", [(), ("--samples", "8"), ("--frame-threads", "1")])
def test_slow_renders_end_at_the_limit_and_others_are_served(flags: tuple[str, ...]) -> None:
    arguments = ("--only", "render", "--threads", "2", "--render-seconds", "1", *flags)
    with gateway_process(*arguments) as (process, url), posted(url, slow_body(), 4) as slow:
        assert [one.result() for one in slow] == [
            (503, "rendering was stopped: it took longer than --render-seconds = 1 s", None)
        ] * 4
        assert post(url, one_pixel_body())[0] == 200
        text = get(url, "/metrics")[1]
        assert 'scenegate_renders_total{outcome="slow",type="color"} 4.0' in text
        # Renders that began before all kernels were loaded are rendered again.
        timed_out = re.search(r'^scenegate_calls_total\{end="timed_out"\} (\S+)$', text, re.MULTILINE)
        assert timed_out is not None
        assert float(timed_out[1]) >= 4.0
        assert process.stop() == 0


def test_threads_are_free_after_clients_disconnect() -> None:
    with gateway_process("--only", "render", "--threads", "2", "--render-seconds", "3600") as (process, url):
        with ExitStack() as clients:
            for _ in range(4):
                send(clients.enter_context(connect(url)), slow_body())
            until_figure(url, "scenegate_render_running", 2.0)
            until_figure(url, "scenegate_render_waiting", 2.0)
        assert post(url, one_pixel_body())[0] == 200
        until_answer(url, "/metrics", 200, 'scenegate_renders_total{outcome="gone",type="color"} 4.0')
        assert process.stop() == 0


def test_is_not_ready_while_every_thread_runs_a_slow_call() -> None:
    with gateway_process("--only", "render", "--threads", "2", "--render-seconds", "20") as (process, url):
        assert get(url, "/readyz")[0] == 200
        with ExitStack() as clients:
            for _ in range(2):
                send(clients.enter_context(connect(url)), slow_body(instances=1000))
            until_answer(url, "/readyz", 503, '"status":"busy"')
            until_figure(url, "scenegate_render_slow", 2.0)
        until_answer(url, "/readyz", 200, "")
        until_figure(url, "scenegate_render_slow", 0.0)
        assert process.stop() == 0


def test_slow_renders_end_before_the_shutdown_timeout() -> None:
    """Each client gets 503, and the process ends by itself."""
    arguments = ("--only", "render", "--threads", "2", "--render-seconds", "3600", "--shutdown-seconds", "2")
    with gateway_process(*arguments) as (process, url), posted(url, slow_body(), 4) as slow:
        until_figure(url, "scenegate_render_running", 2.0)
        until_figure(url, "scenegate_render_waiting", 2.0)
        assert process.stop() == 0
        for one in slow:
            status, text, retry_after = one.result()
            assert (status, retry_after) == (503, "1")
            assert "shut down" in text
