"""Debian's chromium, driven by Playwright; nothing is downloaded."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, Self

import pytest

from tests.support.waiting import MILLISECONDS, wait_until

PAGE_SECONDS: Final = 120.0
"""Time limit of a wait in a page: a label that was renamed fails its tests, and leaves the others their time."""
WIDTH, HEIGHT = 1024, 640
"""Pixels of a page. Without a GPU, the time of a frame grows with them."""
ARGUMENTS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


@contextmanager
def chromium() -> Iterator[Any]:
    """A running browser; skips when there is none."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        pytest.skip("no chromium on this machine (on Debian: apt install chromium)")
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(ARGUMENTS), timeout=MILLISECONDS)
        try:
            yield browser
        finally:
            browser.close()


def new_page(browser: Any, **options: Any) -> Any:
    """A page with the time limit of pages; Playwright's own is 30 s."""
    page = browser.new_page(**options)
    page.set_default_timeout(1000 * PAGE_SECONDS)
    return page


def wait_in_page(page: Any, condition: str, *argument: Any) -> None:
    """Wait until JavaScript is true in a page.

    Playwright's ``wait_for_function`` evaluates text in the page, which the page's content security policy forbids.
    """
    wait_until(lambda: page.evaluate(condition, *argument), PAGE_SECONDS)


class Watched:
    """A page and the errors that it must not have. As a context manager, it closes the page and checks them."""

    def __init__(self, browser: Any, url: str, *, width: int = WIDTH, height: int = HEIGHT) -> None:
        self.page = new_page(browser, viewport={"width": width, "height": height})
        self.faults: list[str] = []
        self.page.on("pageerror", lambda error: self.faults.append(f"exception: {error}"))
        self.page.on("console", self._console)
        self.page.on("request", self._request)
        self._host = url.split("/")[2]
        self.expect_outage = False
        """Ignore failed connections while the gateway is stopped on purpose."""
        self.page.goto(f"{url}/view?theme=light")
        wait_in_page(self.page, "window.scenegate !== undefined")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, failure: type[BaseException] | None, *_: object) -> None:
        self.page.close()
        assert failure or self.faults == []

    def _console(self, message: Any) -> None:
        if message.type == "error" and not (self.expect_outage and "ERR_CONNECTION" in message.text):
            self.faults.append(f"console: {message.text}")

    def _request(self, request: Any) -> None:
        if not request.url.startswith(("data:", "blob:")) and request.url.split("/")[2] != self._host:
            self.faults.append(f"request to {request.url}")
