"""The gateway under test: SCENEGATE_URL (a container, another machine), or a process started here."""

import contextlib
import os
import random
from collections.abc import Iterator
from typing import Any

import httpx2
import pytest

from tests.support import clients
from tests.support.gateway_process import gateway_process
from tests.support.waiting import wait_until


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

    def ready() -> bool:
        with contextlib.suppress(httpx2.TransportError):
            return bool(clients.get(f"{url}/readyz").status_code == 200)
        return False

    wait_until(ready)
    return url


@pytest.fixture
def http(url: str) -> Iterator[httpx2.Client]:
    """A client of that gateway."""
    with clients.Client(base_url=url) as client:
        yield client


@pytest.fixture(scope="package")
def interfaces(url: str) -> dict[str, Any]:
    """Return the interfaces in the gateway's /healthz."""
    described: dict[str, Any] = clients.get(f"{url}/healthz").json()["interfaces"]
    return described
