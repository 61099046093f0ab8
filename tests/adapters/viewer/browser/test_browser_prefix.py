"""The pages below a path prefix and in a notebook's frame, in a real browser."""

from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler
from typing import Any

import pytest

from scenegate import Box, TreeViewer
from tests.adapters.viewer.browser.page import FLAGS, View, hub_url
from tests.support.browser import PAGE_SECONDS, new_page
from tests.support.gateway_process import gateway_process
from tests.support.http_stub import http_server
from tests.support.prefix_proxy import prefix_proxy
from tests.support.waiting import SECONDS, wait_until

pytestmark = [pytest.mark.browser, pytest.mark.slow]

PREFIX = "/user/ann/proxy/8000"


@pytest.fixture(scope="module")
def notebook() -> Iterator[str]:
    """URL of a page of another origin, which shows the page of its query in a frame."""

    def answer(request: BaseHTTPRequestHandler) -> tuple[int, bytes]:
        source = request.path.partition("?")[2]
        return 200, f"<!doctype html><iframe src='{source}' width=900 height=600></iframe>".encode()

    with http_server(answer, "text/html") as url:
        yield url.replace("127.0.0.1", "localhost")


@pytest.fixture(scope="module")
def gateway() -> Iterator[str]:
    """URL of a gateway with a red box."""
    with gateway_process(*FLAGS, "--root-path", PREFIX) as (_, url):
        with TreeViewer(hub_url(url), timeout=SECONDS) as viewer:
            viewer["robot"].set(Box((1, 1, 1), color=(1, 0, 0)))
        yield url


@pytest.mark.parametrize("strip", [True, False])
def test_pages_below_a_prefix(browser: Any, gateway: str, strip: bool) -> None:
    with prefix_proxy(int(gateway.rpartition(":")[2]), PREFIX, strip=strip) as url, View(browser, url) as view:
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

    wait_until(is_refused, PAGE_SECONDS)
    page.close()
