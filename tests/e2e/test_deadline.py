"""Renders that would take minutes end at --render-seconds, when their clients disconnect, and at SIGTERM."""

import http.client
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager

import httpx2
import pytest

from tests.support import clients, forms
from tests.support.gateway_process import gateway_process
from tests.support.slow import one_pixel_body, slow_body
from tests.support.waiting import wait_until

pytestmark = pytest.mark.slow


def connect(url: str) -> closing[http.client.HTTPConnection]:
    return closing(http.client.HTTPConnection(url.removeprefix("http://")))


def send(client: http.client.HTTPConnection, body: bytes) -> None:
    client.request("POST", "/render", body, {"Content-Type": forms.CONTENT_TYPE})


def post(url: str, body: bytes) -> httpx2.Response:
    return clients.post(f"{url}/render", content=body, headers={"Content-Type": forms.CONTENT_TYPE})


def until_answer(url: str, path: str, status: int, text: str) -> None:
    wait_until(lambda: (answer := clients.get(url + path)).status_code == status and text in answer.text)


def until_figure(url: str, name: str, value: float) -> None:
    until_answer(url, "/metrics", 200, f"\n{name} {value}")


@contextmanager
def posted(url: str, body: bytes, count: int) -> Iterator[list[Future[httpx2.Response]]]:
    with ThreadPoolExecutor(count) as pool:
        yield [pool.submit(post, url, body) for _ in range(count)]


@pytest.mark.parametrize("flags", [(), ("--samples", "8"), ("--frame-threads", "1")])
def test_slow_renders_end_at_the_limit_and_others_are_served(flags: tuple[str, ...]) -> None:
    arguments = ("--only", "render", "--threads", "2", "--render-seconds", "1", *flags)
    with gateway_process(*arguments) as (process, url), posted(url, slow_body(), 4) as slow:
        for answer in (one.result() for one in slow):
            assert (answer.status_code, answer.headers.get("retry-after")) == (503, None)
            assert "--render-seconds = 1 s" in answer.text
        assert post(url, one_pixel_body()).status_code == 200
        figures = clients.figures(url)
        assert figures['scenegate_renders_total{outcome="slow",type="color"}'] == 4.0
        # Renders that began before all kernels were loaded are rendered again.
        assert figures['scenegate_calls_total{end="timed_out"}'] >= 4.0
        assert process.stop() == 0


def test_threads_are_free_after_clients_disconnect() -> None:
    with gateway_process("--only", "render", "--threads", "2", "--render-seconds", "3600") as (process, url):
        with ExitStack() as stack:
            for _ in range(4):
                send(stack.enter_context(connect(url)), slow_body())
            until_figure(url, "scenegate_render_running", 2.0)
            until_figure(url, "scenegate_render_waiting", 2.0)
        assert post(url, one_pixel_body()).status_code == 200
        until_answer(url, "/metrics", 200, 'scenegate_renders_total{outcome="gone",type="color"} 4.0')
        assert process.stop() == 0


def test_is_not_ready_while_every_thread_runs_a_slow_call() -> None:
    with gateway_process("--only", "render", "--threads", "2", "--render-seconds", "20") as (process, url):
        assert clients.get(f"{url}/readyz").status_code == 200
        with ExitStack() as stack:
            for _ in range(2):
                send(stack.enter_context(connect(url)), slow_body(instances=1000))
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
            answer = one.result()
            assert (answer.status_code, answer.headers["retry-after"]) == (503, "1")
            assert "shut down" in answer.text
