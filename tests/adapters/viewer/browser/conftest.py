"""A browser, a gateway, and the page with a publisher or a client."""

from collections.abc import Iterator
from typing import Any

import pytest

from scenegate import TreeViewer
from tests.adapters.viewer.browser.page import FLAGS, Publisher, View, hub_url
from tests.support.browser import chromium
from tests.support.gateway_process import gateway_process
from tests.support.liblcm import liblcm
from tests.support.waiting import SECONDS


@pytest.fixture(scope="package")
def browser() -> Iterator[Any]:
    with chromium() as running:
        yield running


@pytest.fixture(scope="package")
def url(browser: Any) -> Iterator[str]:
    """URL of a gateway."""
    with gateway_process(*FLAGS) as (_, url):
        yield url


@pytest.fixture
def publisher(url: str) -> Publisher:
    """A publisher that has emptied the scene."""
    publisher = Publisher(url)
    publisher.send(delete=[{"path": []}])
    return publisher


@pytest.fixture
def shown(browser: Any, url: str, publisher: Publisher) -> Iterator[View]:
    """The page of the publisher's scene."""
    with View(browser, url) as shown:
        yield shown


@pytest.fixture
def client(url: str) -> Iterator[TreeViewer]:
    """A client that has emptied the scene."""
    liblcm()
    with TreeViewer(hub_url(url), timeout=SECONDS) as viewer:
        viewer.delete()
        yield viewer
