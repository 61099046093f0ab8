"""A browser, a gateway, and the page with a publisher or a client."""

from collections.abc import Iterator
from typing import Any

import pytest

from scenegate import TreeViewer
from tests.adapters.viewer.page import FLAGS, Publisher, View, hub_url
from tests.support.browser import chromium
from tests.support.gateway_process import gateway_process
from tests.support.liblcm import liblcm
from tests.support.waiting import SECONDS


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def url(browser: Any) -> Iterator[str]:
    """URL of a gateway."""
    with gateway_process(*FLAGS) as (_, url):
        yield url


@pytest.fixture
def view(browser: Any, url: str) -> Iterator[tuple[View, Publisher]]:
    """The page of an empty scene, and a publisher."""
    publisher = Publisher(url)
    publisher.send(delete=[{"path": []}])
    with View(browser, url) as shown:
        yield shown, publisher


@pytest.fixture
def client(url: str) -> Iterator[TreeViewer]:
    """A client that has emptied the scene."""
    liblcm()
    with TreeViewer(hub_url(url), timeout=SECONDS) as viewer:
        viewer.delete()
        yield viewer
