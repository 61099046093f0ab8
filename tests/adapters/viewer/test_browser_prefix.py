"""The pages below a path prefix and in a notebook's frame, in a real browser."""

from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any

import pytest

from scenegate import Box, TreeViewer
from tests.adapters.viewer.page import View
from tests.support import clients
from tests.support.browser import chromium, new_page
from tests.support.gateway_process import gateway_process
from tests.support.prefix_proxy import prefix_proxy
from tests.support.waiting import SECONDS, wait_until

pytestmark = [pytest.mark.browser, pytest.mark.slow]

PREFIX = "/user/ann/proxy/8000"
PORTS = ("--lcm-url", "off", "--grpc-port", "0", "--tcpq-port", "0")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def notebook() -> Iterator[str]:
    """URL of a page of another origin, which shows the page of its query in a frame."""

    class Notebook(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            source = self.path.partition("?")[2]
            body = f"<!doctype html><iframe src='{source}' width=900 height=600></iframe>".encode()
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Notebook) as server:
        thread = Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://localhost:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def gateway() -> Iterator[str]:
    """URL of a gateway with a red box."""
    with gateway_process(*PORTS, "--root-path", PREFIX) as (_, url):
        with clients.Client(base_url=url) as http:
            hub = http.get("/healthz").json()["interfaces"]["treeviewer"]["tcpq"]["url"]
        with TreeViewer(hub, timeout=SECONDS) as viewer:
            viewer["robot"].set(Box((1, 1, 1), color=(1, 0, 0)))
        yield url


@pytest.mark.parametrize("strip", [True, False])
def test_pages_below_a_prefix(browser: Any, gateway: str, strip: bool) -> None:
    with prefix_proxy(int(gateway.rpartition(":")[2]), PREFIX, strip=strip) as url:
        view = View(browser, url)
        view.look_at("robot")
        view.until(lambda: view.share("red") > 0.02, "the box")
        view.page.get_by_role("link", name="Scenegate").click()
        view.page.get_by_role("cell", name="Tree viewer").wait_for()
        assert view.page.url == f"{url}/"
        view.page.get_by_role("link", name="HTTP interface").click()
        view.page.locator("#operations-Health_and_metrics-healthz_healthz_get button").first.click()
        view.page.get_by_role("button", name="Try it out").click()
        view.page.get_by_role("button", name="Execute").click()
        view.page.locator(".live-responses-table .response-col_status", has_text="200").wait_for()
        assert view.page.locator(".request-url pre").inner_text() == f"{url}/healthz"
        view.page.goto(f"{url}/view/?theme=dark")
        assert view.page.url == f"{url}/view?theme=dark"
        view.page.close()
        assert view.faults == []


def test_view_in_the_frame_of_a_notebook(browser: Any, gateway: str, notebook: str) -> None:
    page = new_page(browser)
    page.goto(f"{notebook}?{gateway}/view")
    page.frame_locator("iframe").get_by_text("interfaces ready").wait_for()
    page.close()


def test_other_pages_cannot_show_the_view(browser: Any, gateway: str, notebook: str) -> None:
    page = new_page(browser)
    with page.expect_event("console", lambda message: "frame-ancestors" in message.text):
        page.goto(f"{notebook.replace('localhost', 'other.localhost')}?{gateway}/view")

    def is_refused() -> bool:
        page.evaluate("0")  # Playwright reads its events in calls only
        return "chrome-error" in page.frames[1].url

    wait_until(is_refused)
    page.close()
