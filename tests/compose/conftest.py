"""Where the gateway under test is: SCENEGATE_URL (a container, another machine), or a process started here."""

from __future__ import annotations

import os
from collections.abc import Iterator

import httpx2
import pytest

from tests.support.gateway_process import gateway_process


@pytest.fixture(scope="package")
def url() -> Iterator[str]:
    """Base URL of a gateway that serves the demo scene."""
    given = os.environ.get("SCENEGATE_URL")
    if given:
        yield given.rstrip("/")
        return
    with gateway_process("--demo", "--only", "render,scene") as (_, started):
        yield started


@pytest.fixture
def http(url: str) -> Iterator[httpx2.Client]:
    """A client of that gateway."""
    with httpx2.Client(base_url=url, timeout=60.0) as client:
        yield client
