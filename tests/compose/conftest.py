"""Where the gateway under test is: SCENEGATE_URL (a container, another machine), or a process started here."""

from __future__ import annotations

import os
import random
import time
from collections.abc import Iterator
from typing import Any

import httpx2
import pytest

from tests.support.gateway_process import START_SECONDS, gateway_process


@pytest.fixture(scope="package")
def url() -> Iterator[str]:
    """Base URL of a gateway with every interface that serves the demo scene."""
    given = os.environ.get("SCENEGATE_URL")
    if given:
        # Not every compose waits for the health of what a service depends on.
        yield _ready(given.rstrip("/"))
        return
    # An LCM network of its own, so that no other gateway on this machine answers.
    network = f"udpm://239.255.76.67:{random.randrange(20000, 60000)}?ttl=0"
    with gateway_process("--demo", "--grpc-port", "0", "--tcpq-port", "0", "--lcm-url", network) as (_, started):
        yield _ready(started)


def _ready(url: str) -> str:
    """The URL, as soon as the gateway behind it says that it is ready."""
    limit = time.monotonic() + START_SECONDS
    while True:
        try:
            answer = httpx2.get(f"{url}/readyz")
            if answer.status_code == 200:
                return url
            state = answer.text
        except httpx2.TransportError as error:
            state = str(error)
        assert time.monotonic() < limit, f"{url} did not become ready: {state}"
        time.sleep(0.2)


@pytest.fixture
def http(url: str) -> Iterator[httpx2.Client]:
    """A client of that gateway."""
    with httpx2.Client(base_url=url, timeout=60.0) as client:
        yield client


@pytest.fixture(scope="package")
def interfaces(url: str) -> dict[str, Any]:
    """What the gateway says of each interface."""
    described: dict[str, Any] = httpx2.get(f"{url}/healthz").json()["interfaces"]
    return described
