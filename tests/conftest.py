"""Settings of hypothesis, and the gateway that tests of several rooms share."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from hypothesis import HealthCheck, settings

from tests.support import clients
from tests.support.gateway_process import gateway_process

# A busy machine is no fault of what is tested: hypothesis' own limits are 200 ms an example and a minute to make them.
settings.register_profile("scenegate", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("scenegate")


@dataclass(frozen=True, slots=True)
class DemoGateway:
    """Addresses of a running gateway."""

    url: str
    """``http://127.0.0.1:port``"""
    grpc: str
    """``127.0.0.1:port``"""
    tcpq: str
    """``127.0.0.1:port``"""


@pytest.fixture(scope="session")
def demo_gateway() -> Iterator[DemoGateway]:
    """A gateway with every interface, the demo scene and default access; its log must have no error in the end.

    A start takes seconds, so tests share it unless they need other flags or an empty scene.
    """
    flags = ("--lcm-url", "off", "--tcpq-port", "0", "--grpc-port", "0", "--demo", "--stereo-faults")
    with gateway_process(*flags) as (process, url):
        interfaces = clients.get(f"{url}/healthz").json()["interfaces"]
        tcpq = interfaces["treeviewer"]["tcpq"]["url"].removeprefix("tcpq://")
        yield DemoGateway(url, f"127.0.0.1:{interfaces['stereo']['port']}", tcpq)
        assert process.stop() == 0
        assert not [entry for entry in process.rest_of_log() if entry["level"] in ("error", "critical", "raw")]
